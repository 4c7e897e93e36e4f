#include "plan/active_joints.h"

#include <algorithm>

namespace handhold {

ActiveJoints::ActiveJoints(const Robot& robot, int arm)
    : robot_(robot),
      arm_(robot.arms[arm]),
      armSize_(static_cast<Eigen::Index>(arm_.joints.size())),
      joints_(arm_.joints),
      inHand_(fixingJoints(arm_.hand)) {
  for (const int joint : inHand_) joints_.push_back(arm_.handJoints[joint]);
}

std::vector<std::string> ActiveJoints::names() const {
  std::vector<std::string> names;
  for (const int joint : joints_) names.push_back(robot_.body.joints[joint].name);
  return names;
}

Eigen::VectorXd ActiveJoints::pick(const Eigen::VectorXd& posture) const {
  Eigen::VectorXd q(size());
  for (Eigen::Index i = 0; i < size(); ++i) q[i] = posture[joints_[i]];
  return q;
}

Eigen::VectorXd ActiveJoints::posture(const Eigen::VectorXd& q, const Eigen::VectorXd& rest) const {
  Eigen::VectorXd result = rest;
  for (Eigen::Index i = 0; i < size(); ++i) result[joints_[i]] = q[i];
  // Followers of the hand only: a breakaway joint has its own value.
  for (std::size_t i = 0; i < arm_.hand.joints.size(); ++i) {
    const Joint& joint = arm_.hand.joints[i];
    if (joint.mimicOf < 0 || std::find(inHand_.begin(), inHand_.end(), static_cast<int>(i)) != inHand_.end()) continue;
    result[arm_.handJoints[i]] = joint.mimicMultiplier * result[arm_.handJoints[joint.mimicOf]] + joint.mimicOffset;
  }
  return result;
}

Eigen::VectorXd ActiveJoints::join(const Eigen::VectorXd& arm, const Eigen::VectorXd& handPosition) const {
  Eigen::VectorXd q(size());
  q.head(armSize_) = arm;
  for (std::size_t i = 0; i < inHand_.size(); ++i)
    q[armSize_ + static_cast<Eigen::Index>(i)] = handPosition[inHand_[i]];
  return q;
}

Eigen::VectorXd ActiveJoints::handPosition(const Eigen::VectorXd& posture) const {
  Eigen::VectorXd q(static_cast<Eigen::Index>(arm_.handJoints.size()));
  for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = posture[arm_.handJoints[i]];
  return q;
}

Eigen::VectorXd ActiveJoints::lower() const {
  Eigen::VectorXd q(size());
  for (Eigen::Index i = 0; i < size(); ++i) q[i] = robot_.body.joints[joints_[i]].lower;
  return q;
}

Eigen::VectorXd ActiveJoints::upper() const {
  Eigen::VectorXd q(size());
  for (Eigen::Index i = 0; i < size(); ++i) q[i] = robot_.body.joints[joints_[i]].upper;
  return q;
}

}  // namespace handhold
