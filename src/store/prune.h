#pragma once

#include "store/database.h"

#include <filesystem>
#include <string>
#include <vector>

namespace handhold {

struct PruneOptions {
  std::size_t keep = 1;  // versions of each set, at least 1
  std::string objectGlob = "*", handGlob = "*";
  bool dryRun = false;  // remove nothing, only tell
};

struct PruneReport {
  struct File {
    std::filesystem::path path;
    std::size_t bytes = 0;
  };
  std::vector<File> removed;                   // or what would be
  std::vector<std::filesystem::path> damaged;  // files that are no whole sets: left, and not counted as versions
};

/// Removes all but the newest `keep` versions of each set with their physics files, and temporary files of builders
/// that are gone. The newest version stays always, so that numbers are never used twice. Whoever has a removed file
/// open reads it to its end. A file whose first bytes or length are not those of a set is left alone.
/// @throws InputError   the folder of the database is none
/// @throws SystemError  a file cannot be removed; those before it are gone
PruneReport pruneDatabase(const Database& database, const PruneOptions& options);

}  // namespace handhold
