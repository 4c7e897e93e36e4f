#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

namespace handhold {
namespace {

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
  std::vector<GraspSetSummary> built;
  std::size_t counts[4] = {}, known = 0;
  for (const SetReport& report : reports) {
    ++counts[static_cast<int>(report.state)];
    if (report.known) ++known;
    if (report.state == SetReport::State::built) built.push_back(report.summary);
  }
  fmt::print("{}", summaryTable(built));
  fmt::print("{} {} built, {} unchanged, {} failed{}, {} stopped before they were done\n", counts[0],
             counts[0] == 1 ? "set" : "sets", counts[1], counts[2], known > 0 ? fmt::format(" ({} known)", known) : "",
             counts[3]);
  for (const SetReport& report : reports) {
    if (report.state != SetReport::State::failed) continue;
    fmt::print("failed{}: {} x {}: {}\n        repeat with: {}\n",
               report.known ? " (known; --retry-failed tries again)" : "", report.object, report.hand, report.error,
               report.command);
  }
  return counts[2] + counts[3] == 0 ? kExitDone : kExitItemFailed;
}

}  // namespace

std::vector<ShardedSet> selectedSets(const Job& job, const std::vector<Hand>& hands, const BuildOptions& options) {
  std::vector<ShardedSet> sets = dealSets(job, hands, options.objectGlob, options.handGlob, options.shards);
  if (sets.empty()) {
    throw InputError(
        fmt::format("{}: --object {} --hand {} picks no set", job.path, options.objectGlob, options.handGlob));
  }
  return sets;
}

int runBuild(const BuildCommand& command, const Database& database) {
  if (command.json && !command.dryRun) throw InputError("--format json is given without --dry-run, want both");
  const Job job = loadJob(command.job);
  const std::vector<Hand> hands = loadHands(job, command.options.packages);
  if (command.trial >= 0) return explainSelected(command, job, hands);
  if (command.dryRun) return printPlan(command, job, hands, database);
  selectedSets(job, hands, command.options);  // a shard may be empty, the selection not
  return conclude(buildJob(job, hands, database, command.options, stopOnSignals()));
}

}  // namespace handhold
