// What it costs to run a job again when nothing changed, beside reading the meshes of its catalog.
//
//     bench_catalog [SETS] [MESH_KILOBYTES]        default: 10000 sets, 20 kB
//
// Makes a folder of mesh files and a database with an up-to-date set for each (synthetic, small) in the temporary
// folder, runs the job on it, and removes them. Nothing is built: only what finds this out is timed.
#include "build/build_job.h"
#include "build/build_set.h"
#include "build/mesh_hashes.h"
#include "core/file.h"
#include "store/layout.h"
#include "store/synthetic_set.h"

#include <chrono>
#include <cstdlib>
#include <functional>
#include <thread>

#include <fmt/core.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

double secondsOf(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

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
    if (unchanged != sets_) {
      fmt::print(stderr, "{} of {} sets were unchanged, want all\n", unchanged, sets_);
      std::exit(1);
    }
    return seconds;
  }

 private:
  std::size_t sets_;
  TestFolder folder_;
  std::chrono::steady_clock::time_point meshesWritten_;
};

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) {
  const std::size_t sets = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 10'000;
  const std::size_t kilobytes = argc > 2 ? std::strtoul(argv[2], nullptr, 10) : 20;
  if (sets == 0 || kilobytes == 0) {
    fmt::print(stderr, "usage: bench_catalog [SETS] [MESH_KILOBYTES], both at least 1\n");
    return 2;
  }
  const handhold::Catalog catalog(sets, 1000 * kilobytes);
  catalog.waitUntilSettled();
  fmt::print("{} unchanged sets, meshes of {} kB, {}, one thread\n", sets, kilobytes, HANDHOLD_BUILD_TYPE);
  const double hashing = catalog.hashAll();
  const auto print = [&](const char* what, double seconds) {
    fmt::print("{:<46} {:8.3f} s  {:7.1f} us a set  {:6.2f} of hashing\n", what, seconds,
               1e6 * seconds / static_cast<double>(sets), seconds / hashing);
  };
  print("hashing all meshes (in the page cache)", hashing);
  print("job again, hashes not remembered", catalog.run("folder"));
  print("job again", catalog.run("folder"));
  print("job again, catalog as CSV", catalog.run("csv"));
  return 0;
}
