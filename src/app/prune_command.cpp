#include "app/commands.h"

#include <fmt/format.h>

namespace handhold {

int runPrune(const PruneOptions& options, const Database& database) {
  const PruneReport report = pruneDatabase(database, options);
  std::size_t bytes = 0;
  for (const PruneReport::File& file : report.removed) {
    fmt::print("{} {} ({} bytes)\n", options.dryRun ? "would remove" : "removed", file.path.string(), file.bytes);
    bytes += file.bytes;
  }
  for (const auto& path : report.damaged) fmt::print("left {}: it is no whole set\n", path.string());
  fmt::print("{} files, {:.3f} MB {}\n", report.removed.size(), static_cast<double>(bytes) / 1e6,
             options.dryRun ? "would be freed" : "freed");
  return report.damaged.empty() ? kExitDone : kExitItemFailed;
}

}  // namespace handhold
