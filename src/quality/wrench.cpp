#include "quality/force_closure.h"

#include <cassert>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace handhold {
namespace {

struct TangentBasis {
  Eigen::Vector3d t;
  Eigen::Vector3d b;
};

/// Two tangents from the unit normal alone, t x b = n. Continuous but on the plane n_z = 0, where the sign flips; the
/// denominator is never below 1.
TangentBasis tangentBasis(const Eigen::Vector3d& n) {
  const double sign = std::copysign(1.0, n.z());
  const double a = -1 / (sign + n.z());
  const double b = n.x() * n.y() * a;
  return {{1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()}, {b, sign + n.y() * n.y() * a, -n.y()}};
}

}  // namespace

WrenchMatrix frictionConeWrenches(std::span<const Contact> contacts, const WrenchModel& model) {
  assert(model.coneEdges >= 3 && model.torqueScale > 0 && model.friction >= 0);
  const int nContacts = static_cast<int>(contacts.size());
  WrenchMatrix wrenches(6, nContacts * model.coneEdges);
  for (int j = 0; j < model.coneEdges; ++j) {
    const double angle = 2 * std::numbers::pi * j / model.coneEdges;
    const double alongT = model.friction * std::cos(angle);
    const double alongB = model.friction * std::sin(angle);
    for (int i = 0; i < nContacts; ++i) {
      const TangentBasis tangents = tangentBasis(contacts[i].normal);
      const Eigen::Vector3d f = contacts[i].normal + alongT * tangents.t + alongB * tangents.b;
      const Eigen::Vector3d arm = (contacts[i].position - model.centerOfMass) / model.torqueScale;
      wrenches.col(model.coneEdges * i + j) << f, arm.cross(f);
    }
  }
  return wrenches;
}

}  // namespace handhold
