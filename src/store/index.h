#pragma once

// Private to this library: index.sqlite, what readSummary said of every set of a database when it was written.
// Derived: without it the same answers come from the sets themselves, later.

#include "store/database.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace handhold {

inline constexpr const char* kIndexName = "index.sqlite";

struct IndexedSet {
  GraspSetSummary summary;
  std::int64_t modifiedNs = 0;  // the file's time of modification when it was read
};

/// The index of a database as it was when this was constructed. Not safe for several threads at once.
class CatalogIndex {
 public:
  /// Finds nothing when there is no index; nothing either, after a warning, when it is damaged or of another make.
  explicit CatalogIndex(std::filesystem::path folder);
  ~CatalogIndex();
  CatalogIndex(const CatalogIndex&) = delete;
  CatalogIndex& operator=(const CatalogIndex&) = delete;

  /// The row of a set file, if it is there and the file's size and time of modification are still those of the row.
  std::optional<IndexedSet> find(const std::filesystem::path& file);

 private:
  void giveUp(const std::string& reason);

  std::filesystem::path folder_;
  std::string image_;  // SQLite works on this copy: no lock, and the file may be replaced meanwhile
  sqlite3* database_ = nullptr;
  sqlite3_stmt* select_ = nullptr;
};

/// What a file must still have for its row to be used; zeros when there is no such file.
struct FileStamp {
  std::uint64_t bytes = 0;
  std::int64_t modifiedNs = 0;  // since 1970
};
FileStamp stampOf(const std::filesystem::path& file);

/// The bytes of an index of these sets, which lie in `folder`. Throws SystemError when SQLite refuses (out of memory).
std::string encodeIndex(const std::filesystem::path& folder, const std::vector<IndexedSet>& sets);

}  // namespace handhold
