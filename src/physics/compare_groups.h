#pragma once

#include "core/job_system.h"
#include "physics/recorded_trials.h"

#include <array>
#include <atomic>
#include <optional>
#include <string_view>
#include <vector>

namespace handhold {

/// Which grasps of a set are compared.
enum class GraspGroup : std::uint8_t {
  best,    // the best by epsilon
  stored,  // of all that are stored, at random
  trials,  // of all trials of the set, at random, whatever came of them
  open,    // trials at random whose contacts, up to 3 mm away, do not close at the simulated friction
};
inline constexpr std::array<std::string_view, 4> kGraspGroupNames = {"best", "stored", "trials", "open"};

/// Why a grasp failed, the first that holds.
enum class FailureCause : std::uint8_t {
  inside,     // hand and object were in each other before closing
  unstable,   // the simulation left the range of numbers
  lost,       // fewer than two links touch after the squeeze
  displaced,  // closing alone moved the object 5 cm or turned it 15 degrees
  notClosed,  // the contacts after the squeeze are not force closed
  slipped,    // they were, and the object moved or turned under load
};
inline constexpr std::array<std::string_view, 6> kFailureCauseNames = {"inside",    "unstable",   "lost",
                                                                       "displaced", "not_closed", "slipped"};

struct GroupResult {
  std::size_t grasps = 0, held = 0;
  std::array<std::size_t, kFailureCauseNames.size()> causes{};
  std::size_t settledClosed = 0, heldClosed = 0;  // closed after the squeeze, and held
};

/// The four groups of one set, by GraspGroup.
using GroupTable = std::array<GroupResult, kGraspGroupNames.size()>;

/// How many labels (held in all six directions or not) two shapes of an object agree in.
struct ShapeAgreement {
  std::size_t grasps = 0, agree = 0, heldByField = 0, heldByPieces = 0;
};

/// Simulates the pull for up to `count` grasps of each group; which ones depends on the set's name and `seed` alone.
/// Sets of imported grasps have no trials: their last two groups are empty.
/// @return nothing when `cancel` became true
class GroupComparer {
 public:
  std::optional<GroupTable> compare(const SimulatedSet& set, std::size_t count, std::uint64_t seed,
                                    const JobSystem& jobs, const std::atomic<bool>& cancel);

  /// Labels half as many grasps of `stored` and half of `trials` with both shapes of the object (makePieces was
  /// called).
  std::optional<ShapeAgreement> compareShapes(const SimulatedSet& set, std::size_t count, std::uint64_t seed,
                                              const JobSystem& jobs, const std::atomic<bool>& cancel);

 private:
  /// The postures of up to `count` grasps of each group; a count of 0 leaves the group out.
  std::array<std::vector<GraspPosture>, kGraspGroupNames.size()> draw(
      const SimulatedSet& set, const std::array<std::size_t, kGraspGroupNames.size()>& counts, std::uint64_t seed,
      const std::atomic<bool>& cancel);

  HandFieldsCache fields_;
};

}  // namespace handhold
