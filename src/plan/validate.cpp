#include "plan/validate.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kReadyBack = 0.001;      // m before the grasp: the last of the way in belongs to closing
constexpr double kReadySideways = 0.002;  // m off what the hand will lean on

/// A pose of the hand root at a distance before the grasp, the hand still off what it will touch.
Isometry3d handBefore(const StoredGrasp& grasp, double distance) {
  return Eigen::Translation3d(kReadySideways * grasp.sideways - (kReadyBack + distance) * grasp.approach) * grasp.X_OH;
}

/// How far points of the links below `link` can be from its origin, whatever the joints do.
double reachBelow(const Mechanism& body, int link) {
  double reach = 0;
  for (const Vector3d& p : body.links[link].mesh.vertices) reach = std::max(reach, p.norm());
  for (std::size_t i = 1; i < body.links.size(); ++i) {
    const Link& child = body.links[i];
    if (child.parentLink != link) continue;
    double offset = child.X_PL.translation().norm();
    if (child.joint >= 0) {
      const Joint& joint = body.joints[child.joint];
      offset = joint.X_PJ.translation().norm();
      if (joint.type == JointType::prismatic) offset += std::max(std::abs(joint.lower), std::abs(joint.upper));
    }
    reach = std::max(reach, offset + reachBelow(body, static_cast<int>(i)));
  }
  return reach;
}

double reachOf(const Mechanism& body, int joint) {
  return body.joints[joint].type == JointType::prismatic ? 1 : reachBelow(body, body.joints[joint].childLink);
}

std::vector<Isometry3d> moved(const Isometry3d& X_WH, std::vector<Isometry3d> X_HL) {
  for (Isometry3d& X : X_HL) X = X_WH * X;
  return X_HL;
}

std::string inWords(const Touch& touch, std::string_view when) {
  return fmt::format("{} meets {} {}", touch.first, touch.second, when);
}

}  // namespace

GraspValidator::GraspValidator(const Robot& robot, int arm, const CollisionWorld& world, const InverseKinematics& ik,
                               const ArmChain& chain, const ValidationSettings& settings)
    : robot_(robot),
      arm_(robot.arms[arm]),
      armIndex_(arm),
      world_(world),
      ik_(ik),
      chain_(chain),
      settings_(settings),
      active_(robot, arm),
      reach_(active_.size()) {
  for (Eigen::Index i = 0; i < active_.size(); ++i) {
    const int joint = active_.joints()[i];
    reach_[i] = reachOf(robot.body, joint);
    for (const int follower : followersOf(robot.body, joint)) {
      reach_[i] += std::abs(robot.body.joints[follower].mimicMultiplier) * reachOf(robot.body, follower);
    }
  }
}

std::vector<Isometry3d> GraspValidator::linkPoses(const VectorXd& q, const ArmSituation& situation) const {
  return moved(situation.X_WB, forwardKinematics(robot_.body, active_.posture(q, situation.posture)));
}

/// The hand alone: its last posture first, where most collisions are.
std::optional<Touch> GraspValidator::handOnItsWay(const StoredGrasp& grasp, const ArmSituation& situation) const {
  const Isometry3d X_WH = situation.X_WO * grasp.X_OH;
  const auto touches = [&](const Isometry3d& X, const VectorXd& q, TargetRule rule) {
    return world_.handTouches(armIndex_, moved(X, forwardKinematics(arm_.hand, q)), situation.X_WO, rule, 0);
  };
  if (auto touch = touches(X_WH, grasp.finalPosition, TargetRule::contact)) return touch;
  const int steps = std::max(1, static_cast<int>(std::ceil(settings_.pregrasp / settings_.linearStep)));
  for (int i = steps; i >= 0; --i) {
    const Isometry3d X = situation.X_WO * handBefore(grasp, settings_.pregrasp * i / steps);
    if (auto touch = touches(X, grasp.preshapePosition, TargetRule::avoid)) return touch;
  }
  for (int i = 0; i < settings_.closingSteps; ++i) {
    const VectorXd q =
        grasp.preshapePosition + (grasp.finalPosition - grasp.preshapePosition) * i / settings_.closingSteps;
    if (auto touch = touches(X_WH, q, TargetRule::contact)) return touch;
  }
  return std::nullopt;
}

bool GraspValidator::wayIsFree(const StoredGrasp& grasp) const {
  if (grasp.approachClear) return true;
  const std::vector<Isometry3d> X_HL = forwardKinematics(arm_.hand, grasp.preshapePosition);
  constexpr int kPoses = 3;
  for (int i = 0; i <= kPoses; ++i) {
    if (world_.handMeetsTarget(armIndex_, moved(handBefore(grasp, settings_.pregrasp * i / kPoses), X_HL)))
      return false;
  }
  return true;
}

std::optional<Rejection> GraspValidator::testOnly(const StoredGrasp& grasp, const ArmSituation& situation) const {
  if (const auto touch = handOnItsWay(grasp, situation)) {
    return touch->ofTarget ? Rejection::targetCollision : Rejection::handCollision;
  }
  std::vector<VectorXd> solutions;
  ik_.solve(tipPose(grasp.X_OH, situation), armOf(situation.posture), solutions);
  if (solutions.empty()) return Rejection::unreachable;
  const bool isFree = std::any_of(solutions.begin(), solutions.end(), [&](const VectorXd& q) {
    return !world_.robotTouches(armIndex_, linkPoses(active_.join(q, grasp.finalPosition), situation), situation.X_WO,
                                TargetRule::contact, 0);
  });
  return isFree ? std::nullopt : std::optional(Rejection::armCollision);
}

Isometry3d GraspValidator::tipPose(const Isometry3d& X_OH, const ArmSituation& situation) const {
  return situation.X_WA.inverse() * situation.X_WO * X_OH * arm_.X_TH.inverse();
}

VectorXd GraspValidator::armOf(const VectorXd& posture) const { return active_.pick(posture).head(active_.armSize()); }

bool GraspValidator::addApproach(const StoredGrasp& grasp, const ArmSituation& situation, const VectorXd& qGrasp,
                                 GraspMotion& motion, Validation& result) const {
  const auto touches = [&](const VectorXd& q, TargetRule rule, double margin, std::string_view when) {
    const auto touch = world_.robotTouches(armIndex_, linkPoses(q, situation), situation.X_WO, rule, margin);
    if (touch) result.detail = inWords(*touch, when);
    return touch.has_value();
  };
  const VectorXd closed = active_.join(qGrasp, grasp.finalPosition),
                 open = active_.join(qGrasp, grasp.preshapePosition);
  result.reason = Rejection::armCollision;
  if (touches(closed, TargetRule::contact, 0, "at the grasp") || touches(open, TargetRule::contact, 0, "at the grasp"))
    return false;
  VectorXd q = qGrasp;
  const int steps = std::max(1, static_cast<int>(std::ceil(settings_.pregrasp / settings_.linearStep)));
  for (int i = 0; i <= steps; ++i) {
    const double back = settings_.pregrasp * i / steps;
    if (!followTip(chain_, tipPose(handBefore(grasp, back), situation), settings_.maxJointStep, {}, q)) {
      result.reason = Rejection::approachBroken;
      result.detail = fmt::format("no solution follows {:.0f} mm before the grasp", 1000 * back);
      return false;
    }
    motion.approach.push_back(active_.join(q, grasp.preshapePosition));
    const bool last = i == steps;
    if (touches(motion.approach.back(), TargetRule::avoid, last ? robot_.clearance : 0,
                last ? "within the clearance at the pre-grasp" : "on the approach"))
      return false;
  }
  std::reverse(motion.approach.begin(), motion.approach.end());
  motion.close = {motion.approach.back(), open, closed};
  return true;
}

bool GraspValidator::addLift(const StoredGrasp& grasp, const ArmSituation& situation, GraspMotion& motion,
                             Validation& result) const {
  motion.lift = {motion.close.back()};
  if (settings_.lift <= 0) return true;
  std::vector<bool> allowed = world_.obstaclesNearTarget(situation.X_WO, kResting);
  result.reason = Rejection::liftBlocked;
  VectorXd q = motion.lift.back().head(active_.armSize());
  const int steps = std::max(1, static_cast<int>(std::ceil(settings_.lift / settings_.linearStep)));
  for (int i = 1; i <= steps; ++i) {
    ArmSituation lifted = situation;
    lifted.X_WO = Eigen::Translation3d(0, 0, settings_.lift * i / steps) * situation.X_WO;
    if (!followTip(chain_, tipPose(grasp.X_OH, lifted), settings_.maxJointStep, {}, q)) {
      result.detail = fmt::format("no solution follows {:.0f} mm up", 1000 * settings_.lift * i / steps);
      return false;
    }
    motion.lift.push_back(active_.join(q, grasp.finalPosition));
    const std::vector<Isometry3d> X_WL = linkPoses(motion.lift.back(), situation);
    auto touch = world_.robotTouches(armIndex_, X_WL, lifted.X_WO, TargetRule::ignore, 0);
    if (!touch) touch = world_.targetTouches(armIndex_, X_WL, lifted.X_WO, allowed);
    if (touch) {
      result.detail = inWords(*touch, "while lifting");
      return false;
    }
    // What the target has left it may not meet again.
    const std::vector<bool> near = world_.obstaclesNearTarget(lifted.X_WO, 0);
    std::transform(allowed.begin(), allowed.end(), near.begin(), allowed.begin(), std::logical_and<>());
  }
  return true;
}

Validation GraspValidator::validate(const StoredGrasp& grasp, const ArmSituation& situation) const {
  Validation result;
  if (const auto touch = handOnItsWay(grasp, situation)) {
    result.reason = touch->ofTarget ? Rejection::targetCollision : Rejection::handCollision;
    result.detail = inWords(*touch, "as the hand comes in and closes");
    return result;
  }
  std::vector<VectorXd> solutions;
  ik_.solve(tipPose(grasp.X_OH, situation), armOf(situation.posture), solutions);
  result.detail = "no inverse kinematics";
  // The solution that came farthest gives the reason.
  for (const VectorXd& q : solutions) {
    GraspMotion motion;
    Validation attempt;
    if (addApproach(grasp, situation, q, motion, attempt) && addLift(grasp, situation, motion, attempt)) {
      attempt.motion = std::move(motion);
      return attempt;
    }
    if (attempt.reason >= result.reason) result = std::move(attempt);
  }
  return result;
}

}  // namespace handhold
