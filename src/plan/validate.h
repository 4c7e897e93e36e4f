#pragma once

#include "plan/active_joints.h"
#include "plan/collision_world.h"
#include "plan/motion.h"
#include "rank/grasp_table.h"
#include "robot/inverse_kinematics.h"

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include <Eigen/Geometry>

namespace handhold {

/// Why a grasp does not work here. The names are part of what programs print.
enum class Rejection {
  handCollision,    // the hand meets an obstacle or itself while it comes in or closes
  targetCollision,  // the hand meets the target before it closes, or with a link that may not touch
  unreachable,      // no inverse kinematics at the grasp
  armCollision,     // in every solution the arm meets an obstacle, the target or itself
  approachBroken,   // no solution follows the straight approach
  liftBlocked,      // no solution lifts the target
  noMotion,         // no motion to the pre-grasp was found
  recheckFailed,    // the finer check of the whole motion found a collision
};
inline constexpr std::array<std::string_view, 8> kRejectionNames = {
    "hand_collision",  "target_collision", "unreachable", "arm_collision",
    "approach_broken", "lift_blocked",     "no_motion",   "recheck_failed"};

inline constexpr double kResting = 0.002;  // m, an obstacle that near is what the target stands on

struct ValidationSettings {
  double pregrasp = 0.05;      // m, where the straight approach begins
  double lift = 0.05;          // m, along the world's z; 0: none
  double linearStep = 0.005;   // m, between two poses checked along approach and lift
  int closingSteps = 8;        // postures checked while the fingers close
  double maxJointStep = 0.15;  // rad or m, of a joint between two poses of a straight motion
};

/// The motion around one grasp, in active joints. Straight parts are points of a smooth curve.
struct GraspMotion {
  JointPath approach;  // from the pre-grasp to the grasp, fingers in the preshape
  JointPath close;     // fingers close
  JointPath lift;      // the target in the hand; one point when nothing is to be lifted
};

/// What stands around one arm.
struct ArmSituation {
  Eigen::Isometry3d X_WB;   // root of the robot
  Eigen::Isometry3d X_WA;   // base link of the arm, at the posture
  Eigen::VectorXd posture;  // (J) of the whole robot
  Eigen::Isometry3d X_WO;   // target
};

struct Validation {
  std::optional<GraspMotion> motion;
  Rejection reason = Rejection::unreachable;  // when there is no motion
  std::string detail;                         // who met whom, for --trace
};

/// Tests one stored grasp in the scene: hand along its approach and closing, inverse kinematics, arm, approach and lift
/// (Berenson et al. 2007, II-E). The policy is not simulated again: the target is the object that the set was built
/// with, so the hand ends where it ended there, and what is left to find out is what else it would meet.
/// @note Not thread safe.
class GraspValidator {
 public:
  /// All must outlive it.
  GraspValidator(const Robot& robot, int arm, const CollisionWorld& world, const InverseKinematics& ik,
                 const ArmChain& chain, const ValidationSettings& settings);

  Validation validate(const StoredGrasp& grasp, const ArmSituation& situation) const;

  /// Does the hand come in and stand before the grasp without meeting the target? A few poses are looked at; what the
  /// set calls a clear approach is believed.
  bool wayIsFree(const StoredGrasp& grasp) const;

  /// Only what the paper calls a test: policy in the scene, inverse kinematics, collisions of the arm at the grasp.
  std::optional<Rejection> testOnly(const StoredGrasp& grasp, const ArmSituation& situation) const;

  const ActiveJoints& active() const { return active_; }
  /// (n) m a rad: how far a point of the robot can be from the axis of each active joint (or 1 for prismatic ones).
  const Eigen::VectorXd& reach() const { return reach_; }
  /// Links of the whole robot in W.
  std::vector<Eigen::Isometry3d> linkPoses(const Eigen::VectorXd& q, const ArmSituation& situation) const;

 private:
  std::optional<Touch> handOnItsWay(const StoredGrasp& grasp, const ArmSituation& situation) const;
  Eigen::Isometry3d tipPose(const Eigen::Isometry3d& X_OH, const ArmSituation& situation) const;
  Eigen::VectorXd armOf(const Eigen::VectorXd& posture) const;
  bool addApproach(const StoredGrasp& grasp, const ArmSituation& situation, const Eigen::VectorXd& qGrasp,
                   GraspMotion& motion, Validation& result) const;
  bool addLift(const StoredGrasp& grasp, const ArmSituation& situation, GraspMotion& motion, Validation& result) const;

  const Robot& robot_;
  const Arm& arm_;
  int armIndex_;
  const CollisionWorld& world_;
  const InverseKinematics& ik_;
  const ArmChain& chain_;
  ValidationSettings settings_;
  ActiveJoints active_;
  Eigen::VectorXd reach_;
};

}  // namespace handhold
