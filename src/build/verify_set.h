#pragma once

#include "build/hand_fields_cache.h"
#include "store/database.h"

#include <atomic>
#include <optional>
#include <string>
#include <vector>

namespace handhold {

/// What the recomputation of a set found.
struct VerifyReport {
  enum class State { good, differs, damaged, notRecomputed };
  /// A stored number that is computed otherwise.
  struct Mismatch {
    std::string where;               // dataset, and the grasp or trial: `/grasps/epsilon of grasp 17`
    std::string stored, recomputed;  // empty where the whole dataset differs
  };
  State state = State::good;
  std::string reason;                  // damaged, notRecomputed
  std::size_t grasps = 0, trials = 0;  // recomputed
  std::vector<Mismatch> mismatches;
};

/// Checks sets: each file as a whole, then a sample of its grasps and trials, computed again from nothing but what is
/// in the file. Fields of hands are kept from set to set.
class SetVerifier {
 public:
  /// The file's checksum, all checks of readGraspSet, and its place in the database; then what the object's mesh, the
  /// hand's texts and the parameters determine (mass, samples, distance map), `sample` grasps, spread over the ranks,
  /// and as many trials of the table, spread over it; all compared bit for bit with what is stored. Which ones depends
  /// on the set's name and version alone. A set that another version of the method made cannot be recomputed.
  /// @param sample  0: only checks
  /// @return        nothing when `cancel` became true
  std::optional<VerifyReport> verify(const std::filesystem::path& path, std::size_t sample,
                                     const std::atomic<bool>& cancel);

 private:
  HandFieldsCache fields_;
};

}  // namespace handhold
