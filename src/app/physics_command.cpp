#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"

#ifdef HANDHOLD_PHYSICS

#include "physics/compare_groups.h"
#include "physics/label_set.h"
#include "view/colours.h"
#include "view/grasp_picture.h"
#include "view/png.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr double kPictureSeconds = 0.2;

/// In the order of PhysicsTest, each once, whatever was written.
std::vector<PhysicsTest> testsOf(const PhysicsCommand& command) {
  std::vector<PhysicsTest> tests;
  for (std::size_t i = 0; i < kPhysicsTestNames.size(); ++i) {
    if (std::find(command.tests.begin(), command.tests.end(), kPhysicsTestNames[i]) != command.tests.end()) {
      tests.push_back(static_cast<PhysicsTest>(i));
    }
  }
  return tests;
}

void requireMass(const SimulatedSet& set, const fs::path& path, const std::vector<PhysicsTest>& tests) {
  if (set.model().knowsMass() || tests.back() == PhysicsTest::pull) return;
  throw InputError(
      fmt::format("{}: its job gives the object no mass, want one for --test weight or lift", path.string()));
}

std::string heldText(const PhysicsSet& physics) {
  std::string text;
  for (const std::string& test : physics.testNames) {
    text +=
        fmt::format("{}{} {} of {}", text.empty() ? "" : ", ", test, countHeld(physics, test), physics.graspCount());
  }
  return text;
}

/// False when stopped.
bool label(const SetFile& file, const PhysicsCommand& command, SetLoader& loader, const JobSystem& jobs,
           Progress& progress, std::size_t finished, const std::atomic<bool>& stop) {
  const std::unique_ptr<SimulatedSet> set = loader.load(file.path);
  const std::string name = fmt::format("{} x {}", file.object, file.hand);
  progress.begin(name, finished);
  LabelRequest request{testsOf(command), command.top};
  requireMass(*set, file.path, request.tests);
  const std::optional<PhysicsSet> known =
      physicsOf(file.path, set->set().inputHash, set->set().setVersion, set->set().graspCount());
  const std::size_t wanted = std::min(command.top.value_or(set->set().graspCount()), set->set().graspCount());
  if (known && known->settings == settingsText(*set, request.tests) && known->graspCount() >= wanted) {
    fmt::print("{}: unchanged, held: {}\n", name, heldText(*known));
    progress.skipTrials(wanted);
    return true;
  }
  const std::clock_t start = std::clock();  // of all threads
  const std::size_t before = progress.counters().trials;
  const auto physics = labelSet(*set, request, known, file.path.parent_path(), jobs, progress.counters(), stop);
  if (!physics) return false;
  writePhysics(physicsPath(file.path), *physics);
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  const auto simulated = static_cast<double>(progress.counters().trials - before);
  fmt::print("{}: held: {} ({:.1f} grasps/s a core; shape error p95 {:.2f} mm, most {:.2f} mm)\n", name,
             heldText(*physics), simulated > 0 ? simulated / seconds : 0, 1e3 * physics->shapeP95,
             1e3 * physics->shapeMost);
  std::fflush(stdout);
  return true;
}

/// How many grasps of the sets are to be simulated, from their summaries.
std::size_t countGrasps(const std::vector<SetFile>& files, const PhysicsCommand& command) {
  std::size_t grasps = 0;
  for (const SetFile& file : files) {
    try {
      const std::size_t stored = readSummary(file.path).grasps;
      grasps += std::min(stored, command.top.value_or(stored));
    } catch (const InputError&) {  // told when its turn comes
    }
  }
  return grasps;
}

int labelSets(const PhysicsCommand& command, const Database& database) {
  const std::vector<SetFile> files = pickedSets(database, command);
  const std::atomic<bool>& stop = stopOnSignals();
  const JobSystem jobs(command.threads);
  SetLoader loader(command.friction);
  Progress progress(command.progress, files.size(), countGrasps(files, command), {"grasps", "held"});
  std::size_t failed = 0, finished = 0;
  for (; finished < files.size() && !stop; ++finished) {
    try {
      if (!label(files[finished], command, loader, jobs, progress, finished, stop)) break;
    } catch (const InputError& error) {
      logError(error.what());
      ++failed;
    }
  }
  progress.end(finished);
  if (finished < files.size()) logWarning(fmt::format("stopped: {} of {} sets are done", finished, files.size()));
  return failed == 0 && finished == files.size() ? kExitDone : kExitItemFailed;
}

/// The pictures of a replay, one file each, from one eye.
class Pictures {
 public:
  Pictures(const SimulatedSet& set, std::size_t grasp, const fs::path& folder)
      : set_(set.set()), folder_(folder), toEye_(graspView(set_, grasp, graspScene(set_, grasp))) {
    createFolders(folder_);
    settings_.width = 480, settings_.height = 360;
  }

  void add(const PhysicsFrame& frame) {
    if (frame.seconds < next_) return;
    next_ = frame.seconds + kPictureSeconds - 1e-6;
    // Drawn with the hand where the grasp has it, as the camera looks at the object frame.
    const Eigen::Isometry3d X_OW = first_ ? *first_ : frame.X_WO.inverse();
    first_ = X_OW;
    std::vector<ScenePart> scene{{set_.objectMesh, X_OW * frame.X_WO, kObjectColour, false}};
    for (std::size_t i = 0; i < frame.X_WL.size(); ++i) {
      if (set_.linkMeshes[i].triangles.empty()) continue;
      scene.push_back({set_.linkMeshes[i], X_OW * frame.X_WL[i], kLinkColour, false});
    }
    if (!camera_) camera_ = frameScene(scene, toEye_, 4.0 / 3);
    writePng(render(scene, *camera_, settings_), folder_ / fmt::format("{:03}.png", count_++));
  }
  std::size_t count() const { return count_; }

 private:
  const GraspSet& set_;
  fs::path folder_;
  Eigen::Vector3d toEye_;
  RenderSettings settings_;
  std::optional<Camera> camera_;
  std::optional<Eigen::Isometry3d> first_;
  double next_ = 0;
  std::size_t count_ = 0;
};

void printResult(const TestResult& result) {
  constexpr double kDegree = std::numbers::pi / 180;
  const SettledResult& settled = result.settled;
  fmt::print("{}: squeezed with {:.1f} N; {} contacts, {}; moved {:.2f} mm, turned {:.2f} degrees, {:.2f} mm deep\n",
             kPhysicsTestNames[static_cast<std::size_t>(result.test)], settled.squeeze, settled.contacts.size(),
             settled.closed ? "force closed" : "not force closed", 1e3 * settled.displacement,
             settled.rotation / kDegree, 1e3 * settled.penetration);
  for (std::size_t k = 0; k < result.directions.size(); ++k) {
    const DirectionResult& direction = result.directions[k];
    fmt::print("  {}: {:<8} moved {:6.2f} mm, turned {:6.2f} degrees, {:.2f} mm deep{}\n",
               result.test == PhysicsTest::lift ? "up" : kPullNames[k],
               kPhysicsOutcomeNames[static_cast<std::size_t>(direction.outcome)], 1e3 * direction.displacement,
               direction.rotation / kDegree, 1e3 * direction.penetration,
               std::isfinite(direction.fallSeconds) ? fmt::format(", after {:.2f} s", direction.fallSeconds) : "");
  }
}

/// Does the record of a grasp say what was simulated now, to the last bit? Nothing when it has no such record.
std::optional<bool> repeats(const PhysicsSet& stored, std::uint32_t grasp, const PhysicsSet& again) {
  const auto row = std::lower_bound(stored.grasp.begin(), stored.grasp.end(), grasp);
  if (row == stored.grasp.end() || *row != grasp || stored.settings != again.settings) return std::nullopt;
  const auto at = row - stored.grasp.begin();
  bool same = true;
  forEachPhysicsArray([&](const char*, auto member, std::string_view) {
    const auto& now = again.*member;
    same = same &&
           std::equal(now.begin(), now.end(), (stored.*member).begin() + at * static_cast<std::ptrdiff_t>(now.size()));
  });
  return same;
}

int replay(const PhysicsCommand& command) {
  const GraspName name = parseGraspName(command.replay);
  SetLoader loader(command.friction);
  const std::unique_ptr<SimulatedSet> set = loader.load(name.path);
  if (name.grasp >= set->set().graspCount()) {
    throw InputError(
        fmt::format("{}: grasp {} does not exist, the set holds {}", name.path, name.grasp, set->set().graspCount()));
  }
  const std::vector<PhysicsTest> tests = testsOf(command);
  requireMass(*set, name.path, tests);
  std::optional<Pictures> pictures;
  if (!command.pictures.empty()) pictures.emplace(*set, name.grasp, command.pictures);
  GraspSimulator simulator(set->model());
  std::vector<TestResult> results;
  for (const PhysicsTest test : tests) {
    GraspSimulator::Watch watch;
    if (pictures && results.empty()) watch = [&](const PhysicsFrame& frame) { pictures->add(frame); };
    results.push_back(simulator.run(set->posture(name.grasp), test, watch));
    printResult(results.back());
  }
  if (pictures) fmt::print("{} pictures in {}\n", pictures->count(), command.pictures);
  if (!fs::exists(physicsPath(name.path))) return kExitDone;
  PhysicsSet again = emptyPhysics(*set, tests);
  addResults(static_cast<std::uint32_t>(name.grasp), results, again);
  const auto same =
      repeats(readPhysicsOf(name.path, set->set().inputHash, set->set().setVersion, set->set().graspCount()),
              static_cast<std::uint32_t>(name.grasp), again);
  if (!same) return kExitDone;
  fmt::print("{}\n", *same ? "equal to the stored results, bit for bit" : "differs from the stored results");
  return *same ? kExitDone : kExitItemFailed;
}

double share(std::size_t part, std::size_t all) {
  return all == 0 ? std::nan("") : static_cast<double>(part) / static_cast<double>(all);
}

/// `97 %`, `-` of nothing.
std::string percent(double value) { return std::isnan(value) ? "-" : fmt::format("{:.0f} %", 100 * value); }

nlohmann::ordered_json toJson(const SetFile& file, const GroupTable& table) {
  nlohmann::ordered_json groups;
  for (std::size_t g = 0; g < table.size(); ++g) {
    const GroupResult& group = table[g];
    nlohmann::ordered_json causes;
    for (std::size_t i = 0; i < group.causes.size(); ++i) causes[std::string(kFailureCauseNames[i])] = group.causes[i];
    groups[std::string(kGraspGroupNames[g])] = {{"grasps", group.grasps},
                                                {"held", group.held},
                                                {"settled_closed", group.settledClosed},
                                                {"held_of_settled_closed", group.heldClosed},
                                                {"causes", causes}};
  }
  return {{"object", file.object}, {"hand", file.hand}, {"set_version", file.version}, {"groups", groups}};
}

/// A hand's sets together: the mean of the objects' shares, the worst object, the causes.
void printHand(const std::string& hand, const std::vector<GroupTable>& tables) {
  for (std::size_t g = 0; g < kGraspGroupNames.size(); ++g) {
    double sum = 0, worst = 1;
    std::size_t objects = 0, grasps = 0, closed = 0, heldClosed = 0, held = 0;
    std::array<std::size_t, kFailureCauseNames.size()> causes{};
    for (const GroupTable& table : tables) {
      const GroupResult& group = table[g];
      if (group.grasps == 0) continue;
      const double part = share(group.held, group.grasps);
      sum += part, worst = std::min(worst, part), ++objects, grasps += group.grasps, held += group.held;
      closed += group.settledClosed, heldClosed += group.heldClosed;
      for (std::size_t i = 0; i < causes.size(); ++i) causes[i] += group.causes[i];
    }
    if (objects == 0) continue;
    std::string why;
    for (std::size_t i = 0; i < causes.size(); ++i) {
      if (causes[i] > 0) why += fmt::format("{}{} {}", why.empty() ? "" : ", ", causes[i], kFailureCauseNames[i]);
    }
    fmt::print(
        "{}, {}: mean of {} objects {:.1f} %, worst {:.0f} %; settled closed: held {} of {}, else {} of {}; failed: "
        "{}\n",
        hand, kGraspGroupNames[g], objects, 100 * sum / static_cast<double>(objects), 100 * worst, heldClosed, closed,
        held - heldClosed, grasps - closed, why.empty() ? "none" : why);
  }
}

int compareSets(const PhysicsCommand& command, const Database& database) {
  const std::vector<SetFile> files = pickedSets(database, command);
  const std::atomic<bool>& stop = stopOnSignals();
  const JobSystem jobs(command.threads);
  SetLoader loader(command.friction);
  GroupComparer comparer;
  std::map<std::string, std::vector<GroupTable>> ofHand;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  if (!command.json) fmt::print("| object | hand | best | stored | trials | open |\n|---|---|---|---|---|---|\n");
  for (const SetFile& file : files) {
    const std::unique_ptr<SimulatedSet> set = loader.load(file.path);
    const auto table = comparer.compare(*set, *command.groups, command.seed, jobs, stop);
    if (!table) {
      logWarning("stopped before all sets were compared");
      return kExitItemFailed;
    }
    ofHand[file.hand].push_back(*table);
    if (command.json) {
      list.push_back(toJson(file, *table));
      continue;
    }
    fmt::print("| {} | {} |", file.object, file.hand);
    for (const GroupResult& group : *table) {
      fmt::print(" {}{} |", percent(share(group.held, group.grasps)),
                 group.grasps > 0 && group.grasps < *command.groups ? fmt::format(" of {}", group.grasps) : "");
    }
    fmt::print("\n");
    std::fflush(stdout);
  }
  if (command.json) fmt::print("{}\n", list.dump(1));
  for (const auto& [hand, tables] : ofHand) {
    if (!command.json) printHand(hand, tables);
  }
  return kExitDone;
}

/// Labels with the object as a field of distances against labels with it as convex pieces.
int checkShapes(const PhysicsCommand& command, const Database& database) {
  const std::atomic<bool>& stop = stopOnSignals();
  const JobSystem jobs(command.threads);
  SetLoader loader(command.friction);
  GroupComparer comparer;
  ShapeAgreement all;
  fmt::print("| object | hand | pieces | shape error p95, most [mm] | held by field | by pieces | agree |\n");
  fmt::print("|---|---|---|---|---|---|---|\n");
  for (const SetFile& file : pickedSets(database, command)) {
    const std::unique_ptr<SimulatedSet> set = loader.load(file.path);
    const std::size_t pieces = set->makePieces();
    const auto found = comparer.compareShapes(*set, *command.pieces, command.seed, jobs, stop);
    if (!found) {
      logWarning("stopped before all sets were checked");
      return kExitItemFailed;
    }
    fmt::print("| {} | {} | {} | {:.2f}, {:.2f} | {} | {} | {} of {} |\n", file.object, file.hand, pieces,
               1e3 * set->shapeError().p95, 1e3 * set->shapeError().largest, found->heldByField, found->heldByPieces,
               found->agree, found->grasps);
    std::fflush(stdout);
    all.grasps += found->grasps, all.agree += found->agree;
  }
  fmt::print("{} of {} labels agree, {}\n", all.agree, all.grasps, percent(share(all.agree, all.grasps)));
  return kExitDone;
}

}  // namespace

std::vector<SetFile> pickedSets(const Database& database, const PhysicsCommand& command) {
  std::vector<SetFile> sets = database.newestSets(command.objectGlob, command.handGlob);
  if (sets.empty()) {
    throw InputError(fmt::format("{}: --object {} --hand {} picks no set", database.folder().string(),
                                 command.objectGlob, command.handGlob));
  }
  return sets;
}

int runPhysics(const PhysicsCommand& command, const Database& database) {
  if (!command.calibrate.empty()) return runCalibration(command, database);
  if (!command.replay.empty()) return replay(command);
  if (command.pieces) return checkShapes(command, database);
  return command.groups ? compareSets(command, database) : labelSets(command, database);
}

}  // namespace handhold

#else

namespace handhold {

int runPhysics(const PhysicsCommand&, const Database&) {
  throw InputError("physics: this program was built without MuJoCo, want one built where libmujoco-dev is installed");
}

}  // namespace handhold

#endif
