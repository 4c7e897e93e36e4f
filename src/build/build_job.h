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
  std::size_t shard = 0, shards = 1;  // this one of so many, as dealSets deals them
  bool force = false;                 // write the next version though nothing changed
  bool retryFailed = false;           // try inputs again that are known to fail
  PackagePaths packages;              // as given, for the commands that repeat failures
  ProgressMode progress = ProgressMode::automatic;
};

/// One set of the job and what became of it.
struct SetReport {
  enum class State { built, unchanged, failed, stopped };
  std::string object, hand;
  State state = State::stopped;
  GraspSetSummary summary;     // built
  std::string error, command;  // failed: the reason, and what repeats it
  bool known = false;          // failed: in an earlier run with the same inputs, and not tried again
};

/// What would be done, for --dry-run.
struct PlannedSet {
  enum class State { missing, changed, done, unreadable, failed };  // failed: known to, and not to be tried
  std::string object, hand;
  State state = State::missing;
  std::size_t trials = 0;  // 0: unknown before sampling (a job with a pitch)
  std::string error;       // of the last attempt, when that failed

  bool toBuild() const { return state == State::missing || state == State::changed; }
};

/// Is the newest version made from these inputs? A file that cannot be read counts as none, with a warning: the set is
/// built anew beside it.
bool isUnchanged(const Database& database, const std::string& object, const std::string& hand, const std::string& hash);

/// Builds every selected set that is missing or whose inputs changed. A set that fails is reported and recorded
/// (failures.h), and the rest goes on. Inputs that are known to fail are reported again and left alone until they
/// change, or `retryFailed` or `force` is given. When `cancel` becomes true the job stops within a second; finished
/// sets remain.
std::vector<SetReport> buildJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options, const std::atomic<bool>& cancel);

std::vector<PlannedSet> planJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options);

}  // namespace handhold
