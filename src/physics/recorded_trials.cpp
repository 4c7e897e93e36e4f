#include "physics/recorded_trials.h"

#include "build/import_set.h"
#include "build/stored_set.h"
#include "core/hash.h"

#include <algorithm>
#include <numeric>

namespace handhold {
namespace {

/// `count` different numbers below `size`, in random order; all when there are no more.
std::vector<std::size_t> drawDifferent(std::size_t size, std::size_t count, const RandomStream& random) {
  std::vector<std::size_t> all(size);
  std::iota(all.begin(), all.end(), std::size_t{0});
  count = std::min(count, size);
  for (std::size_t i = 0; i < count; ++i) {
    std::swap(all[i], all[i + static_cast<std::size_t>(random.uniform(i) * static_cast<double>(size - i))]);
  }
  all.resize(count);
  return all;
}

}  // namespace

RandomStream drawStream(const GraspSet& set, std::uint64_t seed) {
  return RandomStream(hashText(set.object + "/" + set.hand)).child(seed);
}

DrawnGrasps drawGrasps(const GraspSet& set, std::size_t stored, std::size_t trials, std::uint64_t seed) {
  const RandomStream random = drawStream(set, seed), ofTrials = random.child(2);
  DrawnGrasps drawn{drawDifferent(set.graspCount(), stored, random.child(1)), {}};
  if (set.policy == kImportedPolicy) return drawn;
  for (std::size_t i = 0; i < trials; ++i) {
    drawn.trials.push_back(static_cast<std::size_t>(ofTrials.uniform(i) * static_cast<double>(set.trialCount())));
  }
  return drawn;
}

RecordedTrials::RecordedTrials(const SimulatedSet& set, HandFieldsCache& fields, const std::atomic<bool>& cancel)
    : job_(parseJobSettings(set.set().job, "the stored job")),
      hand_(set.model().hand()),
      fields_(fields.of(job_, hand_, cancel)) {
  item_.name = set.set().object;
  item_.friction = set.set().friction;
  object_ = sampleObject(job_, item_, storedObject(set.set()));
}

std::vector<SetWorker> RecordedTrials::makeWorkers(const JobSystem& jobs) const {
  return handhold::makeWorkers(job_, object_, hand_, fields_, jobs);
}

GraspPosture RecordedTrials::posture(const GraspCandidate& candidate, const GraspTrial& trial) const {
  return {trial.X_OH, hand_.preshapes[candidate.preshape].jointPosition, trial.jointPosition, trial.contacts};
}

}  // namespace handhold
