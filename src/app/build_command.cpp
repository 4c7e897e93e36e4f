#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"

#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>

#include <fmt/format.h>

namespace handhold {
namespace {

std::atomic<bool> stopRequested{false};

/// The first signal asks for an orderly stop; the second ends the program as usual.
extern "C" void requestStop(int signal) {
  stopRequested = true;
  std::signal(signal, SIG_DFL);
}

/// What --dry-run says. Costs are taken from sets in the database that the same simulation made.
int printPlan(const BuildCommand& command, const Job& job, const std::vector<Hand>& hands, const Database& database) {
  static constexpr const char* kStates[] = {"missing", "changed", "done", "unreadable", "failed"};
  double seconds = 0, bytes = 0, knownTrials = 0;
  for (const auto& path : database.files()) {
    try {
      const GraspSetSummary summary = readSummary(path);
      const std::size_t setTrials = summary.samples * summary.rolls * summary.preshapes;
      const bool byReference = summary.trialsByReference == setTrials;
      if (byReference != (job.simulation == Simulation::reference)) continue;
      for (const auto& [stage, duration] : summary.seconds) seconds += duration;
      bytes += static_cast<double>(summary.bytes);
      knownTrials += static_cast<double>(setTrials);
    } catch (const InputError& error) {
      logWarning(error.what());
    }
  }
  std::size_t counts[5] = {}, trials = 0;
  for (const PlannedSet& set : planJob(job, hands, database, command.options)) {
    ++counts[static_cast<int>(set.state)];
    const bool toDo = set.state != PlannedSet::State::done && set.state != PlannedSet::State::unreadable;
    if (toDo) trials += set.trials;
    fmt::print("{:<10} {} x {}  {} trials\n", kStates[static_cast<int>(set.state)], set.object, set.hand,
               set.trials > 0 ? std::to_string(set.trials) : "an unknown number of");
  }
  fmt::print(
      "{} sets missing, {} changed, {} done, {} failed last time, {} with an unreadable mesh; {} trials to run\n",
      counts[0], counts[1], counts[2], counts[4], counts[3], trials);
  // Without a set to learn from: what jobs/demo.yaml takes a trial, on average, on one core of 2026.
  const double guess = job.simulation == Simulation::fast ? 2.5e-4 : 3e-3;
  const double secondsPerTrial = knownTrials > 0 ? seconds / knownTrials : guess;
  const double bytesPerTrial = knownTrials > 0 ? bytes / knownTrials : 300;
  fmt::print("about {:.2f} core-hours and {:.3f} GB ({})\n", secondsPerTrial * static_cast<double>(trials) / 3600,
             bytesPerTrial * static_cast<double>(trials) / 1e9,
             knownTrials > 0 ? fmt::format("as the {:.0f} trials in this database took", knownTrials)
                             : "a guess: the database has no set to learn from");
  return kExitDone;
}

int explainSelected(const BuildCommand& command, const Job& job, const std::vector<Hand>& hands) {
  const CatalogItem* item = nullptr;
  const Hand* hand = nullptr;
  int items = 0, handCount = 0;
  for (const CatalogItem& candidate : job.catalog) {
    if (matchesGlob(candidate.name, command.options.objectGlob)) ++items, item = &candidate;
  }
  for (const Hand& candidate : hands) {
    if (matchesGlob(candidate.name, command.options.handGlob)) ++handCount, hand = &candidate;
  }
  if (items != 1 || handCount != 1) {
    throw InputError(
        fmt::format("--trial needs --object and --hand that pick one of each, they pick {} objects and {} hands", items,
                    handCount));
  }
  return explainTrial(job, *item, *hand, static_cast<std::size_t>(command.trial));
}

int conclude(const std::vector<SetReport>& reports) {
  std::vector<GraspSetSummary> summaries;
  std::size_t counts[4] = {};
  for (const SetReport& report : reports) {
    ++counts[static_cast<int>(report.state)];
    if (report.state == SetReport::State::built || report.state == SetReport::State::unchanged) {
      summaries.push_back(report.summary);
    }
  }
  fmt::print("{}", summaryTable(summaries));
  fmt::print("{} sets built, {} unchanged, {} failed, {} stopped before they were done\n", counts[0], counts[1],
             counts[2], counts[3]);
  for (const SetReport& report : reports) {
    if (report.state != SetReport::State::failed) continue;
    fmt::print("failed: {} x {}: {}\n        repeat with: {}\n", report.object, report.hand, report.error,
               report.command);
  }
  return counts[2] + counts[3] == 0 ? kExitDone : kExitItemFailed;
}

}  // namespace

int runBuild(const BuildCommand& command, const Database& database) {
  const Job job = loadJob(command.job);
  const std::vector<Hand> hands = loadHands(job, command.packages);
  if (command.trial >= 0) return explainSelected(command, job, hands);
  if (command.dryRun) return printPlan(command, job, hands, database);
  std::signal(SIGINT, requestStop);
  std::signal(SIGTERM, requestStop);
  const std::vector<SetReport> reports = buildJob(job, hands, database, command.options, stopRequested);
  if (reports.empty()) {
    throw InputError(fmt::format("{}: --object {} --hand {} picks no set", command.job, command.options.objectGlob,
                                 command.options.handGlob));
  }
  return conclude(reports);
}

}  // namespace handhold
