#include "app/commands.h"
#include "core/error.h"
#include "store/compare.h"

#include <charconv>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

/// A set file, or OBJECT/HAND (its newest version) or OBJECT/HAND/vN in the database.
fs::path resolveSet(const std::string& text, const Database& database) {
  if (fs::is_regular_file(text)) return text;
  std::vector<std::string> parts;
  for (const fs::path& part : fs::path(text)) parts.push_back(part.string());
  int version = 0;
  if (parts.size() == 3 && parts[2].starts_with('v')) {
    const char* end = parts[2].data() + parts[2].size();
    const auto [stop, error] = std::from_chars(parts[2].data() + 1, end, version);
    if (error != std::errc() || stop != end) version = 0;
  }
  const bool isName = !fs::path(text).is_absolute() && (parts.size() == 2 || (parts.size() == 3 && version > 0));
  if (!isName) throw InputError(fmt::format("{}: is no file, want a set file, OBJECT/HAND or OBJECT/HAND/vN", text));
  if (version == 0) version = database.newestVersion(parts[0], parts[1]);
  if (version == 0) {
    throw InputError(fmt::format("{}: {} has no set of {} x {}", text, database.folder().string(), parts[0], parts[1]));
  }
  return database.setPath(parts[0], parts[1], version);
}

template <class Value>
ordered_json toJson(const std::vector<Pair<Value>>& pairs) {
  ordered_json list = ordered_json::array();
  for (const auto& pair : pairs) list.push_back({{"name", pair.name}, {"a", pair.a}, {"b", pair.b}});
  return list;
}

void printJson(const fs::path& a, const fs::path& b, const SetComparison& c) {
  const ordered_json json = {{"a", a.string()},
                             {"b", b.string()},
                             {"equal", c.datasets.empty()},
                             {"datasets", c.datasets},
                             {"inputs", toJson(c.inputs)},
                             {"counts", toJson(c.counts)},
                             {"quality", toJson(c.quality)},
                             {"grasps",
                              {{"common", c.common},
                               {"only_a", c.onlyA},
                               {"only_b", c.onlyB},
                               {"epsilon_changed", c.epsilonChanged},
                               {"largest_epsilon_change", c.largestEpsilonChange},
                               {"pose_changed", c.poseChanged},
                               {"largest_shift", c.largestShift},
                               {"largest_turn", c.largestTurn}}}};
  fmt::print("{}\n", json.dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void printTable(const fs::path& a, const fs::path& b, const SetComparison& c) {
  fmt::print("A {}\nB {}\n", a.string(), b.string());
  if (c.datasets.empty()) {
    fmt::print("equal (timings, generator and version number aside)\n");
    for (const auto& input : c.inputs) fmt::print("  {}: {} -> {}\n", input.name, input.a, input.b);
    return;
  }
  fmt::print("inputs{}\n", c.inputs.empty() ? ": equal" : "");
  for (const auto& input : c.inputs) fmt::print("  {}: {} -> {}\n", input.name, input.a, input.b);
  fmt::print("{:<22} {:>10} {:>10} {:>10}\n", "counts", "A", "B", "B - A");
  for (const auto& count : c.counts) {
    if (count.a == 0 && count.b == 0) continue;
    fmt::print("  {:<20} {:>10} {:>10} {:>+10}\n", count.name, count.a, count.b,
               static_cast<long long>(count.b) - static_cast<long long>(count.a));
  }
  fmt::print("quality\n");
  for (const auto& value : c.quality) {
    fmt::print("  {:<20} {:>10.5f} {:>10.5f} {:>+10.5f}\n", value.name, value.a, value.b, value.b - value.a);
  }
  fmt::print("grasps of the same target, approach, roll and preshape\n");
  fmt::print("  in both {}, only in A {}, only in B {}\n", c.common, c.onlyA, c.onlyB);
  if (c.common > 0) {
    fmt::print("  epsilon differs in {}, by at most {:.3g}\n", c.epsilonChanged, c.largestEpsilonChange);
    fmt::print("  hand pose differs in {}, by at most {:.3g} mm and {:.3g} degrees\n", c.poseChanged,
               1e3 * c.largestShift, c.largestTurn * 57.29577951308232);
  }
  fmt::print("datasets that differ:");
  for (const std::string& dataset : c.datasets) fmt::print(" {}", dataset);
  fmt::print("\n");
}

}  // namespace

int runDiff(const std::string& a, const std::string& b, bool asJson, const Database& database) {
  try {
    const fs::path pathA = resolveSet(a, database), pathB = resolveSet(b, database);
    const SetComparison comparison = compareSets(readGraspSet(pathA), readGraspSet(pathB));
    asJson ? printJson(pathA, pathB, comparison) : printTable(pathA, pathB, comparison);
    return comparison.datasets.empty() ? 0 : 1;
  } catch (const SystemError& error) {
    throw InputError(error.what());  // 1 would say that the sets differ
  }
}

}  // namespace handhold
