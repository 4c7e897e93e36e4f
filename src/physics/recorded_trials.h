#pragma once

#include "build/build_set.h"
#include "build/hand_fields_cache.h"
#include "core/random.h"
#include "physics/simulated_set.h"

#include <atomic>
#include <memory>
#include <string>
#include <vector>

namespace handhold {

/// Of a set: rows of its /grasps, and trials as indices into N*R*M.
struct DrawnGrasps {
  std::vector<std::size_t> rows;    // all different
  std::vector<std::size_t> trials;  // whatever came of them; one may be drawn twice
};

/// The stream of what is drawn of a set: it depends on the set's name and `seed` alone.
RandomStream drawStream(const GraspSet& set, std::uint64_t seed);

/// Up to `stored` rows and `trials` trials, in random order. A set of imported grasps has no trials.
DrawnGrasps drawGrasps(const GraspSet& set, std::size_t stored, std::size_t trials, std::uint64_t seed);

/// The trials of a set, to be run again from its record. Immutable; `set` must outlive it.
class RecordedTrials {
 public:
  /// @throws Cancelled  soon after `cancel` became true
  RecordedTrials(const SimulatedSet& set, HandFieldsCache& fields, const std::atomic<bool>& cancel);
  RecordedTrials(const RecordedTrials&) = delete;
  RecordedTrials& operator=(const RecordedTrials&) = delete;

  const Job& job() const { return job_; }
  WrenchModel wrenches() const { return wrenchModel(job_, item_, object_.model, hand_); }
  GraspCandidate candidate(std::size_t trial) const { return candidateAt(job_, object_.samples, hand_, trial); }
  /// One a thread of `jobs`.
  std::vector<SetWorker> makeWorkers(const JobSystem& jobs) const;
  GraspPosture posture(const GraspCandidate& candidate, const GraspTrial& trial) const;

 private:
  Job job_;
  const Hand& hand_;
  std::shared_ptr<const HandFields> fields_;
  CatalogItem item_;
  SampledObject object_;
};

}  // namespace handhold
