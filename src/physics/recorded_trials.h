#pragma once

#include "build/build_set.h"
#include "core/random.h"
#include "physics/simulated_set.h"

#include <atomic>
#include <map>
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

/// Fields of hands, each made once.
class HandFieldsCache {
 public:
  /// @throws Cancelled  soon after `cancel` became true
  std::shared_ptr<const HandFields> of(const Hand& hand, const std::atomic<bool>& cancel);

 private:
  std::map<std::string, std::shared_ptr<const HandFields>> fields_;  // by the hand's contentHash
};

/// The trials of a set, to be run again from its record. Immutable; `set` must outlive it.
class RecordedTrials {
 public:
  /// @param fields  of the set's hand; not used where the job simulates by the reference
  RecordedTrials(const SimulatedSet& set, std::shared_ptr<const HandFields> fields);
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
