#pragma once

#include "build/robustness.h"
#include "physics/recorded_trials.h"
#include "store/hold_calibration.h"

#include <atomic>
#include <cstdint>
#include <numbers>
#include <optional>
#include <vector>

namespace handhold {

/// A grasp with what its probability of holding is estimated from, and what came true.
struct LabelledGrasp {
  bool stored = false;  // else drawn from the trials, whatever came of them
  HoldFeatures features{};
  bool held = false;  // in all six directions of the pull
};

/// For the robustness of every drawn grasp, whatever the job asks for, so that hands and jobs compare.
inline constexpr PoseNoise kCalibrationNoise{0.003, 3 * std::numbers::pi / 180, 50};

/// Draws grasps of a set as the groups `stored` and `trials` are drawn, computes their features, simulates the pull.
///
/// A stored grasp has its own columns epsilon and critical friction. For a trial both are computed as a build does: its
/// epsilon is 0 when it is not force closed at the set's friction, its critical friction the least at which it is, at
/// most the larger of the set's and the simulated friction. Load margin and robustness are computed for all by
/// evaluateLoad and forceClosureUnderNoise: few grasps of a set have them stored. What could not be computed counts as
/// not closed: 0, and the largest friction.
/// Results do not depend on the number of threads.
class GraspLabeller {
 public:
  /// @param count  of stored grasps (all when there are fewer), and of trials
  /// @return  stored grasps first; nothing when `cancel` became true
  std::optional<std::vector<LabelledGrasp>> label(const SimulatedSet& set, std::size_t count, std::uint64_t seed,
                                                  const JobSystem& jobs, const std::atomic<bool>& cancel);

 private:
  HandFieldsCache fields_;
};

}  // namespace handhold
