#pragma once

#include "robot/robot.h"
#include "scene/scene.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Two things that are closer than they may be.
struct Touch {
  std::string first, second;  // names: a link of the robot or the target, then a link, an obstacle or the target
  bool ofTarget = false;      // a link and the target
};

/// How a posture may stand to the target.
enum class TargetRule {
  avoid,    // like an obstacle
  contact,  // the hand's contact links may touch it
  ignore,   // not looked at
};

/// Robot, obstacles and target as exact triangles (FCL), with containment: inside a closed surface counts as touching.
/// One posture is one question; nothing is remembered between them but how many were asked.
/// @note Not thread safe: one world a thread.
class CollisionWorld {
 public:
  /// `robot` must outlive it.
  explicit CollisionWorld(const Robot& robot);
  ~CollisionWorld();
  CollisionWorld(CollisionWorld&&) noexcept;
  CollisionWorld& operator=(CollisionWorld&&) noexcept;

  /// Obstacles in their present poses; shapes known from before are not built again.
  void setObstacles(const std::vector<Obstacle>& obstacles);
  void setTarget(const TriangleMesh& mesh, bool watertight, const std::string& name);

  /// `margin` is kept to everything but between hand and target, where 1 mm is enough, and between the robot's own
  /// links, where it is 0.

  /// Hand alone, links of the hand at X_WL: against obstacles, the target and, between links apart in its preshapes,
  /// itself. @param X_WL  by link of the arm's hand
  std::optional<Touch> handTouches(int arm, const std::vector<Eigen::Isometry3d>& X_WL, const Eigen::Isometry3d& X_WO,
                                   TargetRule rule, double margin) const;

  /// Does a link of the hand meet the target? @param X_OL  by link of the arm's hand, in the target's frame
  bool handMeetsTarget(int arm, const std::vector<Eigen::Isometry3d>& X_OL) const;

  /// The whole robot, links at X_WL: the links that the arm and its hand move against obstacles, target, each other and
  /// the rest of the robot. @param X_WL  by link of the robot
  std::optional<Touch> robotTouches(int arm, const std::vector<Eigen::Isometry3d>& X_WL, const Eigen::Isometry3d& X_WO,
                                    TargetRule rule, double margin) const;

  /// The target where the hand carries it, against the obstacles that are not in `allowed`, and against the robot
  /// without the hand's contact links. @param allowed  by obstacle: may be touched
  /// @param margin  m, to all but the links of the hand that holds it
  std::optional<Touch> targetTouches(int arm, const std::vector<Eigen::Isometry3d>& X_WL, const Eigen::Isometry3d& X_WO,
                                     const std::vector<bool>& allowed, double margin = 0) const;
  /// Do the hands of two arms overlap? @param X_L  by link of the arm's hand, in a common frame
  bool handsTouch(int arm, const std::vector<Eigen::Isometry3d>& X_L, int otherArm,
                  const std::vector<Eigen::Isometry3d>& X_otherL) const;
  /// By obstacle: is the target closer to it than `margin`?
  std::vector<bool> obstaclesNearTarget(const Eigen::Isometry3d& X_WO, double margin) const;

  /// The robot's links that arm `arm` and its hand move.
  const std::vector<bool>& movedLinks(int arm) const;

  std::uint64_t checks() const { return checks_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  mutable std::uint64_t checks_ = 0;
};

}  // namespace handhold
