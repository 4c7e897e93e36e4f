#pragma once

#include "build/progress.h"
#include "core/job_system.h"
#include "physics/simulated_set.h"
#include "store/physics_set.h"

#include <atomic>
#include <optional>
#include <vector>

namespace handhold {

/// What is to be simulated of a set.
struct LabelRequest {
  std::vector<PhysicsTest> tests = {PhysicsTest::pull};
  std::optional<std::size_t> top;  // the best so many; default: all
};

/// The simulator and its settings, a line each.
std::string protocolText(const PhysicsSettings& settings);

/// Everything that a result depends on beside the set, as PhysicsSet::settings.
std::string settingsText(const SimulatedSet& set, const std::vector<PhysicsTest>& tests);

/// The results of no grasp yet.
PhysicsSet emptyPhysics(const SimulatedSet& set, const std::vector<PhysicsTest>& tests);

/// Adds a grasp, whose row must be larger than those before it.
void addResults(std::uint32_t row, const std::vector<TestResult>& results, PhysicsSet& physics);

/// Simulates the best grasps of a set on all threads of `jobs`; equal results for any number of them. Grasps that
/// `known` has with the same settings are taken over. Finished chunks lie in `folder` until the whole is there: a run
/// that was stopped goes on from them.
/// @return nothing when `cancel` became true
std::optional<PhysicsSet> labelSet(const SimulatedSet& set, const LabelRequest& request,
                                   const std::optional<PhysicsSet>& known, const std::filesystem::path& folder,
                                   const JobSystem& jobs, BuildCounters& counters, const std::atomic<bool>& cancel);

}  // namespace handhold
