// Times queries on one large set beside reading the whole of it, and `list` over a large catalog with and without its
// index, in one run.
//
//     bench_store [--json [FILE]] [--quick]
//
// Prints tables; `--json` prints JSON instead, `--json FILE` writes it beside the tables. Files are read from the page
// cache: they were written just before.
#include "bench/options.h"
#include "core/file.h"
#include "store/database.h"
#include "store/layout.h"
#include "store/synthetic_set.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct Sizes {
  std::size_t grasps = 100'000, sets = 10'000;
  int repeats = 15, slowRepeats = 3;
};
constexpr Sizes kQuick = {5'000, 300, 5, 3};

struct Times {
  double medianMs = 0, leastMs = 0;  // the least is what is left when others leave the machine alone
};

template <class Work>
Times timesOf(int repeats, const Work& work) {
  std::vector<double> times;
  for (int i = 0; i < repeats; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
  }
  std::nth_element(times.begin(), times.begin() + repeats / 2, times.end());
  return {times[static_cast<std::size_t>(repeats / 2)], *std::min_element(times.begin(), times.end())};
}

/// A surface of about 5 MB.
TriangleMesh largeMesh() {
  constexpr std::uint32_t kSide = 380;
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
    const float x = static_cast<float>(i % kSide) / kSide, y = static_cast<float>(i / kSide) / kSide;
    mesh.vertices.emplace_back(x, y, x * y);
    if (i % kSide == 0 || i < kSide) continue;
    mesh.triangles.push_back({i, i - 1, i - kSide});
    mesh.triangles.push_back({i - 1, i - kSide - 1, i - kSide});
  }
  return mesh;
}

/// Joints, contacts and turns as many as those of a Barrett hand.
GraspSet largeSet(std::size_t grasps) {
  GraspSet set = syntheticSet({.samples = 2000, .rolls = 16, .preshapes = 4, .grasps = grasps});
  set.objectMesh = largeMesh();
  SyntheticNumbers numbers(2);
  set.jointNames.clear();
  for (int i = 0; i < 8; ++i) set.jointNames.push_back(fmt::format("joint_{}", i));
  numbers.fill(set.jointPosition, 8 * grasps);
  numbers.fill(set.preshapeJointPosition, 8 * grasps);
  constexpr std::uint32_t kContacts = 12;
  set.contactLink.assign(kContacts * grasps, 2);
  for (std::size_t i = 0; i <= grasps; ++i) set.contactBegin[i] = kContacts * static_cast<std::uint32_t>(i);
  numbers.fill(set.contactPosition, 3 * kContacts * grasps);
  set.contactNormal.clear();
  numbers.fillDirections(set.contactNormal, kContacts * grasps);
  for (std::size_t i = 0; i < grasps; ++i) {
    const Eigen::Quaterniond turn(Eigen::Vector4d(numbers.next(), numbers.next(), numbers.next(), 1.5).normalized());
    std::copy(turn.coeffs().begin(), turn.coeffs().end(),
              set.handPose.begin() + static_cast<std::ptrdiff_t>(7 * i + 3));
    set.criticalFriction[i] = static_cast<float>(0.2 + 0.19 * numbers.next());
  }
  return set;
}

/// Runs a command of the program and throws its text away.
Times programTimes(int repeats, const fs::path& database, const std::string& arguments) {
  const std::string command = fmt::format("'{}' {} --db '{}' > /dev/null", (programFolder() / "handhold").string(),
                                          arguments, database.string());
  return timesOf(repeats, [&] {
    if (std::system(command.c_str()) != 0) throw std::runtime_error(command + ": failed");
  });
}

ordered_json row(const std::string& what, const Times& times, const Times& baseline) {
  return {{"what", what},
          {"median_ms", times.medianMs},
          {"least_ms", times.leastMs},
          {"baseline_over_this", baseline.medianMs / times.medianMs}};
}

ordered_json benchQueries(const Sizes& sizes) {
  const TestFolder folder;
  const Database database(folder.path());
  const fs::path path = database.write(largeSet(sizes.grasps));
  ordered_json rows = ordered_json::array();
  const Times whole = timesOf(sizes.repeats, [&] { readGraspSet(path); });
  rows.push_back(row("readGraspSet (baseline)", whole, whole));
  rows.push_back(row("readSummary", timesOf(sizes.repeats, [&] { readSummary(path); }), whole));
  const auto add = [&](const std::string& what, const GraspQuery& query) {
    std::size_t found = 0;
    const Times times = timesOf(sizes.repeats, [&] { found = database.query(query).sets.at(0).grasps.size(); });
    rows.push_back(row(fmt::format("query {} ({} found)", what, found), times, whole));
  };
  GraspQuery query;
  query.top = 50;
  add("top 50", query);
  query.friction = 0.3;
  query.approach = {Eigen::Vector3d::UnitZ(), 1.0};
  query.near = {Eigen::Vector3d::Zero(), 1.0};
  add("top 50, friction, approach, near", query);
  GraspQuery diverse;
  diverse.top = 50;
  diverse.diverse = true;
  add("top 50, diverse", diverse);
  add("all", {});
  for (const char* arguments : {"query --top 50", "query --top 50 --format json", "query --top 50 --diverse"}) {
    rows.push_back(
        row(fmt::format("program: {}", arguments), programTimes(sizes.repeats, folder.path(), arguments), whole));
  }
  return {{"grasps", sizes.grasps}, {"megabytes", static_cast<double>(fs::file_size(path)) / 1e6}, {"rows", rows}};
}

ordered_json benchCatalog(const Sizes& sizes) {
  const TestFolder folder;
  const Database database(folder.path());
  GraspSet set = syntheticSet();
  set.setVersion = 1;
  for (std::size_t i = 0; i < sizes.sets; ++i) {  // without Database::write's wait for the disk
    set.object = fmt::format("object_{}", i / 2);
    set.hand = i % 2 == 0 ? "barrett" : "jaw";
    const fs::path path = database.setPath(set.object, set.hand, 1);
    fs::create_directories(path.parent_path());
    writeBytes(path, encodeGraspSet(set));
  }
  ordered_json rows = ordered_json::array();
  const Times slow = programTimes(sizes.slowRepeats, folder.path(), "list");
  rows.push_back(row("program: list, no index (baseline)", slow, slow));
  const Times nothing = programTimes(sizes.slowRepeats, folder.path(), "query --min-epsilon 9 2> /dev/null");
  rows.push_back(row("program: query --min-epsilon 9, no index", nothing, slow));
  rows.push_back(row("program: index, first", programTimes(1, folder.path(), "index"), slow));
  rows.push_back(row("program: index, again", programTimes(sizes.slowRepeats, folder.path(), "index"), slow));
  for (const char* arguments : {"list", "list --format json", "query --min-epsilon 9 2> /dev/null"}) {
    const std::string_view text = arguments;
    rows.push_back(row(fmt::format("program: {}, index", text.substr(0, text.find(" 2>"))),
                       programTimes(sizes.repeats, folder.path(), arguments), slow));
  }
  return {{"sets", sizes.sets},
          {"index_megabytes", static_cast<double>(fs::file_size(folder.path() / "index.sqlite")) / 1e6},
          {"rows", rows}};
}

void printRows(const ordered_json& rows) {
  fmt::print("{:<58} {:>10} {:>10} {:>18}\n", "", "median ms", "least ms", "baseline / this");
  for (const ordered_json& r : rows) {
    fmt::print("{:<58} {:>10.2f} {:>10.2f} {:>18.2f}\n", r["what"].get<std::string>(), r["median_ms"].get<double>(),
               r["least_ms"].get<double>(), r["baseline_over_this"].get<double>());
  }
}

int run(int argc, char** argv) {
  const auto options = bench::parseOptions(argc, argv, "bench_store");
  if (!options) return 2;
  const Sizes sizes = options->quick ? kQuick : Sizes{};
  ordered_json report = {
      {"cores", std::thread::hardware_concurrency()}, {"compiler", __VERSION__}, {"build_type", HANDHOLD_BUILD_TYPE}};
  report["one_set"] = benchQueries(sizes);
  report["catalog"] = benchCatalog(sizes);
  if (!bench::writeReport(report, *options)) return 0;
  fmt::print("{} cores, gcc {}, {}\n\n", report["cores"].get<unsigned>(), report["compiler"].get<std::string>(),
             report["build_type"].get<std::string>());
  fmt::print("one set of {} grasps, {:.1f} MB\n", sizes.grasps, report["one_set"]["megabytes"].get<double>());
  printRows(report["one_set"]["rows"]);
  fmt::print("\ncatalog of {} sets, index of {:.1f} MB\n", sizes.sets,
             report["catalog"]["index_megabytes"].get<double>());
  printRows(report["catalog"]["rows"]);
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) {
  try {
    return handhold::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "bench_store: {}\n", error.what());
    return 1;
  }
}
