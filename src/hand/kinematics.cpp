#include "hand/mechanism.h"

namespace handhold {

Eigen::VectorXd followMimics(const Mechanism& mechanism, Eigen::VectorXd jointPosition) {
  // A master may itself be a mimic and stand later in the tree: walk each chain to its independent joint.
  for (std::size_t i = 0; i < mechanism.joints.size(); ++i) {
    double multiplier = 1, offset = 0;
    int joint = static_cast<int>(i);
    while (mechanism.joints[joint].mimicOf >= 0) {
      offset += multiplier * mechanism.joints[joint].mimicOffset;
      multiplier *= mechanism.joints[joint].mimicMultiplier;
      joint = mechanism.joints[joint].mimicOf;
    }
    if (joint != static_cast<int>(i)) jointPosition[i] = multiplier * jointPosition[joint] + offset;
  }
  return jointPosition;
}

namespace {

/// From its parent's pose.
void placeLink(const Mechanism& mechanism, std::size_t i, const Eigen::VectorXd& jointPosition,
               std::vector<Eigen::Isometry3d>& X_HL) {
  const Link& link = mechanism.links[i];
  Eigen::Isometry3d X_PL = link.X_PL;
  if (link.joint >= 0) {
    const Joint& joint = mechanism.joints[link.joint];
    const double q = jointPosition[link.joint];
    X_PL = joint.X_PJ;
    if (joint.type == JointType::revolute) {
      X_PL.rotate(Eigen::AngleAxisd(q, joint.axis));
    } else {
      X_PL.translate(q * joint.axis);
    }
  }
  X_HL[i] = X_HL[link.parentLink] * X_PL;
}

}  // namespace

std::vector<Eigen::Isometry3d> forwardKinematics(const Mechanism& mechanism, const Eigen::VectorXd& jointPosition) {
  std::vector<Eigen::Isometry3d> X_HL;
  forwardKinematics(mechanism, jointPosition, X_HL);
  return X_HL;
}

void forwardKinematics(const Mechanism& mechanism, const Eigen::VectorXd& jointPosition,
                       std::vector<Eigen::Isometry3d>& X_HL) {
  X_HL.assign(mechanism.links.size(), Eigen::Isometry3d::Identity());
  for (std::size_t i = 1; i < mechanism.links.size(); ++i) placeLink(mechanism, i, jointPosition, X_HL);
}

void updateKinematics(const Mechanism& mechanism, const Eigen::VectorXd& jointPosition, std::span<const int> links,
                      std::vector<Eigen::Isometry3d>& X_HL) {
  for (const int i : links) placeLink(mechanism, static_cast<std::size_t>(i), jointPosition, X_HL);
}

std::vector<int> independentJoints(const Mechanism& mechanism) {
  std::vector<int> joints;
  for (std::size_t i = 0; i < mechanism.joints.size(); ++i) {
    if (mechanism.joints[i].mimicOf < 0) joints.push_back(static_cast<int>(i));
  }
  return joints;
}

std::vector<int> followersOf(const Mechanism& mechanism, int joint) {
  std::vector<int> result;
  for (std::size_t i = 0; i < mechanism.joints.size(); ++i) {
    int master = mechanism.joints[i].mimicOf;
    while (master >= 0 && master != joint) master = mechanism.joints[master].mimicOf;
    if (master == joint) result.push_back(static_cast<int>(i));
  }
  return result;
}

std::vector<bool> linksMovedBy(const Mechanism& mechanism, int joint, bool withFollowers) {
  std::vector<bool> moves(mechanism.links.size(), false);
  std::vector<bool> isMover(mechanism.joints.size(), false);
  isMover[joint] = true;
  if (withFollowers) {
    for (const int follower : followersOf(mechanism, joint)) isMover[follower] = true;
  }
  for (std::size_t i = 1; i < mechanism.links.size(); ++i) {
    const Link& link = mechanism.links[i];
    moves[i] = moves[link.parentLink] || (link.joint >= 0 && isMover[link.joint]);
  }
  return moves;
}

std::vector<bool> linksMovedBy(const Mechanism& mechanism, const std::vector<int>& joints) {
  std::vector<bool> moves(mechanism.links.size(), false);
  for (const int joint : joints) {
    const std::vector<bool> more = linksMovedBy(mechanism, joint, true);
    for (std::size_t i = 0; i < moves.size(); ++i) moves[i] = moves[i] || more[i];
  }
  return moves;
}

}  // namespace handhold
