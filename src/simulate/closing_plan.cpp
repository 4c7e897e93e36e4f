#include "simulate/closing_plan.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace handhold {

using Eigen::Isometry3d;
using Eigen::Vector3d;

Isometry3d palmPose(const Vector3d& position, const Vector3d& approach, double roll) {
  constexpr double kNearlyVertical = 0.9;  // |cosine| to the z axis
  const Vector3d up = std::abs(approach.z()) < kNearlyVertical ? Vector3d::UnitZ() : Vector3d::UnitX();
  const Vector3d reference = (up - up.dot(approach) * approach).normalized();
  const Vector3d side = approach.cross(reference);
  Isometry3d X_OG = Isometry3d::Identity();
  X_OG.linear().col(0) = std::cos(roll) * reference + std::sin(roll) * side;
  X_OG.linear().col(1) = approach.cross(X_OG.linear().col(0));
  X_OG.linear().col(2) = approach;
  X_OG.translation() = position;
  return X_OG;
}

namespace {

Mover makeMover(const Hand& hand, int joint, int direction, bool withFollowers) {
  Mover mover{joint, direction, {}, {}, {}};
  if (withFollowers) mover.followers = followersOf(hand, joint);
  const std::vector<bool> moves = linksMovedBy(hand, joint, withFollowers);
  for (const int link : solidLinks(hand)) {
    if (moves[link]) mover.links.push_back(link);
  }
  for (std::size_t i = 0; i < moves.size(); ++i) {
    if (moves[i]) mover.moved.push_back(static_cast<int>(i));
  }
  return mover;
}

}  // namespace

std::vector<int> solidLinks(const Hand& hand) {
  std::vector<int> links;
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    if (!hand.links[i].mesh.triangles.empty()) links.push_back(static_cast<int>(i));
  }
  return links;
}

std::vector<std::pair<int, int>> pairsThatMove(const Hand& hand) {
  std::vector<bool> closes(hand.joints.size(), false);
  for (const ClosingJoint& closing : hand.closing) {
    closes[closing.joint] = true;
    for (const int follower : followersOf(hand, closing.joint)) closes[follower] = true;
    if (closing.breakawayJoint >= 0) closes[closing.breakawayJoint] = true;
  }
  const auto closingJointsOf = [&](int link) {  // between the root and the link
    std::vector<int> joints;
    for (int i = link; i >= 0; i = hand.links[i].parentLink) {
      const int joint = hand.links[i].joint;
      if (joint >= 0 && closes[joint]) joints.push_back(joint);
    }
    return joints;
  };
  const std::vector<int> links = solidLinks(hand);
  std::vector<std::pair<int, int>> pairs;
  for (std::size_t i = 0; i < links.size(); ++i) {
    for (std::size_t j = i + 1; j < links.size(); ++j) {
      if (closingJointsOf(links[i]) != closingJointsOf(links[j])) pairs.emplace_back(links[i], links[j]);
    }
  }
  return pairs;
}

ClosingStep makeClosingStep(const Hand& hand, const ClosingJoint& closing) {
  ClosingStep step;
  step.together = makeMover(hand, closing.joint, closing.direction, true);
  const bool isSingle = step.together.followers.empty(), isPair = isSlidingPair(hand, closing.joint);
  step.selfCentering = closing.selfCentering && (isSingle || isPair);
  if (step.selfCentering && isSingle) {
    const std::vector<bool> moves = linksMovedBy(hand, closing.joint, true);
    const std::vector<int> solid = solidLinks(hand);
    std::copy_if(solid.begin(), solid.end(), std::back_inserter(step.fixedLinks),
                 [&](int link) { return !moves[link]; });
  } else if (step.selfCentering) {
    const int follower = step.together.followers[0];
    const int sign = hand.joints[follower].mimicMultiplier > 0 ? 1 : -1;
    step.alone = makeMover(hand, closing.joint, closing.direction, false);
    step.follower = makeMover(hand, follower, sign * closing.direction, false);
  }
  if (closing.breakawayJoint >= 0) {
    const int sign = hand.joints[closing.breakawayJoint].mimicMultiplier > 0 ? 1 : -1;
    step.breakaway = makeMover(hand, closing.breakawayJoint, sign * closing.direction, false);
  }
  return step;
}

Vector3d centerJaws(const Hand& hand, const ClosingStep& step, Eigen::VectorXd& q) {
  const Joint& joint = hand.joints[step.alone.joint];
  const Joint& other = hand.joints[step.follower.joint];
  const double first = q[step.alone.joint];
  const double second = (q[step.follower.joint] - other.mimicOffset) / other.mimicMultiplier;
  const double centered = 0.5 * (first + second);
  const Isometry3d X_HP = forwardKinematics(hand, q)[joint.parentLink];
  place(hand, step.together, centered, q);
  return (first - centered) * (X_HP.linear() * (joint.X_PJ.linear() * joint.axis));
}

void place(const Hand& hand, const Mover& mover, double position, Eigen::VectorXd& q) {
  q[mover.joint] = position;
  for (const int follower : mover.followers) {
    const Joint& joint = hand.joints[follower];
    q[follower] = std::clamp(joint.mimicMultiplier * q[joint.mimicOf] + joint.mimicOffset, joint.lower, joint.upper);
  }
}

}  // namespace handhold
