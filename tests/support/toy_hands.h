#pragma once

#include "hand/hand.h"
#include "mesh/object.h"
#include "mesh/primitives.h"

#include <numbers>
#include <string>

namespace handhold::testing {

/// A link with one box of full extents `size` centred at `center`, hanging on `joint` (or fixed at X_PL).
inline int addBoxLink(Hand& hand, const std::string& name, int parent, int joint, const Eigen::Vector3d& size,
                      const Eigen::Vector3d& center) {
  Link link;
  link.name = name;
  link.parentLink = parent;
  link.joint = joint;
  append(link.mesh, boxMesh(size), Eigen::Isometry3d(Eigen::Translation3d(center)));
  roundToFloat(link.mesh);
  link.piecePoints.push_back(link.mesh.vertices[0]);
  hand.links.push_back(link);
  return static_cast<int>(hand.links.size()) - 1;
}

inline int addJoint(Hand& hand, const std::string& name, JointType type, int parent, const Eigen::Isometry3d& X_PJ,
                    const Eigen::Vector3d& axis, double lower, double upper) {
  Joint joint;
  joint.name = name;
  joint.type = type;
  joint.parentLink = parent;
  joint.childLink = static_cast<int>(hand.links.size());
  joint.X_PJ = X_PJ;
  joint.axis = axis;
  joint.lower = lower;
  joint.upper = upper;
  hand.joints.push_back(joint);
  return static_cast<int>(hand.joints.size()) - 1;
}

/// A palm plate whose upper face is z = 0, palm frame there.
inline void addPalm(Hand& hand) {
  addBoxLink(hand, "palm", -1, -1, {0.08, 0.04, 0.02}, {0, 0, -0.01});
  hand.palmLink = 0;
  hand.X_LG = Eigen::Isometry3d::Identity();
}

/// Two jaws with pads of 20 x 20 mm, 20 to 40 mm in front of the palm; jaw 1 at +x closes to -x. Each opens to 40 mm.
/// `coupled`: the second mimics the first and the jaw centres itself; else both close on their own.
inline Hand makeJaw(bool coupled) {
  Hand hand;
  hand.name = "toy_jaw";
  addPalm(hand);
  const Eigen::Vector3d pad(0.01, 0.02, 0.02), center(0.005, 0, 0.03);
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  const int first = addJoint(hand, "jaw_1", JointType::prismatic, 0, X, Eigen::Vector3d::UnitX(), 0, 0.04);
  addBoxLink(hand, "pad_1", 0, first, pad, center);
  X.rotate(Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ()));
  const int second = addJoint(hand, "jaw_2", JointType::prismatic, 0, X, Eigen::Vector3d::UnitX(), 0, 0.04);
  addBoxLink(hand, "pad_2", 0, second, pad, center);
  if (coupled) hand.joints[second].mimicOf = first;
  Eigen::VectorXd open(2);
  open << 0.04, 0.04;
  hand.preshapes.push_back({"open", open, 0.0});
  hand.closing.push_back({first, -1, -1, coupled});
  if (!coupled) hand.closing.push_back({second, -1, -1, false});
  return hand;
}

/// Fingers evenly around the palm centre, 45 mm out, each a proximal (40 mm) and a distal box (30 mm) that closes
/// inwards; the distal joint follows at 0.4 times and breaks away.
inline Hand makeFingers(int count) {
  Hand hand;
  hand.name = "toy_fingers";
  addPalm(hand);
  Eigen::VectorXd open = Eigen::VectorXd::Zero(2 * count);
  for (int i = 0; i < count; ++i) {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    X.rotate(Eigen::AngleAxisd(2 * std::numbers::pi * i / count, Eigen::Vector3d::UnitZ()));
    X.translate(Eigen::Vector3d(0.045, 0, 0));
    const std::string name = "finger_" + std::to_string(i + 1);
    const int proximal = addJoint(hand, name, JointType::revolute, 0, X, -Eigen::Vector3d::UnitY(), -0.5, 1.6);
    const int link = addBoxLink(hand, name + "_proximal", 0, proximal, {0.01, 0.012, 0.04}, {0.006, 0, 0.025});
    const int distal =
        addJoint(hand, name + "_distal", JointType::revolute, link,
                 Eigen::Isometry3d(Eigen::Translation3d(0.006, 0, 0.048)), -Eigen::Vector3d::UnitY(), -0.2, 1.5);
    hand.joints[distal].mimicOf = proximal;
    hand.joints[distal].mimicMultiplier = 0.4;
    addBoxLink(hand, name + "_distal", link, distal, {0.008, 0.012, 0.03}, {0, 0, 0.017});
    hand.closing.push_back({proximal, 1, distal, false});
    open[proximal] = -0.3;
  }
  hand.preshapes.push_back({"open", followMimics(hand, open), 0.0});
  return hand;
}

/// Two of these fingers with one drive, that centre themselves.
inline Hand makeCoupledFingers() {
  Hand hand = makeFingers(2);
  hand.name = "toy_coupled_fingers";
  for (std::size_t j = 1; j < hand.joints.size(); ++j) hand.joints[j].mimicOf = 0;
  hand.closing = {{0, 1, -1, true}};
  return hand;
}

inline ObjectModel makeObject(TriangleMesh mesh) {
  return repairObject(std::move(mesh), {1, true, "m"}, "test object");
}

inline ObjectModel boxObject(const Eigen::Vector3d& size, const Eigen::Isometry3d& X = Eigen::Isometry3d::Identity()) {
  TriangleMesh mesh;
  append(mesh, boxMesh(size), X);
  return makeObject(std::move(mesh));
}

inline ObjectModel sphereObject(double radius) { return makeObject(sphereMesh(radius)); }

}  // namespace handhold::testing
