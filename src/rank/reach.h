#pragma once

#include "rank/hand_clearance.h"
#include "rank/score.h"
#include "robot/inverse_kinematics.h"

#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// One arm as the reach score sees it.
struct ReachArm {
  int arm = 0;
  Eigen::Isometry3d X_WA;  // base of the arm
  Eigen::Isometry3d X_TH;  // hand root in the tip link
  const InverseKinematics* ik = nullptr;
  Eigen::VectorXd posture;  // (n) present joint positions
};

struct ReachSettings {
  double pregrasp = 0.05;   // m, before the grasp along the approach
  double far = 0.03;        // m, clearance beyond it counts no more
  double spacing = 0.012;   // m, between points of the hand
  int numericChecks = 256;  // grasps whose inverse kinematics is asked for where there is no closed form
};

/// What a better engineer would use than the paper's approximations:
///
///     G = 4 Gb + (c1 Gq + c3 Ge) / (c1 + c3)  when Ge > 0, else Gq / 1000                                       (1)
///
/// Gb: inverse kinematics has a solution at the grasp and one near it at the pre-grasp (1), has none (0). Without a
/// closed form it is asked for the best `numericChecks` grasps by the other terms alone; the rest have 0.5.
/// Ge: the least distance of the whole hand to obstacles, swept from pre-grasp to grasp and in its final posture, in
/// parts of `far`, 0 where it reaches into one. No grasp is left out: those that fail stand at the end.
/// @note Const; safe from many threads.
class ReachScorer {
 public:
  explicit ReachScorer(const Hand& hand, const ReachSettings& settings = {});

  /// Appends one score for every grasp, in the table's order.
  void score(const GraspTable& table, const ReachArm& arm, const Eigen::Isometry3d& X_WO,
             const std::vector<ObstacleDistance>& obstacles, const ScoreCoefficients& coefficients,
             std::vector<GraspScore>& scores) const;

 private:
  double sweptClearance(const StoredGrasp& grasp, const Eigen::Isometry3d& X_WO,
                        const std::vector<ObstacleDistance>& obstacles) const;

  const Hand& hand_;
  ReachSettings settings_;
  HandClearance clearance_;
};

}  // namespace handhold
