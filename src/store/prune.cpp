#include "store/prune.h"

#include "core/error.h"
#include "core/file.h"

#include <algorithm>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

class Pruner {
 public:
  Pruner(const PruneOptions& options, PruneReport& report) : options_(options), report_(report) {}

  bool selects(const fs::path& setFolder) const {
    return matchesGlob(setFolder.parent_path().filename().string(), options_.objectGlob) &&
           matchesGlob(setFolder.filename().string(), options_.handGlob);
  }

  void remove(const fs::path& path) {
    std::error_code error;
    const std::uintmax_t bytes = sizeOf(path, error);
    if (error == std::errc::no_such_file_or_directory) return;  // another prune was faster
    if (!options_.dryRun && fs::remove_all(path, error) == 0) {
      if (!error) return;
      throw SystemError(fmt::format("{}: cannot be removed: {}", path.string(), error.message()));
    }
    report_.removed.push_back({path, static_cast<std::size_t>(bytes)});
  }

  /// @param versions  of one set, oldest first
  void pruneSet(const std::vector<fs::path>& versions) {
    std::size_t whole = 0;
    for (auto path = versions.rbegin(); path != versions.rend(); ++path) {
      try {
        readInputHash(*path);
      } catch (const InputError&) {
        std::error_code error;
        if (fs::exists(*path, error)) report_.damaged.push_back(*path);
        continue;
      }
      if (++whole <= options_.keep) continue;
      remove(path->parent_path() / ("physics-" + path->filename().string()));  // first: it means nothing alone
      remove(*path);
    }
  }

  void removeTemporaries(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> abandoned;
    for (fs::directory_iterator item(folder, error); !error && item != fs::directory_iterator();
         item.increment(error)) {
      if (isAbandonedTemporary(item->path())) abandoned.push_back(item->path());
    }
    std::sort(abandoned.begin(), abandoned.end());
    for (const fs::path& path : abandoned) remove(path);
  }

 private:
  /// Of a file, or of the files in a folder.
  static std::uintmax_t sizeOf(const fs::path& path, std::error_code& error) {
    if (!fs::is_directory(path, error)) return fs::file_size(path, error);
    std::uintmax_t bytes = 0;
    for (fs::directory_iterator item(path, error); !error && item != fs::directory_iterator(); item.increment(error)) {
      bytes += item->file_size(error);
    }
    return bytes;
  }

  const PruneOptions& options_;
  PruneReport& report_;
};

}  // namespace

PruneReport pruneDatabase(const Database& database, const PruneOptions& options) {
  PruneReport report;
  Pruner pruner(options, report);
  std::vector<fs::path> files;  // by set, versions rising
  for (SetFile& file : database.sets(options.objectGlob, options.handGlob)) files.push_back(std::move(file.path));
  for (auto begin = files.begin(); begin != files.end();) {
    const fs::path folder = begin->parent_path();
    const auto end =
        std::find_if(begin, files.end(), [&](const fs::path& path) { return path.parent_path() != folder; });
    pruner.pruneSet({begin, end});
    begin = end;
  }
  pruner.removeTemporaries(database.folder());
  for (const fs::path& folder : database.setFolders()) {
    if (pruner.selects(folder)) pruner.removeTemporaries(folder);
  }
  return report;
}

}  // namespace handhold
