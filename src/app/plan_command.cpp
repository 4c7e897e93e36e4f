#include "app/commands.h"
#include "build/estimate.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

constexpr const char* kStates[] = {"missing", "changed", "done", "unreadable", "failed"};

const char* nameOf(PlannedSet::State state) { return kStates[static_cast<int>(state)]; }

/// All hands together; its rates mean nothing.
HandEstimate totalOf(const std::vector<HandEstimate>& estimates) {
  HandEstimate total;
  for (const HandEstimate& e : estimates) {
    total.missing += e.missing;
    total.changed += e.changed;
    total.done += e.done;
    total.failed += e.failed;
    total.unreadable += e.unreadable;
    total.trials += e.trials;
    total.unknownSets += e.unknownSets;
    total.coreHours += e.coreHours;
    total.gigabytes += e.gigabytes;
  }
  return total;
}

nlohmann::ordered_json toJson(const HandEstimate& e) {
  return {{"missing", e.missing},
          {"changed", e.changed},
          {"done", e.done},
          {"failed", e.failed},
          {"unreadable", e.unreadable},
          {"trials", e.trials},
          {"unknown_sets", e.unknownSets},
          {"core_hours", e.coreHours},
          {"gigabytes", e.gigabytes}};
}

nlohmann::ordered_json toJson(const CostRates& r) {
  return {{"sets", r.sets},
          {"seconds_per_set", r.secondsPerSet},
          {"seconds_per_trial", r.secondsPerTrial},
          {"seconds_per_grasp", r.secondsPerGrasp},
          {"seconds_once", r.secondsOnce},
          {"share_force_closed", r.shareForceClosed},
          {"bytes_per_set", r.bytesPerSet},
          {"bytes_per_sample", r.bytesPerSample},
          {"bytes_per_trial", r.bytesPerTrial},
          {"bytes_per_grasp", r.bytesPerGrasp}};
}

void printJson(const std::vector<PlannedSet>& plan, const std::vector<HandEstimate>& estimates) {
  nlohmann::ordered_json sets = nlohmann::ordered_json::array(), hands = nlohmann::ordered_json::array();
  for (const PlannedSet& set : plan) {
    nlohmann::ordered_json entry = {{"object", set.object}, {"hand", set.hand}, {"state", nameOf(set.state)}};
    entry["trials"] = set.trials > 0 ? nlohmann::ordered_json(set.trials) : nlohmann::ordered_json();
    if (!set.error.empty()) entry["error"] = set.error;
    sets.push_back(std::move(entry));
  }
  for (const HandEstimate& estimate : estimates) {
    nlohmann::ordered_json entry = {{"hand", estimate.hand}};
    entry.update(toJson(estimate));
    entry["rates"] = toJson(estimate.rates);
    hands.push_back(std::move(entry));
  }
  const nlohmann::ordered_json all = {{"sets", sets}, {"hands", hands}, {"total", toJson(totalOf(estimates))}};
  fmt::print("{}\n", all.dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void printTable(const std::vector<PlannedSet>& plan, const std::vector<HandEstimate>& estimates) {
  for (const PlannedSet& set : plan) {
    fmt::print("{:<10} {} x {}  {} trials{}\n", nameOf(set.state), set.object, set.hand,
               set.trials > 0 ? std::to_string(set.trials) : "an unknown number of",
               set.error.empty() ? "" : "; failed: " + set.error);
  }
  std::size_t width = 5;
  for (const HandEstimate& e : estimates) width = std::max(width, e.hand.size());
  fmt::print("{:<{}} {:>7} {:>7} {:>7} {:>7} {:>10} {:>12} {:>10} {:>9}  {}\n", "hand", width, "missing", "changed",
             "done", "failed", "unreadable", "trials", "core-hours", "GB", "as measured on");
  const auto printRow = [&](const std::string& name, const HandEstimate& e, const std::string& source) {
    fmt::print("{:<{}} {:>7} {:>7} {:>7} {:>7} {:>10} {:>12.0f} {:>10.2f} {:>9.3f}  {}\n", name, width, e.missing,
               e.changed, e.done, e.failed, e.unreadable, e.trials, e.coreHours, e.gigabytes, source);
  };
  for (const HandEstimate& e : estimates) {
    const CostRates& r = e.rates;
    printRow(e.hand, e,
             fmt::format("{}: {:.3f} ms a trial, {:.0f} % force closed, {:.3f} ms and {:.0f} bytes a grasp",
                         r.sets > 0 ? fmt::format("{} set{} of this database", r.sets, r.sets == 1 ? "" : "s")
                                    : "no set here, so a guess from jobs/demo.yaml",
                         1e3 * r.secondsPerTrial, 100 * r.shareForceClosed, 1e3 * r.secondsPerGrasp, r.bytesPerGrasp));
  }
  const HandEstimate total = totalOf(estimates);
  printRow("all", total, "");
  fmt::print("{} sets missing, {} changed, {} done, {} failed and left alone, {} with an unreadable mesh\n",
             total.missing, total.changed, total.done, total.failed, total.unreadable);
  fmt::print("about {:.2f} core-hours and {:.3f} GB for {:.0f} trials\n", total.coreHours, total.gigabytes,
             total.trials);
  if (total.unknownSets > 0) {
    fmt::print("not counted: {} sets whose number of trials only sampling at their pitch tells\n", total.unknownSets);
  }
}

}  // namespace

int printPlan(const BuildCommand& command, const Job& job, const std::vector<Hand>& hands, const Database& database) {
  selectedSets(job, hands, command.options);
  const std::vector<PlannedSet> plan = planJob(job, hands, database, command.options);
  const std::vector<HandEstimate> estimates = estimateCost(job, hands, database, plan);
  command.json ? printJson(plan, estimates) : printTable(plan, estimates);
  return kExitDone;
}

}  // namespace handhold
