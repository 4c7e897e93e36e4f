#include "view/grasp_picture.h"

#include "core/error.h"
#include "hand/stored_hand.h"
#include "mesh/primitives.h"
#include "mesh/ray_scene.h"
#include "view/colours.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kMarkRadius = 0.012;  // of the radius of object and hand together
constexpr double kConeLength = 0.075;  // of the same
constexpr double kSeenThrough = 0.10;  // of the object's radius: a contact so deep behind a surface counts 1/e
constexpr double kObjectCounts = 2.5;  // links
constexpr int kProbeWidth = 48, kProbeHeight = 36;  // rays of a trial view

Vector3d vectorAt(const std::vector<float>& array, std::size_t row) {
  return {array[3 * row], array[3 * row + 1], array[3 * row + 2]};
}

void requireGrasp(const GraspSet& set, std::size_t grasp) {
  if (set.graspCount() == 0) {
    throw InputError(fmt::format("the set of {} and {} holds no grasp, want one that does", set.object, set.hand));
  }
  if (grasp >= set.graspCount()) {
    throw InputError(fmt::format("grasp {} does not exist, the set of {} and {} holds {}: want 0 to {}", grasp,
                                 set.object, set.hand, set.graspCount(), set.graspCount() - 1));
  }
}

bool touches(const GraspSet& set, std::size_t grasp, std::size_t link) {
  const auto begin = set.contactLink.begin();
  return std::count(begin + set.contactBegin[grasp], begin + set.contactBegin[grasp + 1], link) > 0;
}

/// A closed cone with its tip at the origin that points along +z.
TriangleMesh coneMesh(double radius, double length) {
  constexpr std::uint32_t kSides = 24;
  TriangleMesh cone;
  cone.vertices = {Vector3d::Zero(), Vector3d(0, 0, -length)};
  for (std::uint32_t i = 0; i < kSides; ++i) {
    const double angle = 2 * std::numbers::pi * i / kSides;
    cone.vertices.emplace_back(radius * std::cos(angle), radius * std::sin(angle), -length);
    const std::uint32_t here = 2 + i, next = 2 + (i + 1) % kSides;
    cone.triangles.push_back({0, here, next});
    cone.triangles.push_back({1, next, here});
  }
  return cone;
}

void addContacts(const GraspSet& set, std::size_t grasp, std::vector<ScenePart>& scene) {
  const double sceneRadius = boundingBox(scene).diagonal().norm() / 2;
  const double radius = kMarkRadius * sceneRadius;
  const TriangleMesh sphere = sphereMesh(radius);
  const TriangleMesh cone = coneMesh(0.9 * radius, kConeLength * sceneRadius);
  for (std::size_t c = set.contactBegin[grasp]; c < set.contactBegin[grasp + 1]; ++c) {
    Isometry3d X_OC = Isometry3d::Identity();
    X_OC.translation() = vectorAt(set.contactPosition, c);
    scene.push_back({sphere, X_OC, kContactColour, true});
    X_OC.linear() =
        Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), vectorAt(set.contactNormal, c)).toRotationMatrix();
    scene.push_back({cone, X_OC, kContactColour, true});
  }
}

/// What a ray from the camera meets, as the index of the part.
struct ProbeScene {
  const std::vector<ScenePart>& parts;
  std::vector<std::uint16_t> partOfTriangle;
  RayScene rays;

  explicit ProbeScene(const std::vector<ScenePart>& scene) : parts(scene), rays(mergeSolids()) {}

  TriangleMesh mergeSolids() {
    TriangleMesh all;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      if (parts[i].isMark) continue;
      append(all, parts[i].mesh, parts[i].X_W);
      partOfTriangle.insert(partOfTriangle.end(), parts[i].mesh.triangles.size(), static_cast<std::uint16_t>(i));
    }
    return all;
  }

  /// How evenly and largely the parts are seen: the sum over the parts of the square root of their share of the frame.
  /// The object, part 0, counts more: many links would hide it.
  double spread(const Camera& camera) const {
    std::vector<int> seen(parts.size(), 0);
    for (int i = 0; i < kProbeWidth * kProbeHeight; ++i) {
      const int column = i % kProbeWidth, row = i / kProbeWidth;
      const double u = (column + 0.5) / kProbeWidth, v = (row + 0.5) / kProbeHeight;
      const RayHit hit = rays.cast(camera.X_WC.translation(), camera.ray(u, v));
      if (!hit.missed()) ++seen[partOfTriangle[hit.triangle]];
    }
    double sum = 0;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const double share = static_cast<double>(seen[i]) / (kProbeWidth * kProbeHeight);
      sum += (i == 0 ? kObjectCounts : 1) * std::sqrt(share);
    }
    return sum;
  }
};

/// The mean over the contacts of exp(-depth behind the first surface).
double contactVisibility(const GraspSet& set, std::size_t grasp, const ProbeScene& probe, const Vector3d& eye,
                         double depthScale) {
  const std::size_t begin = set.contactBegin[grasp], end = set.contactBegin[grasp + 1];
  double sum = 0;
  for (std::size_t c = begin; c < end; ++c) {
    const Vector3d toContact = vectorAt(set.contactPosition, c) - eye;
    const RayHit hit = probe.rays.cast(eye, toContact.normalized());
    sum += std::exp(-std::max(0.0, toContact.norm() - hit.distance) / depthScale);
  }
  return begin == end ? 0 : sum / static_cast<double>(end - begin);
}

}  // namespace

std::vector<ScenePart> graspScene(const GraspSet& set, std::size_t grasp) {
  requireGrasp(set, grasp);
  const std::size_t nJoints = set.jointNames.size();
  Eigen::VectorXd jointPosition(nJoints);
  for (std::size_t j = 0; j < nJoints; ++j) jointPosition[j] = set.jointPosition[nJoints * grasp + j];
  const std::vector<Isometry3d> X_HL = linkPosesFromUrdf(set.urdf, set.linkNames, set.jointNames, jointPosition);
  const Isometry3d X_OH = set.X_OH(grasp);

  std::vector<ScenePart> scene;
  scene.push_back({set.objectMesh, Isometry3d::Identity(), kObjectColour, false});
  for (std::size_t i = 0; i < set.linkMeshes.size(); ++i) {
    const bool isPalm = scene.size() == 1;
    const Vector3d& colour = isPalm ? kPalmColour : touches(set, grasp, i) ? kTouchingColour : kLinkColour;
    if (!set.linkMeshes[i].triangles.empty()) scene.push_back({set.linkMeshes[i], X_OH * X_HL[i], colour, false});
  }
  addContacts(set, grasp, scene);
  return scene;
}

Vector3d graspView(const GraspSet& set, std::size_t grasp, const std::vector<ScenePart>& scene) {
  constexpr int kAzimuths = 24;
  const ProbeScene probe(scene);
  const double depthScale = kSeenThrough * boundingBox(set.objectMesh).diagonal().norm() / 2;
  const Vector3d approach = vectorAt(set.approachDirection, grasp);
  Vector3d best = Vector3d::UnitX();
  double bestScore = -1;
  for (const double elevation : {0.25, 0.45, 0.70}) {
    for (int i = 0; i < kAzimuths; ++i) {
      const double azimuth = 2 * std::numbers::pi * (i + 0.5) / kAzimuths;
      const Vector3d toEye(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                           std::sin(elevation));
      const Camera camera = frameScene(scene, toEye, static_cast<double>(kProbeWidth) / kProbeHeight);
      const double score = contactVisibility(set, grasp, probe, camera.X_WC.translation(), depthScale) +
                           1.2 * probe.spread(camera) + 0.25 * (1 - std::abs(toEye.dot(approach)));
      if (score > bestScore + 1e-9) bestScore = score, best = toEye;
    }
  }
  return best;
}

Image graspPicture(const GraspSet& set, std::size_t grasp, const RenderSettings& settings) {
  const std::vector<ScenePart> scene = graspScene(set, grasp);
  const double aspect = static_cast<double>(settings.width) / settings.height;
  return render(scene, frameScene(scene, graspView(set, grasp, scene), aspect), settings);
}

}  // namespace handhold
