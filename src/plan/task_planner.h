#pragma once

#include "plan/planner.h"
#include "plan/task.h"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// How hard is looked for what a task needs. Every bound is a count: equal tasks have equal answers.
struct TaskOptions {
  ValidationSettings validation = {};
  ScoreKind score = ScoreKind::paper;  // order of the grasps
  std::uint64_t seed = 1;
  int poses = 60'000;               // of an object carried or handed over, asked for inverse kinematics, for each grasp
  int closerLooks = 2500;           // of these, asked for collisions
  int maxChecksPerMotion = 60'000;  // postures asked for while one motion is searched
  int maxChains = 20;               // ways to do a task whose motions were not found, before giving up
};

/// A stretch in which one arm moves and the others stand.
struct TaskMotion {
  int arm = 0;
  std::vector<std::string> jointNames;
  /// Segments: transit, approach, close, lift; carry, lower, open, retreat, return; or carry, drop, return.
  Trajectory trajectory;
  Eigen::VectorXd posture;             // (J) of the whole robot at the beginning
  Eigen::Isometry3d X_WO, X_WO_after;  // the object before and after; dropped: where it was let go
};

/// A step that was done, or why the ways to do it that were looked at failed.
struct TaskStepResult {
  int arm = -1;                                 // that holds the object after a pick or hand over, and else before
  std::uint32_t grasp = 0;                      // row of the set of that arm's hand
  std::array<std::uint32_t, 3> trial{};         // of the grasp
  std::vector<TaskMotion> motions;              // in the order of time
  std::map<std::string, std::size_t> rejected;  // by kRejectionNames

  double seconds() const;  // of all motions
};

struct TaskResult {
  bool done = false;
  /// Was there, for each object, a grasp for every step with all its goals? Not done, but feasible: no motions.
  bool feasible = false;
  std::string reason;                 // in words, when not done
  std::vector<TaskStepResult> steps;  // as in the task
  std::uint64_t checks = 0;           // postures asked
};

/// Plans tasks with the arms of one robot: for each object, the grasps of the pick in the order of the score; one is
/// taken when poses and grasps are found for all that follows until the object is put down or dropped, and motions for
/// all of it. Putting down is picking up backwards, so is letting go. One arm moves at a time; it returns to where it
/// stood when its hand is empty. Every motion passes findFault (check_plan.h).
/// @note Not thread safe.
class TaskPlanner {
 public:
  /// @param planner  ranks and holds sets; must outlive this; its scene changes
  explicit TaskPlanner(Planner& planner, const TaskOptions& options = {});
  ~TaskPlanner();

  /// @throws InputError  no set of an object with the hands of its arms
  TaskResult plan(const Task& task);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// `task --out` (docs/tasks.md). @param source  written too, if not null
std::string taskJson(const Task& task, const Robot& robot, const TaskResult& result, bool pretty,
                     const PlanSource* source = nullptr);

}  // namespace handhold
