#pragma once

#include "rank/link_clearance.h"
#include "rank/score.h"
#include "robot/inverse_kinematics.h"

#include <memory>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// What the reach score knows of where an arm stands.
struct ReachArm {
  Eigen::Isometry3d X_WB;                 // root of the robot
  Eigen::Isometry3d X_WA;                 // base of the arm
  const InverseKinematics* ik = nullptr;  // of the arm
  Eigen::VectorXd posture;                // (J) of the whole robot, at present
};

struct ReachSettings {
  double pregrasp = 0.05;   // m, before the grasp along the approach
  double far = 0.03;        // m, clearance beyond it counts no more
  double spacing = 0.012;   // m, between points of the hand
  int numericChecks = 256;  // grasps whose inverse kinematics is asked for where there is no closed form
};

/// What a better engineer would use than the paper's approximations:
///
///     G = 4 Gb + (Gq + 2 Ge) / 3  when Ge > 0, else Gq / 1000                                                   (1)
///
/// Gb: inverse kinematics has a solution at the grasp and one near it at the pre-grasp (1), at the grasp alone (1/2),
/// has none (0). Without a closed form it is asked for the best `numericChecks` grasps by the other terms; the rest
/// have 1/2. Ge: the least distance to obstacles of the whole hand, swept from pre-grasp to grasp and in its final
/// posture, and of the arm in the best of its solutions, in parts of `far`; 0 where it reaches into one, or the arm
/// into the rest of the robot. No grasp is left out: those that fail stand at the end.
/// @note Const; safe from many threads.
class ReachScorer {
 public:
  /// `robot` must outlive it.
  ReachScorer(const Robot& robot, int arm, const ReachSettings& settings = {});

  /// Appends one score for every grasp, in the table's order. @param wayIsFree  by grasp: the hand comes in without
  /// meeting the target, which no scene changes
  void score(const GraspTable& table, const std::vector<bool>& wayIsFree, const ReachArm& arm,
             const Eigen::Isometry3d& X_WO, const std::vector<ObstacleDistance>& obstacles,
             std::vector<GraspScore>& scores) const;

 private:
  struct Reached;
  /// A link that the arm does not move, and the arm's links that may not meet it.
  struct OwnObstacle {
    int link = 0;
    std::shared_ptr<const SignedDistance> distance;
    LinkClearance links;
  };
  double armClearance(const ReachArm& arm, const Eigen::VectorXd& q,
                      const std::vector<ObstacleDistance>& obstacles) const;
  double sweptClearance(const StoredGrasp& grasp, const Eigen::Isometry3d& X_WO,
                        const std::vector<ObstacleDistance>& obstacles) const;
  Reached reach(const StoredGrasp& grasp, const ReachArm& arm, const Eigen::Isometry3d& X_WO,
                const std::vector<ObstacleDistance>& obstacles) const;

  const Robot& robot_;
  int armIndex_;
  const Arm& arm_;
  ReachSettings settings_;
  LinkClearance hand_, links_;  // the hand alone, and the arm's moving links without it
  std::vector<OwnObstacle> own_;
};

}  // namespace handhold
