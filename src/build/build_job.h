#pragma once

#include "build/job.h"
#include "build/progress.h"
#include "store/database.h"

#include <atomic>
#include <string>
#include <vector>

namespace handhold {

struct BuildOptions {
  int threads = 0;  // 0: all cores
  std::string objectGlob = "*", handGlob = "*";
  std::size_t shard = 0, shards = 1;  // this one of so many; sets are dealt out by a hash of their names
  bool force = false;                 // write the next version though nothing changed
  ProgressMode progress = ProgressMode::automatic;
};

/// One set of the job and what became of it.
struct SetReport {
  enum class State { built, unchanged, failed, stopped };
  std::string object, hand;
  State state = State::stopped;
  GraspSetSummary summary;     // built or unchanged
  std::string error, command;  // failed: the reason, and what repeats it
};

/// What would be done, for --dry-run.
struct PlannedSet {
  enum class State { missing, changed, done, unreadable, failed };  // failed: in the last run, and still missing
  std::string object, hand;
  State state = State::missing;
  std::size_t trials = 0;  // 0: unknown before sampling (a job with a pitch)
};

/// Builds every selected set that is missing or whose inputs changed. A set that fails is reported, written to
/// `failed.json` in the database folder, and the rest goes on. When `cancel` becomes true the job stops within a
/// second; finished sets remain.
std::vector<SetReport> buildJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options, const std::atomic<bool>& cancel);

std::vector<PlannedSet> planJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options);

}  // namespace handhold
