#include "view/hand_picture.h"

#include "mesh/primitives.h"
#include "view/colours.h"

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kPinLength = 0.35;  // of the hand's radius
constexpr double kPinRadius = 0.012;
constexpr double kHeadRadius = 0.035;

/// A pin from the origin of X along its +z.
ScenePart pin(const Isometry3d& X, double handRadius, const Vector3d& colour) {
  ScenePart part{{}, X, colour, true};
  const double length = kPinLength * handRadius;
  append(part.mesh, cylinderMesh(kPinRadius * handRadius, length), Isometry3d(Eigen::Translation3d(0, 0, length / 2)));
  append(part.mesh, sphereMesh(kHeadRadius * handRadius), Isometry3d(Eigen::Translation3d(0, 0, length)));
  return part;
}

}  // namespace

Image handPicture(const Hand& hand, const Eigen::VectorXd& jointPosition, const std::vector<ScenePart>& held,
                  const RenderSettings& settings) {
  const std::vector<Isometry3d> X_HL = forwardKinematics(hand, jointPosition);
  const Isometry3d X_WH = (X_HL[static_cast<std::size_t>(hand.palmLink)] * hand.X_LG).inverse();  // W is the palm frame
  std::vector<ScenePart> scene;
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    if (hand.links[i].mesh.triangles.empty()) continue;
    const bool isPalm = static_cast<int>(i) == hand.palmLink;
    scene.push_back({hand.links[i].mesh, X_WH * X_HL[i], isPalm ? kPalmColour : kLinkColour, false});
  }
  const double radius = boundingBox(scene).diagonal().norm() / 2;
  for (ScenePart part : held) {
    part.X_W = X_WH * part.X_W;
    scene.push_back(std::move(part));
  }
  scene.push_back(pin(Isometry3d::Identity(), radius, kApproachColour));
  Isometry3d X_closing = Isometry3d::Identity();
  X_closing.linear() = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), Vector3d::UnitX()).toRotationMatrix();
  scene.push_back(pin(X_closing, radius, kClosingColour));
  const Vector3d toEye = Vector3d(0.45, -1, 0.35).normalized();  // across both pins, from a little aside and above
  const double aspect = static_cast<double>(settings.width) / settings.height;
  return render(scene, frameScene(scene, toEye, aspect), settings);
}

}  // namespace handhold
