#include "app/commands.h"
#include "build/import_set.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "store/physics_set.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;

double totalSeconds(const GraspSetSummary& summary) {
  double sum = 0;
  for (const auto& [stage, seconds] : summary.seconds) sum += seconds;
  return sum;
}

std::size_t trialCount(const GraspSetSummary& summary) { return summary.samples * summary.rolls * summary.preshapes; }

double share(std::size_t part, std::size_t all) {
  return all == 0 ? 0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

/// Reads every set; one that is damaged is told and counted, the others are shown.
std::vector<GraspSetSummary> readAll(const std::vector<fs::path>& files, std::size_t& damaged) {
  std::vector<GraspSetSummary> summaries;
  for (const fs::path& file : files) {
    try {
      summaries.push_back(readSummary(file));
    } catch (const InputError& error) {
      logError(error.what());
      ++damaged;
    }
  }
  return summaries;
}

nlohmann::ordered_json toJson(const GraspSetSummary& s) {
  nlohmann::ordered_json outcomes, seconds;
  for (const auto& [name, count] : s.outcomes) outcomes[name] = count;
  for (const auto& [stage, duration] : s.seconds) seconds[stage] = duration;
  return {{"object", s.object},
          {"hand", s.hand},
          {"set_version", s.setVersion},
          {"samples", s.samples},
          {"rolls", s.rolls},
          {"preshapes", s.preshapes},
          {"trials", trialCount(s)},
          {"trials_by_reference", s.trialsByReference},
          {"outcomes", outcomes},
          {"grasps", s.grasps},
          {"best_epsilon", s.bestEpsilon},
          {"best_epsilon_lower", s.bestEpsilonLower},
          {"best_epsilon_upper", s.bestEpsilonUpper},
          {"least_critical_friction", s.leastCriticalFriction},
          {"best_load_margin", s.bestLoadMargin},
          {"largest_load_margin", s.largestLoadMargin},
          {"load_margins", s.loadMargins},
          {"robustness_trials", s.robustnessTrials},
          {"best_robustness", s.bestRobustness},
          {"best_robustness_lower", s.bestRobustnessLower},
          {"best_robustness_upper", s.bestRobustnessUpper},
          {"seconds", seconds},
          {"policy", s.policy},
          {"friction", s.friction},
          {"cone_edges", s.coneEdges},
          {"contact_model", s.torsionRadius > 0 ? "soft_finger" : "point"},
          {"torsion_radius", s.torsionRadius},
          {"watertight", s.watertight},
          {"notes", s.objectNotes},
          {"input_hash", s.inputHash},
          {"generator", s.generator},
          {"created", s.created},
          {"bytes", s.bytes},
          {"path", s.path.string()}};
}

nlohmann::ordered_json toJson(const PhysicsSet& physics) {
  nlohmann::ordered_json held;
  for (const std::string& test : physics.testNames) held[test] = countHeld(physics, test);
  return {{"grasps", physics.graspCount()},      {"held", held},
          {"friction", physics.friction},        {"mass", physics.mass},
          {"shape_error_p95", physics.shapeP95}, {"shape_error_largest", physics.shapeMost}};
}

void printPhysics(const PhysicsSet& physics) {
  fmt::print(
      "  physics     {} grasps simulated at friction {:.4g}; object's shape off by {:.2f} mm (p95), {:.2f} mm at "
      "most\n",
      physics.graspCount(), physics.friction, 1e3 * physics.shapeP95, 1e3 * physics.shapeMost);
  for (const std::string& test : physics.testNames) {
    const std::size_t held = countHeld(physics, test);
    fmt::print("    {:<18}{:>9}  {:5.1f} % held\n", test, held, share(held, physics.graspCount()));
  }
}

void printInfo(const GraspSetSummary& s) {
  fmt::print("{} x {}, version {}\n", s.object, s.hand, s.setVersion);
  fmt::print("  file        {} ({:.2f} MB)\n", s.path.string(), static_cast<double>(s.bytes) / 1e6);
  fmt::print("  made by     {} on {} at {}\n", s.generator, s.host, s.created);
  fmt::print("  input hash  {}\n", s.inputHash);
  fmt::print("  policy      {}, friction {}, {} cone edges\n", s.policy, s.friction, s.coneEdges);
  fmt::print("  contacts    {}\n", contactModel(s.torsionRadius));
  fmt::print("  object      {}\n", s.watertight ? "watertight" : "open surface");
  for (const std::string& note : s.objectNotes) fmt::print("              {}\n", note);
  fmt::print("  trials      {} samples x {} rolls x {} preshapes = {}\n", s.samples, s.rolls, s.preshapes,
             trialCount(s));
  fmt::print("  reference   ran {} of them, {:.2f} %\n", s.trialsByReference,
             share(s.trialsByReference, trialCount(s)));
  for (const auto& [name, count] : s.outcomes) {
    if (count == 0 && name != "force_closed") continue;  // as in the table of sets
    fmt::print("    {:<18}{:>9}  {:5.1f} %\n", name, count, share(count, trialCount(s)));
  }
  fmt::print("  grasps      {} stored{}\n", s.grasps,
             s.grasps > 0 ? fmt::format(", best epsilon {:.4f}", s.bestEpsilon) : "");
  if (!std::isnan(s.bestEpsilonLower)) {
    fmt::print("  true cone   epsilon of the same grasp {:.5f} to {:.5f}; least critical friction of any {:.4f}\n",
               s.bestEpsilonLower, s.bestEpsilonUpper, s.leastCriticalFriction);
  }
  if (s.loadMargins > 0) {
    fmt::print("  load margin of the same grasp {:.2f} N; the largest of any {:.2f} N; known for {} grasps\n",
               s.bestLoadMargin, s.largestLoadMargin, s.loadMargins);
  }
  if (s.robustnessTrials > 0 && s.grasps > 0) {
    fmt::print(
        "  robustness  of the same grasp {:.2f}, 95 % in [{:.2f}, {:.2f}]: {} poses off by {} m, {:.3g} degrees\n",
        s.bestRobustness, s.bestRobustnessLower, s.bestRobustnessUpper, s.robustnessTrials, s.robustnessPosition,
        s.robustnessRotation * 180 / std::numbers::pi);
  }
  if (const std::optional<PhysicsSet> physics = physicsOf(s.path, s.inputHash, s.setVersion, s.grasps))
    printPhysics(*physics);
  const double total = totalSeconds(s);
  fmt::print("  core time   {:.2f} s, {:.0f} trials/s a core\n", total,
             total > 0 ? static_cast<double>(trialCount(s)) / total : 0);
  for (const auto& [stage, duration] : s.seconds) {
    if (duration > 0) fmt::print("    {:<18}{:>9.3f} s\n", stage, duration);  // 0: the job does not ask for it
  }
}

/// How an outcome is headed in a table, and what is said about it below.
struct Column {
  std::string outcome, heading, meaning;
};

/// The outcomes that occur in any of the sets: others get no column. One of a newer program keeps its own name.
std::vector<Column> occurringOutcomes(const std::vector<GraspSetSummary>& summaries) {
  static const std::vector<Column> kKnown = {
      {"force_closed", "FC %", "trials that end force closed"},
      {"not_force_closed", "not FC %", "contacts that cannot resist every wrench"},
      {"too_few_contacts", "few %", "fewer contacts than force closure takes: three points, two soft fingers"},
      {"blocked_centering", "blocked %", "a jaw that centres itself would push the hand into the object"},
      {"self_collision", "self %", "force closed, but parts of the hand pass through each other"},
      {"solve_failed", "solve %", "force closure or epsilon could not be computed"},
      {"not_run", "not run %", "the build was stopped; of an imported set: the file does not ask for it"},
      {std::string(kPreshapeTouches), "touches %", "of an imported set: the hand touches the object before it closes"}};
  std::vector<Column> occurring;
  const auto has = [](const std::vector<Column>& columns, const std::string& outcome) {
    return std::any_of(columns.begin(), columns.end(), [&](const Column& column) { return column.outcome == outcome; });
  };
  for (const GraspSetSummary& summary : summaries) {
    for (const auto& [name, count] : summary.outcomes) {
      if (count > 0 && !has(occurring, name)) occurring.push_back({name, name + " %", name});
    }
  }
  std::vector<Column> columns;
  std::copy_if(kKnown.begin(), kKnown.end(), std::back_inserter(columns),
               [&](const Column& column) { return has(occurring, column.outcome); });
  std::copy_if(occurring.begin(), occurring.end(), std::back_inserter(columns),
               [&](const Column& column) { return !has(kKnown, column.outcome); });
  return columns;
}

}  // namespace

std::optional<PhysicsSet> physicsOf(const fs::path& set, const std::string& inputHash, int setVersion,
                                    std::size_t grasps) {
  if (!fs::exists(physicsPath(set))) return std::nullopt;
  try {
    return readPhysicsOf(set, inputHash, setVersion, grasps);
  } catch (const InputError& error) {
    logWarning(error.what());
    return std::nullopt;
  }
}

std::string contactModel(double torsionRadius) {
  return torsionRadius > 0 ? fmt::format("soft fingers, torsion radius {} m", torsionRadius) : "points";
}

std::string summaryTable(const std::vector<GraspSetSummary>& summaries) {
  if (summaries.empty()) return "";
  const std::vector<Column> columns = occurringOutcomes(summaries);
  std::size_t objectWidth = 6, handWidth = 4;
  for (const GraspSetSummary& s : summaries) {
    objectWidth = std::max(objectWidth, s.object.size());
    handWidth = std::max(handWidth, s.hand.size());
  }
  std::string table = fmt::format("{:<{}} {:<{}} {:>3} {:>5} {:>3} {:>2} {:>7}", "object", objectWidth, "hand",
                                  handWidth, "ver", "N", "R", "M", "trials");
  for (const Column& column : columns) table += fmt::format(" {:>9}", column.heading);
  table += fmt::format(" {:>7} {:>8} {:>7}\n", "grasps", "best eps", "core s");
  for (const GraspSetSummary& s : summaries) {
    table += fmt::format("{:<{}} {:<{}} {:>3} {:>5} {:>3} {:>2} {:>7}", s.object, objectWidth, s.hand, handWidth,
                         s.setVersion, s.samples, s.rolls, s.preshapes, trialCount(s));
    for (const Column& column : columns) {
      std::size_t count = 0;
      for (const auto& [name, value] : s.outcomes) count += name == column.outcome ? value : 0;
      const double percent = share(count, trialCount(s));
      table += fmt::format(" {:>9}", count > 0 && percent < 0.05 ? "<0.1" : fmt::format("{:.1f}", percent));
    }
    table += fmt::format(" {:>7} {:>8} {:>7.2f}\n", s.grasps, s.grasps > 0 ? fmt::format("{:.4f}", s.bestEpsilon) : "-",
                         totalSeconds(s));
  }
  table += "  N, R, M   surface samples, rolls and preshapes; their product is the trials\n";
  for (const Column& column : columns) table += fmt::format("  {:<9} {}\n", column.heading, column.meaning);
  table +=
      "  grasps    that are stored, of those that end force closed as many as the job keeps\n"
      "  best eps  the largest epsilon of a stored grasp, on the job's cone edges; - where none is stored\n"
      "  core s    seconds of one core\n";
  return table;
}

int runList(const Database& database, bool asJson) {
  std::vector<std::string> failures;
  const std::vector<GraspSetSummary> summaries = database.summaries(failures);
  for (const std::string& failure : failures) logError(failure);
  if (asJson) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const GraspSetSummary& summary : summaries) list.push_back(toJson(summary));
    fmt::print("{}\n", list.dump(1));
  } else {
    fmt::print("{}{} sets in {}\n", summaryTable(summaries), summaries.size(), database.folder().string());
  }
  return failures.empty() ? kExitDone : kExitItemFailed;
}

namespace {

nlohmann::ordered_json infoJson(const GraspSetSummary& summary) {
  nlohmann::ordered_json json = toJson(summary);
  if (const std::optional<PhysicsSet> physics =
          physicsOf(summary.path, summary.inputHash, summary.setVersion, summary.grasps))
    json["physics"] = toJson(*physics);
  return json;
}

}  // namespace

int runInfo(const fs::path& path, bool asJson) {
  if (!fs::is_directory(path)) {
    const GraspSetSummary summary = readSummary(path);
    asJson ? fmt::print("{}\n", infoJson(summary).dump(1)) : printInfo(summary);
    return kExitDone;
  }
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file() && matchesGlob(entry.path().filename().string(), "v[0-9]*.h5"))
      files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) throw InputError(fmt::format("{}: holds no grasp set", path.string()));
  std::size_t damaged = 0;
  const std::vector<GraspSetSummary> summaries = readAll(files, damaged);
  if (asJson) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const GraspSetSummary& summary : summaries) list.push_back(infoJson(summary));
    fmt::print("{}\n", list.dump(1));
  } else {
    for (const GraspSetSummary& summary : summaries) printInfo(summary);
  }
  return damaged == 0 ? kExitDone : kExitItemFailed;
}

}  // namespace handhold
