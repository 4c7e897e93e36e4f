#pragma once

#include "build/checkpoint.h"
#include "build/evaluate.h"
#include "build/job.h"
#include "build/keep.h"
#include "core/job_system.h"
#include "sample/surface_samples.h"
#include "simulate/fast_policy.h"
#include "store/grasp_set.h"

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>

namespace handhold {

/// An object of the catalog with its target points and distance-map points: the same for every hand.
struct SampledObject {
  const CatalogItem* item = nullptr;
  ObjectModel model;
  SurfaceSamples samples;
  SurfaceSamples mapSamples;
  std::map<std::string, double> seconds;  // load, sample
};

/// Part of every input hash, and of every set: to be raised whenever a change of ours changes results.
inline constexpr int kMethodVersion = 8;

/// Loads and samples one object. @throws InputError, also when `cancel` becomes true while the file is read
SampledObject loadSampledObject(const Job& job, const CatalogItem& item, const std::atomic<bool>* cancel = nullptr);

/// The second half of it: samples a model. @throws InputError
SampledObject sampleObject(const Job& job, const CatalogItem& item, ObjectModel model);

/// The hash of everything that changes a set's results: mesh bytes and unit, hand files, parameters, method version.
std::string inputHash(const Job& job, const CatalogItem& item, const std::string& meshHash, const Hand& hand);

/// The policy that the job's `simulation` names. `fields` are the hand's, null for `reference`. `hand` and `object`
/// must outlive it.
std::unique_ptr<GraspPolicy> makePolicy(const Job& job, const Hand& hand, const ObjectModel& object,
                                        const std::shared_ptr<const HandFields>& fields);

/// How the contacts of a hand on an object become wrenches.
WrenchModel wrenchModel(const Job& job, const CatalogItem& item, const ObjectModel& object, const Hand& hand);

/// Candidate `trial` of N*R*M, in the order (sample, roll, preshape), rows first.
GraspCandidate candidateAt(const Job& job, const SurfaceSamples& samples, const Hand& hand, std::size_t trial);

/// What others may watch while a set is built.
struct BuildCounters {
  std::atomic<std::size_t> trials{0}, forceClosed{0};
};

/// Everything of a set that is known before its trials are run: object, hand, parameters, samples, distance map.
GraspSet emptySet(const Job& job, const SampledObject& object, const Hand& hand);

/// Of the set's own random streams.
std::uint64_t setKey(const GraspSet& set);

/// The row-to-be of a force-closed trial (index into N*R*M).
KeptGrasp keptGrasp(std::size_t trial, const Evaluation& evaluation);

/// Adds the rows of these grasps to a set without any, with their neighbours in the distance map.
void addGrasps(const Job& job, const SampledObject& object, const Hand& hand, const std::vector<KeptGrasp>& grasps,
               GraspSet& set);

/// What one thread needs, on cache lines of its own.
struct alignas(64) SetWorker {
  Cones cones;
  std::unique_ptr<GraspPolicy> policy;
  Evaluation evaluation;
};

/// One a thread of `jobs`. `fields`, `hand` and `object` as makePolicy has them.
std::vector<SetWorker> makeWorkers(const Job& job, const SampledObject& object, const Hand& hand,
                                   const std::shared_ptr<const HandFields>& fields, const JobSystem& jobs);

/// From force-closed trials to a whole set: sorts and keeps grasps, computes what only the best have, adds rows and
/// timings. `seconds` are those of the trials. False when `cancel` became true.
bool finishSet(const Job& job, const SampledObject& object, const Hand& hand, std::vector<KeptGrasp> grasps,
               const StageSeconds& seconds, const JobSystem& jobs, const std::atomic<bool>& cancel,
               std::vector<SetWorker>& workers, GraspSet& set);

/// Runs all N*R*M trials of one object and hand on all threads of `jobs`. Results do not depend on their number.
/// @param fields      as makePolicy has them
/// @param checkpoint  chunks of trials that an earlier run finished are taken over, new ones written there
/// @return nothing when `cancel` became true
std::optional<GraspSet> buildSet(const Job& job, const SampledObject& object, const Hand& hand,
                                 const std::string& inputHash, const std::shared_ptr<const HandFields>& fields,
                                 const Checkpoint& checkpoint, const JobSystem& jobs, BuildCounters& counters,
                                 const std::atomic<bool>& cancel);

}  // namespace handhold
