#pragma once

#include "plan/trajectory.h"
#include "robot/robot.h"
#include "scene/scene.h"

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A trajectory with all that it has to be held against.
struct CheckedMotion {
  const Robot* robot = nullptr;
  int arm = 0;
  /// Segments: transit, approach, close and, when it lifts, lift. With the target in the hand at the start: carry,
  /// lower, open, retreat, return, of which any may be missing; drop instead of open when the target falls.
  const Trajectory* trajectory = nullptr;
  std::vector<int> joints;  // of the robot's body, by column of the trajectory
  Eigen::VectorXd posture;  // (J) where the robot stands
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  const std::vector<Obstacle>* obstacles = nullptr;
  const TriangleMesh* target = nullptr;
  bool targetWatertight = false;
  Eigen::Isometry3d X_WO = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d X_OH = Eigen::Isometry3d::Identity();  // the stored grasp
  Eigen::VectorXd finalPosition;                           // (J of the hand) of the stored grasp
  bool holds = false;                                      // the hand is at the stored grasp at the start, not at rest
  std::optional<Eigen::Isometry3d> X_WO_after;             // where the target is said to be left; none: not said
};

struct CheckSteps {
  double linear = 0.001;                   // m, of a prismatic joint between two postures looked at
  double angular = 0.0034906585039886593;  // rad, 0.2 degrees, of a revolute one
};

/// Holds a finished motion against its promises, by means that the planner does not use: surfaces meet where an edge of
/// the one passes through the other (rays, Embree), not where FCL's trees say so.
///
/// - begins at the posture, stays within position, velocity and acceleration limits, rests at its end
/// - at the end of `close`, or at the start when it holds the target, the hand is at the stored grasp (1e-4 m, 1e-3
/// rad)
///   with its fingers in the stored posture
/// - no link meets an obstacle, another link or the target; allowed are neighbours and robot.yaml's pairs, links of the
///   hand that already meet where the approach ends (or at the start), the hand's contact links and the target from
///   `close` on and until it is let go
/// - in lift, carry and lower the target moves with the hand and meets no link that stands still and no obstacle but,
///   until a lift has left it or from where a lower comes to it, what it stands on; a target that was dropped is gone
/// - the target ends where it is said to (1e-4 m, 1e-3 rad)
///
/// @return  what is wrong, with the time; none: nothing
std::optional<std::string> findFault(const CheckedMotion& motion, const CheckSteps& steps = {});

}  // namespace handhold
