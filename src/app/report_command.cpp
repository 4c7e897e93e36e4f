#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "view/report_sets.h"

#include <algorithm>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kGraspsOfAPage = 50'000;  // 20 MB of a page; without --top the sets share them
constexpr std::size_t kFewestOfASet = 100;

/// Of each grasp, the share of loads that it bore in simulation; empty when nothing of the set was simulated.
std::vector<float> sharesHeld(const GraspSet& set, const fs::path& path) {
  const std::optional<PhysicsSet> physics = physicsOf(path, set.inputHash, set.setVersion, set.graspCount());
  if (!physics) return {};
  const std::vector<double> shares = shareHeld(*physics, set.graspCount());
  return {shares.begin(), shares.end()};
}

}  // namespace

int runReport(const ReportCommand& command, const Database& database) {
  const std::vector<SetFile> sets = database.newestSets(command.objectGlob, command.handGlob);
  if (sets.empty()) {
    throw InputError(fmt::format("{}: has no set of object \"{}\" and hand \"{}\", want at least one (see list)",
                                 database.folder().string(), command.objectGlob, command.handGlob));
  }
  const std::size_t top = command.top.value_or(std::max(kFewestOfASet, kGraspsOfAPage / sets.size()));
  SetsReport report(sets.size() > 1);
  std::size_t shown = 0, failed = 0;
  for (const SetFile& file : sets) {
    try {
      const GraspSet set = readGraspSet(file.path);
      shown += std::min(top, set.graspCount());
      report.add({set, file.path.string(), fs::file_size(file.path), top, sharesHeld(set, file.path)});
    } catch (const InputError& error) {
      logError(error.what());
      report.addFailure(error.what());
      ++failed;
    }
  }
  const std::string html = report.html(database.folder().string());
  replaceContent(command.output, html);
  fmt::print("{}: {} sets, {} grasps, {:.1f} MB\n", command.output, sets.size() - failed, shown,
             static_cast<double>(html.size()) / 1e6);
  return failed == 0 ? kExitDone : kExitItemFailed;
}

}  // namespace handhold
