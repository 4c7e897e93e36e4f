// What a catalog costs: threads, memory and bytes of real builds of the demo catalog, the projection for a large one,
// and a job run again when nothing changed. (`list` over 10,000 sets and queries over 100,000 grasps: bench_store.)
//
//     bench_catalog [--json [FILE]] [--quick]
//
// The builds are runs of the program beside this one, so that each has a peak of memory of its own. The unchanged sets
// are synthetic and small, with a mesh file of 20 kB each; nothing is built for them, only what finds this out is
// timed.
#include "bench/options.h"
#include "bench/timings.h"
#include "build/build_job.h"
#include "build/build_set.h"
#include "build/estimate.h"
#include "build/mesh_hashes.h"
#include "core/file.h"
#include "store/layout.h"
#include "store/synthetic_set.h"

#include <algorithm>
#include <chrono>
#include <functional>
#include <stdexcept>
#include <thread>

#include <fcntl.h>
#include <fmt/ranges.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct Sizes {
  std::size_t unchangedSets = 10'000, meshBytes = 20'000;
  int threadSamples = 1000, demoSamples = 120, repeats = 3;
};
constexpr Sizes kQuick = {500, 20'000, 60, 20, 1};

// The catalog of the projection, with the settings of jobs/full.yaml.
constexpr double kObjects = 20'000, kCores = 64;
constexpr int kSamples = 2000, kRolls = 16;

double secondsOf(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// ---- Real builds -----------------------------------------------------------------------------------------------

struct ProgramRun {
  double seconds = 0, peakMegabytes = 0;
};

/// Runs the program, its output thrown away. The peak is that of its largest process.
ProgramRun runProgram(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), (programFolder() / "handhold").string());
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t silent;
  posix_spawn_file_actions_init(&silent);
  for (const int stream : {1, 2}) posix_spawn_file_actions_addopen(&silent, stream, "/dev/null", O_WRONLY, 0);
  rusage usage{};
  int status = 0;
  const double seconds = secondsOf([&] {
    pid_t process = 0;
    if (::posix_spawn(&process, argv[0], &silent, nullptr, argv.data(), environ) != 0) status = -1;
    if (status == 0) ::wait4(process, &status, 0, &usage);
  });
  posix_spawn_file_actions_destroy(&silent);
  if (status != 0) throw std::runtime_error(fmt::format("{}: failed", fmt::join(arguments, " ")));
  return {seconds, static_cast<double>(usage.ru_maxrss) * 1024 / 1e6};
}

/// jobs/demo.yaml's catalog with another sampling.
std::string demoJob(const fs::path& folder, const std::string& hands, int samples, int rolls) {
  const std::string source = HANDHOLD_SOURCE_DIR;
  const std::string demo = readFile(source + "/jobs/demo.yaml");
  std::string text = demo.substr(0, demo.find("\nhands:") + 1);
  for (std::size_t at = text.find("../"); at != std::string::npos; at = text.find("../")) {
    text.replace(at, 3, source + "/");
  }
  const fs::path path = folder / fmt::format("{}x{}.yaml", samples, rolls);
  writeBytes(path, fmt::format("{}hands: {}\nsampling: {{samples: {}, rolls: {}}}\n", text, hands, samples, rolls));
  return path.string();
}

/// One set with 1 and with 2 threads. The hand's fields, made once a run of any length, do not count as its time.
ordered_json benchThreads(const Sizes& sizes) {
  const TestFolder folder;
  const std::string job =
      demoJob(folder.path(), fmt::format("[{}/hands/barrett]", HANDHOLD_SOURCE_DIR), sizes.threadSamples, kRolls);
  ordered_json rows = ordered_json::array();
  for (const int threads : {1, 2}) {
    double seconds = std::numeric_limits<double>::infinity(), peak = 0;
    std::size_t trials = 0;
    for (int i = 0; i < sizes.repeats; ++i) {
      const fs::path database = folder.path() / fmt::format("db-{}-{}", threads, i);
      const ProgramRun run = runProgram({"build", job, "--object", "mug", "--db", database.string(), "--threads",
                                         std::to_string(threads), "--progress", "none"});
      const GraspSet set = readGraspSet(Database(database).setPath("mug", "barrett", 1));
      seconds = std::min(seconds, run.seconds - set.seconds.at("fields"));
      peak = std::max(peak, run.peakMegabytes);
      trials = set.trialCount();
    }
    rows.push_back({{"threads", threads},
                    {"trials", trials},
                    {"seconds", seconds},
                    {"trials_per_second", static_cast<double>(trials) / seconds},
                    {"peak_megabytes", peak}});
  }
  const auto value = [&](int row, const char* key) { return rows[row][key].get<double>(); };
  return {{"rows", rows},
          {"efficiency", value(1, "trials_per_second") / (2 * value(0, "trials_per_second"))},
          {"megabytes_per_further_thread", value(1, "peak_megabytes") - value(0, "peak_megabytes")}};
}

/// How many numbers a set holds, each of which would be four bytes as a raw float32.
std::size_t numbersOf(const GraspSet& set) {
  std::size_t count = 0;
  forEachArray([&](const char*, auto member, std::string_view) { count += (set.*member).size(); });
  const auto add = [&](const TriangleMesh& mesh) { count += 3 * (mesh.vertices.size() + mesh.triangles.size()); };
  add(set.objectMesh);
  std::for_each(set.linkMeshes.begin(), set.linkMeshes.end(), add);
  return count;
}

/// The demo catalog with two hands: its bytes, and what its rates say of a catalog of thousands.
ordered_json benchDemo(const Sizes& sizes, double efficiency) {
  const TestFolder folder;
  const std::string source = HANDHOLD_SOURCE_DIR;
  const std::string hands = fmt::format("[{0}/hands/barrett, {0}/hands/jaw]", source);
  const Database database(folder.path() / "db");
  runProgram({"build", demoJob(folder.path(), hands, sizes.demoSamples, 8), "--db", database.folder().string(),
              "--progress", "none"});
  std::size_t grasps = 0, bytes = 0, numbers = 0, sets = 0;
  for (const fs::path& path : database.files()) {
    const GraspSet set = readGraspSet(path);
    grasps += set.graspCount();
    bytes += fs::file_size(path);
    numbers += numbersOf(set);
    ++sets;
  }
  const Job job = loadJob(demoJob(folder.path(), hands, kSamples, kRolls));
  const std::vector<Hand> loaded = loadHands(job);
  double coreSeconds = 0, projectedBytes = 0, trials = 0;
  for (const HandEstimate& estimate : estimateCost(job, loaded, database, planJob(job, loaded, database, {}))) {
    const auto hand =
        std::find_if(loaded.begin(), loaded.end(), [&](const Hand& h) { return h.name == estimate.hand; });
    const double perSet = static_cast<double>(kSamples * kRolls) * static_cast<double>(hand->preshapes.size());
    const CostRates& rates = estimate.rates;
    trials += kObjects * perSet;
    coreSeconds += kObjects * (rates.secondsPerSet +
                               perSet * (rates.secondsPerTrial + rates.shareForceClosed * rates.secondsPerGrasp));
    projectedBytes += kObjects * (rates.bytesPerSet + kSamples * rates.bytesPerSample +
                                  perSet * (rates.bytesPerTrial + rates.shareForceClosed * rates.bytesPerGrasp));
  }
  const double perGrasps = 1e4 / static_cast<double>(grasps) / 1e6;
  return {{"storage",
           {{"sets", sets},
            {"grasps", grasps},
            {"megabytes_per_10000_grasps", static_cast<double>(bytes) * perGrasps},
            {"raw_float32_megabytes", 4 * static_cast<double>(numbers) * perGrasps}}},
          {"projection",
           {{"objects", kObjects},
            {"hands", loaded.size()},
            {"cores", kCores},
            {"samples", kSamples},
            {"rolls", kRolls},
            {"trials", trials},
            {"core_hours", coreSeconds / 3600},
            {"hours", coreSeconds / 3600 / kCores / efficiency},
            {"gigabytes", projectedBytes / 1e9}}}};
}

// ---- Unchanged sets --------------------------------------------------------------------------------------------

/// A catalog whose sets are all there.
class Catalog {
 public:
  Catalog(std::size_t sets, std::size_t meshBytes) : sets_(sets) {
    const std::string source = HANDHOLD_SOURCE_DIR;
    const std::string rest = "hands: [" + source + "/hands/jaw]\nsampling: {samples: 12, rolls: 4}\n";
    std::string csv = "name,mesh,unit\n", mesh(meshBytes, 'x');
    fs::create_directories(folder_.path() / "meshes");
    for (std::size_t i = 0; i < sets; ++i) {
      const std::string name = fmt::format("object_{:06}", i);
      std::copy(name.begin(), name.end(), mesh.begin());
      writeBytes(folder_.path() / "meshes" / (name + ".stl"), mesh);
      csv += fmt::format("{0},meshes/{0}.stl,m\n", name);
    }
    meshesWritten_ = std::chrono::steady_clock::now();
    writeBytes(folder_.path() / "items.csv", csv);
    writeBytes(jobPath("folder"), "catalog: [{folder: meshes, glob: \"*.stl\", unit: m}]\n" + rest);
    writeBytes(jobPath("csv"), "catalog: [{csv: items.csv}]\n" + rest);
    const Job job = loadJob(jobPath("folder"));
    const std::vector<Hand> hands = loadHands(job);
    GraspSet set = syntheticSet();
    set.setVersion = 1;
    set.hand = "jaw";
    for (const CatalogItem& item : job.catalog) {
      set.object = item.name;
      set.inputHash = inputHash(job, item, meshHash(item.mesh), hands[0]);
      const fs::path path = database().setPath(set.object, set.hand, 1);
      fs::create_directories(path.parent_path());
      writeBytes(path, encodeGraspSet(set));
    }
  }

  std::string jobPath(const std::string& kind) const { return (folder_.path() / (kind + ".yaml")).string(); }
  Database database() const { return Database(folder_.path() / "db"); }

  /// Hashes of files that were just written are not remembered.
  void waitUntilSettled() const { std::this_thread::sleep_until(meshesWritten_ + std::chrono::milliseconds(3500)); }

  double hashAll() const {
    const Job job = loadJob(jobPath("folder"));
    return secondsOf([&] {
      for (const CatalogItem& item : job.catalog) meshHash(item.mesh);
    });
  }

  /// A whole run, as `handhold build` does it.
  double run(const std::string& kind) const {
    std::size_t unchanged = 0;
    const double seconds = secondsOf([&] {
      const Job job = loadJob(jobPath(kind));
      BuildOptions options;
      options.progress = ProgressMode::none;
      const std::atomic<bool> never{false};
      for (const SetReport& report : buildJob(job, loadHands(job), database(), options, never)) {
        unchanged += report.state == SetReport::State::unchanged ? 1 : 0;
      }
    });
    if (unchanged != sets_) throw std::runtime_error(fmt::format("{} of {} sets were unchanged", unchanged, sets_));
    return seconds;
  }

 private:
  std::size_t sets_;
  TestFolder folder_;
  std::chrono::steady_clock::time_point meshesWritten_;
};

ordered_json benchUnchanged(const Sizes& sizes) {
  const Catalog catalog(sizes.unchangedSets, sizes.meshBytes);
  catalog.waitUntilSettled();
  ordered_json rows = ordered_json::array();
  const auto add = [&](const char* what, double seconds) { rows.push_back({{"what", what}, {"seconds", seconds}}); };
  add("hashing all meshes (in the page cache)", catalog.hashAll());
  add("job again, hashes not remembered", catalog.run("folder"));
  add("job again", catalog.run("folder"));
  add("job again, catalog as CSV", catalog.run("csv"));
  return {{"sets", sizes.unchangedSets}, {"mesh_bytes", sizes.meshBytes}, {"rows", rows}};
}

// ---- Tables ----------------------------------------------------------------------------------------------------

void printTables(const ordered_json& report) {
  const auto number = [](const ordered_json& object, const char* key) { return object[key].get<double>(); };
  fmt::print("{}, {} cores, {}\n\nmug x barrett, fields of the hand not counted\n", report["cpu"].get<std::string>(),
             report["cores"].get<unsigned>(), report["build_type"].get<std::string>());
  fmt::print("{:>8} {:>8} {:>9} {:>9} {:>9}\n", "threads", "trials", "s", "trials/s", "peak MB");
  const ordered_json& threads = report["threads"];
  for (const ordered_json& row : threads["rows"]) {
    fmt::print("{:>8} {:>8} {:>9.2f} {:>9.0f} {:>9.0f}\n", row["threads"].get<int>(), row["trials"].get<std::size_t>(),
               number(row, "seconds"), number(row, "trials_per_second"), number(row, "peak_megabytes"));
  }
  fmt::print("efficiency of 2 threads {:.2f}, {:.1f} MB for a further thread\n", number(threads, "efficiency"),
             number(threads, "megabytes_per_further_thread"));
  const ordered_json& storage = report["storage"];
  fmt::print("\n{} sets of the demo catalog, {} grasps\n{:.1f} MB for 10,000 grasps, {:.1f} MB as raw float32\n",
             storage["sets"].get<int>(), storage["grasps"].get<std::size_t>(),
             number(storage, "megabytes_per_10000_grasps"), number(storage, "raw_float32_megabytes"));
  const ordered_json& projection = report["projection"];
  fmt::print("\n{:.0f} objects x {} hands, {} samples, {} rolls: {:.2e} trials\n", number(projection, "objects"),
             projection["hands"].get<int>(), projection["samples"].get<int>(), projection["rolls"].get<int>(),
             number(projection, "trials"));
  fmt::print("{:.0f} core-hours, {:.1f} hours on {:.0f} cores, {:.0f} GB\n", number(projection, "core_hours"),
             number(projection, "hours"), number(projection, "cores"), number(projection, "gigabytes"));
  const ordered_json& unchanged = report["unchanged"];
  const double hashing = number(unchanged["rows"][0], "seconds"), sets = number(unchanged, "sets");
  fmt::print("\n{:.0f} unchanged sets, meshes of {:.0f} kB, one thread\n", sets, number(unchanged, "mesh_bytes") / 1e3);
  for (const ordered_json& row : unchanged["rows"]) {
    const double seconds = number(row, "seconds");
    fmt::print("{:<46} {:8.3f} s  {:7.1f} us a set  {:6.2f} of hashing\n", row["what"].get<std::string>(), seconds,
               1e6 * seconds / sets, seconds / hashing);
  }
}

int run(int argc, char** argv) {
  const auto options = bench::parseOptions(argc, argv, "bench_catalog");
  if (!options) return 2;
  const Sizes sizes = options->quick ? kQuick : Sizes{};
  ordered_json report = {{"cpu", bench::cpuModel()},
                         {"cores", std::thread::hardware_concurrency()},
                         {"compiler", __VERSION__},
                         {"build_type", HANDHOLD_BUILD_TYPE}};
  report["threads"] = benchThreads(sizes);
  report.update(benchDemo(sizes, report["threads"]["efficiency"].get<double>()));
  report["unchanged"] = benchUnchanged(sizes);
  if (bench::writeReport(report, *options)) printTables(report);
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) {
  try {
    return handhold::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "bench_catalog: {}\n", error.what());
    return 1;
  }
}
