#include "build/build_job.h"

#include "build/build_set.h"
#include "build/failures.h"
#include "build/mesh_hashes.h"
#include "build/shards.h"
#include "build/time_limit.h"
#include "build/timing.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "simulate/actuation.h"

#include <algorithm>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// An item of the catalog with the hands that are selected for it.
struct Selection {
  const CatalogItem* item;
  std::vector<const Hand*> hands;
};

std::vector<Selection> select(const Job& job, const std::vector<Hand>& hands, const BuildOptions& options) {
  std::vector<Selection> result;
  for (const ShardedSet& set : dealSets(job, hands, options.objectGlob, options.handGlob, options.shards)) {
    if (set.shard != options.shard) continue;
    if (result.empty() || result.back().item != set.item) result.push_back({set.item, {}});
    result.back().hands.push_back(set.hand);
  }
  return result;
}

/// A set that may have to be built.
struct PendingSet {
  const Hand* hand;
  std::string meshHash, inputHash;
};

/// What the fast policy knows of a hand, made once a run.
struct FieldsOfHand {
  std::shared_ptr<const HandFields> fields;
  double seconds = 0;  // that making them took, until a set has stored them
};

/// An object or a set took longer than the job's timeout.
class TimeoutError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// N*R*M as far as it is known before sampling.
std::size_t expectedTrials(const Job& job, const Hand& hand) { return job.samples * job.rolls * hand.preshapes.size(); }

std::string absolutePath(const fs::path& path) { return fs::absolute(path).lexically_normal().string(); }

/// The record of these inputs' failure, when they are to be left alone for it.
std::optional<FailureRecord> knownFailure(const Job& job, const Database& database, const BuildOptions& options,
                                          const CatalogItem& item, const Hand& hand, const std::string& hash) {
  if (options.force || options.retryFailed) return std::nullopt;
  std::optional<FailureRecord> record = readFailure(database, item.name, hand.name);
  return record && isKnownBad(*record, hash, job.timeout) ? record : std::nullopt;
}

/// Everything that one run of a job shares.
class JobRun {
 public:
  JobRun(const Job& job, const Database& database, const BuildOptions& options, const std::atomic<bool>& cancel,
         Progress& progress)
      : job_(job),
        database_(database),
        options_(options),
        cancel_(cancel),
        progress_(progress),
        jobs_(options.threads),
        meshHashes_(database.folder()) {
    std::error_code error;
    fs::create_directories(database.folder(), error);  // the first write tells when it could not
    folder_.emplace(database.folder());
  }

  void runObject(const Selection& selection) {
    const CatalogItem& item = *selection.item;
    const std::string mesh = meshHashes_.of(item.mesh);
    std::vector<PendingSet> missing;
    for (const Hand* hand : selection.hands) {
      const PendingSet set{hand, mesh, inputHash(job_, item, mesh, *hand)};
      bool isSettled = false;
      const auto look = [&] {
        isSettled = !mesh.empty() && (reportUnchanged(item, set) || reportKnownFailure(item, set));
      };
      if (guarded(item, {set}, look) && !isSettled) missing.push_back(set);
    }
    if (missing.empty() || cancel_) return;
    progress_.begin(item.name, reports_.size());
    SampledObject object;
    const auto load = [&](const std::atomic<bool>& stop) {
      object = loadSampledObject(job_, item, &stop);
      return !stop;  // sampling does not look at it
    };
    if (!guarded(item, missing, [&] { limited(load); })) return;
    for (const std::string& note : object.model.notes) logInfo(fmt::format("{}: {}", item.name, note));
    for (const std::string& warning : object.model.warnings) logWarning(fmt::format("{}: {}", item.name, warning));
    for (const PendingSet& set : missing) {
      if (!cancel_) runSet(object, set);
    }
  }

  std::vector<SetReport> finish() {
    meshHashes_.save();
    return std::move(reports_);
  }

 private:
  bool reportUnchanged(const CatalogItem& item, const PendingSet& set) {
    const Hand& hand = *set.hand;
    if (options_.force || !isUnchanged(database_, item.name, hand.name, set.inputHash)) return false;
    removeFailure(database_, item.name, hand.name);  // of inputs that were changed back
    reports_.push_back({item.name, hand.name, SetReport::State::unchanged, {}, "", ""});
    progress_.skipTrials(expectedTrials(job_, hand));
    return true;
  }

  bool reportKnownFailure(const CatalogItem& item, const PendingSet& set) {
    const Hand& hand = *set.hand;
    const auto record = knownFailure(job_, database_, options_, item, hand, set.inputHash);
    if (!record) return false;
    reports_.push_back({item.name, hand.name, SetReport::State::failed, {}, record->error, record->command, true});
    progress_.skipTrials(expectedTrials(job_, hand));
    return true;
  }

  void runSet(const SampledObject& object, const PendingSet& pending) {
    const CatalogItem& item = *object.item;
    const Hand& hand = *pending.hand;
    progress_.begin(item.name + " x " + hand.name, reports_.size());
    warnWithoutEfforts(hand);
    guarded(item, {pending}, [&] {
      FieldsOfHand* fast = job_.simulation == Simulation::fast ? &fieldsOf(hand) : nullptr;
      const Checkpoint checkpoint(database_.setPath(item.name, hand.name, 0).parent_path(), pending.inputHash);
      std::optional<GraspSet> set;
      limited([&](const std::atomic<bool>& stop) {
        set = buildSet(job_, object, hand, pending.inputHash, fast ? fast->fields : nullptr, checkpoint, jobs_,
                       progress_.counters(), stop);
        return set.has_value();
      });
      if (!set) return;
      if (fast) set->seconds["fields"] = fast->seconds;
      const std::size_t grasps = set->graspCount();
      requireSameFolder();
      const fs::path path = database_.write(std::move(*set));
      if (fast) fast->seconds = 0;
      checkpoint.remove();
      removeFailure(database_, item.name, hand.name);
      reports_.push_back({item.name, hand.name, SetReport::State::built, readSummary(path), "", ""});
      if (grasps == 0) logWarning(fmt::format("{} x {}: no grasp is force closed", item.name, hand.name));
      logInfo(fmt::format("{} x {}: {} grasps, {}", item.name, hand.name, grasps, path.string()));
    });
  }

  /// A database that was removed or unmounted meanwhile is not begun anew in its place.
  void requireSameFolder() const {
    if (!folder_->isAt(database_.folder())) {
      throw SystemError(
          fmt::format("{}: is not the folder that the build began with: it was removed, moved or unmounted",
                      database_.folder().string()));
    }
  }

  /// Once a run: a grasp's load margin is then unknown.
  void warnWithoutEfforts(const Hand& hand) {
    if (job_.loadMargin.grasps == 0 || hasEffortLimits(hand) || !warned_.insert(hand.name).second) return;
    logWarning(fmt::format("{}: the URDF gives no joint an effort limit, so there is no load margin", hand.name));
  }

  /// Made when the first object needs them, for all others too.
  FieldsOfHand& fieldsOf(const Hand& hand) {
    FieldsOfHand& entry = fields_[hand.contentHash];
    if (!entry.fields) {
      const auto start = std::chrono::steady_clock::now();
      const double before = processSeconds();
      entry.fields = makeHandFields(hand, &cancel_, jobs_);
      entry.seconds = processSeconds() - before;
      logInfo(fmt::format("{}: fields of the hand made in {:.2f} s", hand.name, secondsSince(start)));
    }
    return entry;
  }

  /// Runs `work`, which returns whether it got to its end, under the job's timeout. @throws TimeoutError
  void limited(const std::function<bool(const std::atomic<bool>& stop)>& work) const {
    const TimeLimit limit(cancel_, job_.timeout);
    bool finished = false;
    try {
      finished = work(limit.flag());
    } catch (const InputError&) {
      if (!limit.expired()) throw;  // else it only says that it was stopped
    }
    if (!finished && limit.expired()) {
      throw TimeoutError(fmt::format("took longer than the job's timeout of {} s", job_.timeout));
    }
  }

  /// Runs `work`; what it throws is the failure of these sets, not the end of the job. After a stop it is neither.
  bool guarded(const CatalogItem& item, const std::vector<PendingSet>& sets, const std::function<void()>& work) {
    std::string reason;
    bool byInput = false, byTimeout = false;
    try {
      work();
      return true;
    } catch (const TimeoutError& error) {
      reason = error.what();
      byInput = byTimeout = true;
    } catch (const InputError& error) {
      reason = error.what();
      byInput = true;
    } catch (const std::bad_alloc&) {
      reason = "out of memory";
    } catch (const std::exception& error) {  // SystemError, and what nobody thought of
      reason = error.what();
    }
    if (cancel_) return false;
    // A file that cannot be read now, or is being written, says nothing of its next state.
    const bool knownBad = byInput && !sets[0].meshHash.empty() && meshHash(item.mesh) == sets[0].meshHash;
    for (const PendingSet& set : sets) reportFailure(item, set, reason, knownBad, byTimeout ? job_.timeout : 0);
    return false;
  }

  void reportFailure(const CatalogItem& item, const PendingSet& set, const std::string& error, bool knownBad,
                     double timeout) {
    const Hand& hand = *set.hand;
    std::string command = fmt::format("handhold build {} --object {} --hand {} --db {} --retry-failed",
                                      shellQuoted(absolutePath(job_.path)), item.name, hand.name,
                                      shellQuoted(absolutePath(database_.folder())));
    for (const auto& [name, folder] : options_.packages) {
      command += " --package " + shellQuoted(name + "=" + absolutePath(folder));
    }
    logError(fmt::format("{} x {}: {}", item.name, hand.name, error));
    writeFailure(database_, {item.name, hand.name, error, command, set.inputHash, knownBad, timeout});
    reports_.push_back({item.name, hand.name, SetReport::State::failed, {}, error, command});
    progress_.skipTrials(expectedTrials(job_, hand));
  }

  const Job& job_;
  const Database& database_;
  std::optional<OpenFolder> folder_;  // the database's, once it is there
  const BuildOptions& options_;
  const std::atomic<bool>& cancel_;
  Progress& progress_;
  JobSystem jobs_;
  MeshHashes meshHashes_;
  std::map<std::string, FieldsOfHand> fields_;  // by the hand's contentHash
  std::set<std::string> warned_;                // hands without efforts
  std::vector<SetReport> reports_;
};

}  // namespace

bool isUnchanged(const Database& database, const std::string& object, const std::string& hand,
                 const std::string& hash) {
  const int version = database.newestVersion(object, hand);
  if (version == 0) return false;
  try {
    return readInputHash(database.setPath(object, hand, version)) == hash;
  } catch (const InputError& error) {
    logWarning(fmt::format("{}; a new version will be built", error.what()));
    return false;
  }
}

std::vector<SetReport> buildJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options, const std::atomic<bool>& cancel) {
  const std::vector<Selection> selections = select(job, hands, options);
  std::size_t sets = 0, trials = 0;
  for (const Selection& selection : selections) {
    sets += selection.hands.size();
    for (const Hand* hand : selection.hands) trials += expectedTrials(job, *hand);
  }
  std::vector<SetReport> reports;
  {
    Progress progress(options.progress, sets, trials);
    JobRun run(job, database, options, cancel, progress);
    for (const Selection& selection : selections) {
      if (!cancel) run.runObject(selection);
    }
    reports = run.finish();
    progress.end(reports.size());
  }
  std::set<std::pair<std::string, std::string>> reported;
  for (const SetReport& report : reports) reported.emplace(report.object, report.hand);
  for (const Selection& selection : selections) {
    for (const Hand* hand : selection.hands) {
      if (reported.contains({selection.item->name, hand->name})) continue;
      reports.push_back({selection.item->name, hand->name, SetReport::State::stopped, {}, "", ""});
    }
  }
  std::stable_sort(reports.begin(), reports.end(), [](const SetReport& a, const SetReport& b) {
    return a.object != b.object ? a.object < b.object : a.hand < b.hand;
  });
  return reports;
}

std::vector<PlannedSet> planJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options) {
  std::vector<PlannedSet> plan;
  MeshHashes meshHashes(database.folder());
  for (const Selection& selection : select(job, hands, options)) {
    const CatalogItem& item = *selection.item;
    const std::string mesh = meshHashes.of(item.mesh);
    for (const Hand* hand : selection.hands) {
      PlannedSet& set = plan.emplace_back();
      set.object = item.name;
      set.hand = hand->name;
      set.trials = expectedTrials(job, *hand);
      const std::string hash = inputHash(job, item, mesh, *hand);
      const bool exists = database.newestVersion(set.object, set.hand) > 0;
      if (mesh.empty()) {
        set.state = PlannedSet::State::unreadable;
      } else if (exists && !options.force && isUnchanged(database, set.object, set.hand, hash)) {
        set.state = PlannedSet::State::done;
        continue;
      } else if (knownFailure(job, database, options, item, *hand, hash)) {
        set.state = PlannedSet::State::failed;
      } else {
        set.state = exists ? PlannedSet::State::changed : PlannedSet::State::missing;
      }
      if (const auto record = readFailure(database, set.object, set.hand)) set.error = record->error;
    }
  }
  return plan;
}

}  // namespace handhold
