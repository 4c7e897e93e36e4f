#include "build/build_job.h"

#include "build/build_set.h"
#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/log.h"
#include "simulate/actuation.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

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
  for (const CatalogItem& item : job.catalog) {
    Selection selection{&item, {}};
    for (const Hand& hand : hands) {
      const bool mine = hashText(item.name + "/" + hand.name) % options.shards == options.shard;
      if (mine && matchesGlob(item.name, options.objectGlob) && matchesGlob(hand.name, options.handGlob)) {
        selection.hands.push_back(&hand);
      }
    }
    if (!selection.hands.empty()) result.push_back(std::move(selection));
  }
  return result;
}

/// A set that may have to be built.
struct PendingSet {
  const Hand* hand;
  std::string inputHash;
};

/// What the fast policy knows of a hand, made once a run.
struct FieldsOfHand {
  std::shared_ptr<const HandFields> fields;
  double seconds = 0;  // that making them took, until a set has stored them
};

/// The item's mesh hash, empty when the file cannot be read: loading it will say why.
std::string readableMeshHash(const CatalogItem& item) {
  try {
    return meshHash(item);
  } catch (const InputError&) {
    return "";
  }
}

/// N*R*M as far as it is known before sampling.
std::size_t expectedTrials(const Job& job, const Hand& hand) { return job.samples * job.rolls * hand.preshapes.size(); }

/// A newest version that was made from these inputs. A file that cannot be read counts as none: it is built anew beside
/// it.
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

std::string quoted(const std::string& text) {
  return text.find_first_of(" '\"$&;()*?[]") == std::string::npos ? text : "'" + text + "'";
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
        jobs_(options.threads) {}

  void runObject(const Selection& selection) {
    const CatalogItem& item = *selection.item;
    const std::string mesh = readableMeshHash(item);
    std::vector<PendingSet> missing;
    for (const Hand* hand : selection.hands) {
      const PendingSet set{hand, inputHash(job_, item, mesh, *hand)};
      if (mesh.empty() || !reportUnchanged(item, set)) missing.push_back(set);
    }
    if (missing.empty() || cancel_) return;
    progress_.begin(item.name, reports_.size());
    SampledObject object;
    if (!guarded(item, missing, [&] { object = loadSampledObject(job_, item, &cancel_); })) return;
    for (const std::string& note : object.model.notes) logInfo(fmt::format("{}: {}", item.name, note));
    for (const std::string& warning : object.model.warnings) logWarning(fmt::format("{}: {}", item.name, warning));
    for (const PendingSet& set : missing) {
      if (!cancel_) runSet(object, set);
    }
  }

  std::vector<SetReport> takeReports() { return std::move(reports_); }

 private:
  /// A set whose summary cannot be read is not unchanged: it is built anew.
  bool reportUnchanged(const CatalogItem& item, const PendingSet& set) {
    const Hand& hand = *set.hand;
    try {
      if (options_.force || !isUnchanged(database_, item.name, hand.name, set.inputHash)) return false;
      const int version = database_.newestVersion(item.name, hand.name);
      reports_.push_back({item.name, hand.name, SetReport::State::unchanged,
                          readSummary(database_.setPath(item.name, hand.name, version)), "", ""});
    } catch (const InputError&) {
      return false;
    }
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
      std::optional<GraspSet> set = buildSet(job_, object, hand, pending.inputHash, fast ? fast->fields : nullptr,
                                             jobs_, progress_.counters(), cancel_);
      if (!set) return;
      if (fast) set->seconds["fields"] = fast->seconds;
      const std::size_t grasps = set->graspCount();
      const fs::path path = database_.write(std::move(*set));
      if (fast) fast->seconds = 0;
      reports_.push_back({item.name, hand.name, SetReport::State::built, readSummary(path), "", ""});
      if (grasps == 0) logWarning(fmt::format("{} x {}: no grasp is force closed", item.name, hand.name));
      logInfo(fmt::format("{} x {}: {} grasps, {}", item.name, hand.name, grasps, path.string()));
    });
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
      entry.fields = makeHandFields(hand, &cancel_);
      entry.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      logInfo(fmt::format("{}: fields of the hand made in {:.2f} s", hand.name, entry.seconds));
    }
    return entry;
  }

  /// Runs `work`; what it throws is the failure of these sets, not the end of the job. After a stop it is neither.
  bool guarded(const CatalogItem& item, const std::vector<PendingSet>& sets, const std::function<void()>& work) {
    std::string reason;
    try {
      work();
      return true;
    } catch (const std::bad_alloc&) {
      reason = "out of memory";
    } catch (const std::runtime_error& error) {  // InputError, SystemError, Cancelled
      reason = error.what();
    }
    for (const PendingSet& set : sets) {
      if (!cancel_) reportFailure(item, *set.hand, reason);
    }
    return false;
  }

  void reportFailure(const CatalogItem& item, const Hand& hand, const std::string& error) {
    const std::string command = fmt::format("handhold build {} --object {} --hand {} --db {}", quoted(job_.path),
                                            item.name, hand.name, quoted(database_.folder().string()));
    logError(fmt::format("{} x {}: {}", item.name, hand.name, error));
    reports_.push_back({item.name, hand.name, SetReport::State::failed, {}, error, command});
    progress_.skipTrials(expectedTrials(job_, hand));
  }

  const Job& job_;
  const Database& database_;
  const BuildOptions& options_;
  const std::atomic<bool>& cancel_;
  Progress& progress_;
  JobSystem jobs_;
  std::map<std::string, FieldsOfHand> fields_;  // by the hand's contentHash
  std::set<std::string> warned_;                // hands without efforts
  std::vector<SetReport> reports_;
};

/// `failed.json`: the failures of the last run, replaced as a whole; removed when there are none.
void recordFailures(const Database& database, const std::vector<SetReport>& reports) {
  nlohmann::json failures = nlohmann::json::array();
  for (const SetReport& report : reports) {
    if (report.state != SetReport::State::failed) continue;
    failures.push_back(
        {{"object", report.object}, {"hand", report.hand}, {"error", report.error}, {"command", report.command}});
  }
  const fs::path target = database.folder() / "failed.json";
  std::error_code error;
  if (failures.empty()) {
    fs::remove(target, error);
    return;
  }
  fs::create_directories(database.folder(), error);
  const fs::path temporary = temporaryName(database.folder());
  std::ofstream stream(temporary);
  stream << failures.dump(1) << '\n';
  stream.close();
  fs::rename(temporary, target, error);
  if (!stream || error) logWarning(fmt::format("{}: cannot be written", target.string()));
}

/// Object and hand of every set in `failed.json`; a file that is none of ours counts as empty.
std::set<std::pair<std::string, std::string>> recordedFailures(const Database& database) {
  std::set<std::pair<std::string, std::string>> result;
  std::ifstream stream(database.folder() / "failed.json");
  const nlohmann::json failures = nlohmann::json::parse(stream, nullptr, false);
  if (!failures.is_array()) return result;
  for (const auto& failure : failures) {
    const bool named = failure.is_object() && failure.contains("object") && failure["object"].is_string() &&
                       failure.contains("hand") && failure["hand"].is_string();
    if (named) result.emplace(failure["object"].get<std::string>(), failure["hand"].get<std::string>());
  }
  return result;
}

}  // namespace

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
    reports = run.takeReports();
  }
  for (const Selection& selection : selections) {
    for (const Hand* hand : selection.hands) {
      const bool reported = std::any_of(reports.begin(), reports.end(), [&](const SetReport& report) {
        return report.object == selection.item->name && report.hand == hand->name;
      });
      if (!reported) reports.push_back({selection.item->name, hand->name, SetReport::State::stopped, {}, "", ""});
    }
  }
  std::stable_sort(reports.begin(), reports.end(), [](const SetReport& a, const SetReport& b) {
    return a.object != b.object ? a.object < b.object : a.hand < b.hand;
  });
  recordFailures(database, reports);
  return reports;
}

std::vector<PlannedSet> planJob(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                const BuildOptions& options) {
  std::vector<PlannedSet> plan;
  const auto failed = recordedFailures(database);
  for (const Selection& selection : select(job, hands, options)) {
    const std::string mesh = readableMeshHash(*selection.item);
    for (const Hand* hand : selection.hands) {
      PlannedSet& set = plan.emplace_back();
      set.object = selection.item->name;
      set.hand = hand->name;
      set.trials = expectedTrials(job, *hand);
      const std::string hash = inputHash(job, *selection.item, mesh, *hand);
      const bool exists = database.newestVersion(set.object, set.hand) > 0;
      set.state = mesh.empty()                                         ? PlannedSet::State::unreadable
                  : !exists && failed.contains({set.object, set.hand}) ? PlannedSet::State::failed
                  : !exists                                            ? PlannedSet::State::missing
                  : isUnchanged(database, set.object, set.hand, hash)  ? PlannedSet::State::done
                                                                       : PlannedSet::State::changed;
    }
  }
  return plan;
}

}  // namespace handhold
