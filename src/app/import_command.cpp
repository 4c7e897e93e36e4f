#include "app/commands.h"
#include "build/build_job.h"
#include "build/import_set.h"
#include "build/mesh_hashes.h"
#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/log.h"
#include "core/yaml.h"
#include "exchange/grasp_file.h"

#include <optional>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// The unit that is asked for, else the scale that the file gives for its mesh. The latter is of the mesh that the file
/// was made with, so that an implausible size is refused as where no unit is written.
MeshUnit unitOf(const ImportCommand& command, const GraspFile& file) {
  if (!command.unit.empty()) return readMeshUnit(YamlValue::parseText("unit: " + command.unit, "--unit"));
  return {file.objectScale.value_or(1), false, "the file's"};
}

CatalogItem itemOf(const ImportCommand& command, const GraspFile& file) {
  CatalogItem item;
  item.name = command.name.empty() ? fs::path(command.mesh).stem().string() : command.name;
  requireName(item.name, command.name.empty() ? command.mesh : "--name", "the object's name");
  item.mesh = command.mesh;
  item.unit = unitOf(command, file);
  item.friction = command.friction;
  item.where = command.file;
  return item;
}

/// What a person should know before the grasps are judged.
void reportFile(const GraspFile& file, const GivenGrasps& given, const Hand& hand, GraspFrame frame) {
  if (file.failed > 0)
    logInfo(fmt::format("{}: {} grasps that it marks as failed are left out", file.path, file.failed));
  const std::string name = file.gripperFrame.substr(file.gripperFrame.find_last_of('/') + 1);
  if (!name.empty() && name != frameName(hand, frame)) {
    logWarning(fmt::format("{}: its gripper frame {} is taken for {} of {}; --frame tcp for the tool centre point",
                           file.path, name, frameName(hand, frame), hand.name));
  }
  if (given.otherPregrasp > 0) {
    logWarning(fmt::format("{}: {} grasps have a pregrasp that is no preshape of {}: they arrive in the nearest",
                           file.path, given.otherPregrasp, hand.name));
  }
}

/// The funnel, as `info` tells it for good.
std::string outcomesText(const GraspSet& set) {
  std::vector<std::size_t> counts(set.outcomeNames.size(), 0);
  for (const std::uint8_t outcome : set.outcome) ++counts[outcome];
  std::string text;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0 || i == static_cast<std::size_t>(GraspOutcome::notRun)) continue;
    text += fmt::format("  {:<18}{:>9}\n", set.outcomeNames[i], counts[i]);
  }
  return text;
}

}  // namespace

int runImport(const ImportCommand& command, const Database& database) {
  const GraspFile file = readGraspFile(command.file);
  Hand hand = loadHand(command.hand, command.packages);
  const GraspFrame frame = command.frame == "tcp" ? GraspFrame::tcp : GraspFrame::root;
  GivenGrasps given = givenGrasps(file, hand, {frame, command.preshape, command.close});
  keepUsedPreshapes(hand, given.grasps);
  const CatalogItem item = itemOf(command, file);
  const std::string bytes = readFile(command.file);
  const std::string provenance =
      fmt::format("imported from {} ({}, XXH3-128 {})", fs::path(command.file).filename().string(), file.format,
                  hashBytes(bytes.data(), bytes.size()));
  const Job job = importJob(provenance, command.friction, command.contactDistance);
  const std::string hash = importHash(job, item, meshHash(item.mesh), hand, given.grasps);
  if (isUnchanged(database, item.name, hand.name, hash)) {
    fmt::print("{} x {}: unchanged, {} was imported from the same\n", item.name, hand.name,
               database.setPath(item.name, hand.name, database.newestVersion(item.name, hand.name)).string());
    return kExitDone;
  }
  reportFile(file, given, hand, frame);

  const std::atomic<bool>& stop = stopOnSignals();
  std::optional<GraspSet> set;
  try {
    SampledObject object = loadSampledObject(job, item, &stop);
    const JobSystem jobs(command.threads);
    set = importSet(job, std::move(object), hand, given.grasps, hash, makeHandFields(hand, &stop, jobs), jobs, stop);
  } catch (const Cancelled&) {  // set stays empty
  }
  if (!set) {
    logError("stopped, nothing was written");
    return kExitItemFailed;
  }
  set->generator += "; " + provenance;
  if (set->graspCount() == 0)
    logWarning(fmt::format("{} x {}: no grasp of the file is force closed", item.name, hand.name));
  const fs::path path = database.write(*set);
  fmt::print("{}: {} of {} grasps are force closed and stored\n{}", path.string(), set->graspCount(),
             given.grasps.size(), outcomesText(*set));
  return kExitDone;
}

}  // namespace handhold
