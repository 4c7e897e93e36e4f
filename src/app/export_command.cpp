#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "exchange/export_set.h"

#include <map>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

void makeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw SystemError(fmt::format("{}: cannot be made: {}", folder.string(), error.message()));
}

}  // namespace

int runExport(ExportCommand command, const Database& database) {
  static const std::map<std::string, ExportFormat> kFormats = {{"acronym", ExportFormat::acronym},
                                                               {"isaac", ExportFormat::isaac},
                                                               {"moveit", ExportFormat::moveit},
                                                               {"csv", ExportFormat::csv},
                                                               {"gltf", ExportFormat::gltf}};
  const ExportFormat format = kFormats.at(command.to);
  const GraspFrame frame = command.frame == "tcp" ? GraspFrame::tcp : GraspFrame::root;
  if (format == ExportFormat::gltf && !command.selection.query.top) command.selection.query.top = 1;
  QueryAnswer answer = findGrasps(command.selection, database);
  makeFolder(command.folder);
  std::size_t failed = answer.failures.size();
  std::set<std::string> names;
  for (FoundSet& found : answer.sets) {
    try {
      const std::string path = found.path.string();
      for (const ExportedFile& file : exportSet(loadExportedSet(std::move(found)), format, frame)) {
        if (!names.insert(file.name).second) {
          throw InputError(fmt::format(
              "{}: would be written to {}, which another set has, want it in a folder of its own", path, file.name));
        }
        const fs::path target = fs::path(command.folder) / file.name;
        replaceContent(target, file.content);
        fmt::print("{}{}\n", target.string(),
                   file.grasps > 0
                       ? fmt::format(": {} {} of {}", file.grasps, file.grasps == 1 ? "grasp" : "grasps", path)
                       : ": the object's mesh");
      }
    } catch (const InputError& error) {
      logError(error.what());
      ++failed;
    }
  }
  return failed == 0 ? kExitDone : kExitItemFailed;
}

}  // namespace handhold
