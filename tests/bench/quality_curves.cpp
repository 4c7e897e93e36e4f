// The numbers of docs/images/quality.svg, which scripts/plot_quality draws, as JSON: epsilon and its bounds while a
// grasp is turned, and over friction. The grasp: a thumb and two fingers about a bottle of 70 mm, contacts as points or
// soft.
//
//     quality_curves > curves.json
#include "quality/force_closure.h"
#include "quality/true_cone.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Geometry>
#include <fmt/core.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using nlohmann::ordered_json;

constexpr double kFriction = 0.6, kTorsionRadius = 0.008, kTorqueScale = 0.1;

/// In the object frame, the bottle's axis z through the centre of mass.
std::vector<Contact> threeFingers() {
  constexpr double kRadius = 0.035;
  struct Finger {
    double degrees, height;
  };
  std::vector<Contact> contacts;
  for (const Finger finger : {Finger{90, 0}, Finger{235, 0.02}, Finger{305, -0.02}}) {
    const double angle = finger.degrees * std::numbers::pi / 180;
    const Eigen::Vector3d outward(std::cos(angle), std::sin(angle), 0);
    contacts.push_back({kRadius * outward + finger.height * Eigen::Vector3d::UnitZ(), -outward, 0});
  }
  return contacts;
}

std::vector<Contact> turned(std::vector<Contact> contacts, double degrees) {
  const Eigen::AngleAxisd turn(degrees * std::numbers::pi / 180, Eigen::Vector3d(1, 1, 1).normalized());
  for (Contact& contact : contacts) {
    contact.position = turn * contact.position;
    contact.normal = (turn * contact.normal).normalized();
  }
  return contacts;
}

double linearised(const std::vector<Contact>& contacts, double friction, int edges, double torsionRadius) {
  const WrenchMatrix w =
      frictionConeWrenches(contacts, {Eigen::Vector3d::Zero(), kTorqueScale, friction, edges, torsionRadius});
  const ForceClosureResult closure = testForceClosure(w);
  return closure.verdict == ForceClosure::closed ? epsilonMetric(w, closure) : 0;
}

TrueCones trueCones(double friction, double torsionRadius) {
  return TrueCones({Eigen::Vector3d::Zero(), kTorqueScale, friction, 8, torsionRadius});
}

ordered_json rotationCurve() {
  ordered_json curve = {{"degrees", {}}, {"edges_4", {}}, {"edges_8", {}}, {"lower", {}}, {"upper", {}}};
  for (int degrees = 0; degrees <= 360; degrees += 2) {
    const std::vector<Contact> contacts = turned(threeFingers(), degrees);
    const EpsilonBounds bounds = trueCones(kFriction, 0).epsilonBounds(contacts);
    curve["degrees"].push_back(degrees);
    curve["edges_4"].push_back(linearised(contacts, kFriction, 4, 0));
    curve["edges_8"].push_back(linearised(contacts, kFriction, 8, 0));
    curve["lower"].push_back(bounds.lower);
    curve["upper"].push_back(bounds.upper);
  }
  return curve;
}

ordered_json frictionCurve(double torsionRadius) {
  ordered_json curve = {{"friction", {}}, {"lower", {}}, {"upper", {}}};
  for (int percent = 2; percent <= 100; percent += 2) {
    const double friction = 0.01 * percent;
    const EpsilonBounds bounds = trueCones(friction, torsionRadius).epsilonBounds(threeFingers());
    curve["friction"].push_back(friction);
    curve["lower"].push_back(bounds.lower);
    curve["upper"].push_back(bounds.upper);
  }
  curve["critical_friction"] = trueCones(1, torsionRadius).criticalFriction(threeFingers()).friction;
  return curve;
}

}  // namespace
}  // namespace handhold

int main() {
  using namespace handhold;
  const ordered_json curves = {{"friction", kFriction},        {"torsion_radius", kTorsionRadius},
                               {"torque_scale", kTorqueScale}, {"rotation", rotationCurve()},
                               {"points", frictionCurve(0)},   {"soft_fingers", frictionCurve(kTorsionRadius)}};
  fmt::print("{}\n", curves.dump());
  return 0;
}
