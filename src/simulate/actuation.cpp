#include "simulate/actuation.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

constexpr double kCoupled = 1e-5;  // rad or m: stored positions are 32-bit floats

/// (6 nContacts): the motion of each contact's link at the centre of mass when the joint alone moves by one unit.
Eigen::VectorXd motionOf(const Hand& hand, int index, const Eigen::Isometry3d& X_OP, std::span<const Contact> contacts,
                         const Eigen::Vector3d& centerOfMass) {
  const Joint& joint = hand.joints[index];
  const Eigen::Isometry3d X_OJ = X_OP * joint.X_PJ;
  const Eigen::Vector3d axis = X_OJ.linear() * joint.axis;
  Eigen::Matrix<double, 6, 1> twist = Eigen::Matrix<double, 6, 1>::Zero();
  if (joint.type == JointType::revolute) {
    twist << axis.cross(centerOfMass - X_OJ.translation()), axis;
  } else {
    twist.head<3>() = axis;
  }
  const std::vector<bool> moves = linksMovedBy(hand, index, false);
  Eigen::VectorXd motion = Eigen::VectorXd::Zero(6 * static_cast<Eigen::Index>(contacts.size()));
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    if (moves[contacts[i].link]) motion.segment<6>(6 * static_cast<Eigen::Index>(i)) = twist;
  }
  return motion;
}

bool isOpenClutch(const Hand& hand, int index, const Eigen::VectorXd& q) {
  const Joint& joint = hand.joints[index];
  const bool canOpen = std::any_of(hand.closing.begin(), hand.closing.end(),
                                   [&](const ClosingJoint& closing) { return closing.breakawayJoint == index; });
  return canOpen && std::abs(q[index] - joint.mimicMultiplier * q[joint.mimicOf] - joint.mimicOffset) > kCoupled;
}

}  // namespace

Actuation actuationOf(const Hand& hand, const Eigen::VectorXd& q, const Eigen::Isometry3d& X_OH,
                      std::span<const Contact> contacts, const Eigen::Vector3d& centerOfMass) {
  const std::size_t nJoints = hand.joints.size();
  const std::vector<Eigen::Isometry3d> X_HL = forwardKinematics(hand, q);
  std::vector<Eigen::VectorXd> driven(nJoints), followed(nJoints);  // motions against each joint's effort
  for (std::size_t i = 0; i < nJoints; ++i) {
    const int index = static_cast<int>(i);
    const Eigen::VectorXd own = motionOf(hand, index, X_OH * X_HL[hand.joints[i].parentLink], contacts, centerOfMass);
    double multiplier = 1;
    int driver = index;
    while (hand.joints[driver].mimicOf >= 0 && !isOpenClutch(hand, driver, q)) {
      multiplier *= hand.joints[driver].mimicMultiplier;
      driver = hand.joints[driver].mimicOf;
    }
    if (driver != index) followed[i] = own;
    if (driven[driver].size() == 0) driven[driver] = Eigen::VectorXd::Zero(own.size());
    driven[driver] += multiplier * own;
  }
  Actuation actuation;
  actuation.motion.resize(6 * static_cast<Eigen::Index>(contacts.size()), 0);
  for (std::size_t i = 0; i < nJoints; ++i) {
    for (const Eigen::VectorXd& motion : {driven[i], followed[i]}) {
      if (!(hand.joints[i].effort > 0) || motion.size() == 0 || motion.isZero(0)) continue;
      const Eigen::Index column = actuation.motion.cols();
      actuation.motion.conservativeResize(Eigen::NoChange, column + 1);
      actuation.motion.col(column) = motion;
      actuation.effort.conservativeResize(column + 1);
      actuation.effort[column] = hand.joints[i].effort;
    }
  }
  return actuation;
}

bool hasEffortLimits(const Hand& hand) {
  return std::any_of(hand.joints.begin(), hand.joints.end(), [](const Joint& joint) { return joint.effort > 0; });
}

}  // namespace handhold
