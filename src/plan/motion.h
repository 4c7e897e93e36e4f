#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace handhold {

using JointPath = std::vector<Eigen::VectorXd>;  // joint positions, straight lines in between

/// Joint space as the motion planner sees it.
struct MotionSpace {
  Eigen::VectorXd lower, upper;  // (n) rad or m; a joint without limits goes once around from start and goal
  /// (n) m a rad (or 1): no point of the robot moves farther than sum_j reach_j |dq_j|.
  Eigen::VectorXd reach;
  std::function<bool(const Eigen::VectorXd&)> isFree;
};

struct MotionSettings {
  std::uint64_t seed = 1;
  int maxChecks = 60'000;      // of postures, for one motion
  double coarseStep = 0.03;    // m, of any point of the robot, between two postures checked while searching
  double fineStep = 0.008;     // m, in the motion that is returned
  int shortcuts = 60;          // tries
  std::function<bool()> stop;  // an emergency brake, asked between checks; none: never
};

/// A free motion from `start` to `goal`: RRT-Connect (Kuffner and LaValle 2000; OMPL), then shortcuts. Equal questions
/// give equal motions: the samples come from a stream keyed by the seed, the search ends by the number of checks.
/// @return none: not found within the checks, or stopped
std::optional<JointPath> planMotion(const MotionSpace& space, const Eigen::VectorXd& start, const Eigen::VectorXd& goal,
                                    const MotionSettings& settings);

/// Are all postures on the straight line free, no point moving farther than `step` [m] between two of them? The end
/// points are not asked.
bool lineIsFree(const MotionSpace& space, const Eigen::VectorXd& a, const Eigen::VectorXd& b, double step);

}  // namespace handhold
