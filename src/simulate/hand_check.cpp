#include "simulate/hand_check.h"

#include "mesh/primitives.h"
#include "mesh/ray_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

ObjectModel sphereAt(double radius, const Vector3d& center) {
  TriangleMesh mesh;
  append(mesh, sphereMesh(radius), Eigen::Isometry3d(Eigen::Translation3d(center)));
  return repairObject(std::move(mesh), {1, true, "m"}, "sphere");
}

/// How far the hand's own surface stands over the palm point: a ray from far in front of the palm back onto it. The
/// fingers are not asked, only the link that carries the palm frame.
double palmHeight(const Hand& hand) {
  const TriangleMesh& mesh = hand.links[hand.palmLink].mesh;
  if (mesh.triangles.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double far = 2 * boundingBox(mesh).diagonal().norm();
  const Vector3d approach = hand.X_LG.linear().col(2);
  const RayHit hit = RayScene(mesh).cast(hand.X_LG.translation() + far * approach, -approach);
  return hit.missed() ? std::numeric_limits<double>::quiet_NaN() : far - hit.distance;
}

void judgePalm(double height, HandCheck& check) {
  constexpr double kFlush = 2e-3;  // m
  if (std::isnan(height)) {
    check.warnings.emplace_back("the palm's link has no surface along the approach axis through the palm point");
  } else if (std::abs(height) > kFlush) {
    check.warnings.push_back(fmt::format("the palm point is {:.1f} mm {} the link's surface, want it on the surface",
                                         1e3 * std::abs(height), height > 0 ? "below" : "above"));
  }
}

void judgePreshape(const PreshapeCheck& preshape, HandCheck& check) {
  const auto& stops = preshape.onSphere.stops;
  if (std::all_of(stops.begin(), stops.end(), [](const ClosingStop& stop) { return stop.links.empty(); })) {
    check.warnings.push_back(fmt::format("preshape {}: no finger touches a sphere of {:.0f} mm in front of the palm",
                                         preshape.name, 2e3 * check.sphereRadius));
  }
}

}  // namespace

HandCheck checkHand(const Hand& hand, double sphereRadius) {
  HandCheck check;
  check.sphereRadius = sphereRadius;
  check.palmHeight = palmHeight(hand);
  judgePalm(check.palmHeight, check);
  const ObjectModel sphere = sphereAt(sphereRadius, Vector3d::Zero());
  const ObjectModel nothing = sphereAt(sphereRadius, Vector3d(100, 0, 0));  // out of every hand's reach
  const auto onSphere = makeReferencePolicy(hand, sphere, PolicyKind::surfaceNormal);
  const auto onNothing = makeReferencePolicy(hand, nothing, PolicyKind::surfaceNormal);
  for (std::size_t i = 0; i < hand.preshapes.size(); ++i) {
    PreshapeCheck& preshape = check.preshapes.emplace_back();
    preshape.name = hand.preshapes[i].name;
    const GraspCandidate candidate{Vector3d(0, 0, sphereRadius), -Vector3d::UnitZ(), 0, static_cast<int>(i)};
    onNothing->run(candidate, preshape.onNothing);
    preshape.selfCollidesEmpty = onNothing->selfCollides(candidate, preshape.onNothing);
    onSphere->run(candidate, preshape.onSphere);
    judgePreshape(preshape, check);
  }
  return check;
}

}  // namespace handhold
