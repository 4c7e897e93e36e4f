#include "store/database.h"

#include "core/error.h"
#include "core/file.h"
#include "store/index.h"
#include "store/layout.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <tuple>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& path, std::string_view what, const std::string& reason) {
  throw SystemError(fmt::format("{}: {}: {}", path.string(), what, reason));
}

/// NNNN of `vNNNN.h5` (at least four digits), 0 for any other name.
int versionOf(const std::string& fileName) {
  if (fileName.size() < 8 || fileName[0] != 'v' || !fileName.ends_with(".h5")) return 0;
  const char* end = fileName.data() + fileName.size() - 3;
  int version = 0;
  const auto [stop, error] = std::from_chars(fileName.data() + 1, end, version);
  return error == std::errc() && stop == end && version > 0 ? version : 0;
}

/// What lies in a folder, unsorted; nothing when there is no such folder.
std::vector<fs::directory_entry> entries(const fs::path& folder) {
  std::vector<fs::directory_entry> result;
  std::error_code error;
  fs::directory_iterator item(folder, error);
  for (; !error && item != fs::directory_iterator(); item.increment(error)) result.push_back(*item);
  if (error && error != std::errc::no_such_file_or_directory) fail(folder, "cannot be listed", error.message());
  return result;
}

/// The visible folders in a folder whose names match a pattern.
std::vector<fs::path> subfolders(const fs::path& folder, const std::string& glob = "*") {
  std::vector<fs::path> result;
  for (const fs::directory_entry& entry : entries(folder)) {
    std::error_code error;
    const std::string name = entry.path().filename().string();
    const bool isWanted = !name.starts_with('.') && matchesGlob(name, glob);
    if (isWanted && entry.is_directory(error)) result.push_back(entry.path());
  }
  return result;
}

/// A file that is gone at the end, however it ends.
class TemporaryFile {
 public:
  explicit TemporaryFile(fs::path path) : path_(std::move(path)) {}
  ~TemporaryFile() { ::unlink(path_.c_str()); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const fs::path& path() const { return path_; }

  void write(const std::string& bytes) const {
    const int descriptor = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor < 0) fail(path_, "cannot be created", std::strerror(errno));
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t count = ::write(descriptor, bytes.data() + done, bytes.size() - done);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) break;
      done += static_cast<std::size_t>(count);
    }
    int reason = done < bytes.size() ? errno : 0;
    // Network file systems report a full disk no earlier than here.
    if (::close(descriptor) != 0 && reason == 0) reason = errno;
    if (reason != 0) fail(path_, "cannot be written", std::strerror(reason));
  }

 private:
  fs::path path_;
};

/// What is known of every set, from its row of the index where that is up to date.
std::vector<IndexedSet> indexedSets(const Database& database, std::vector<std::string>& failures) {
  std::vector<IndexedSet> result;
  const std::vector<SetFile> files = database.sets();
  CatalogIndex index(database.folder());
  for (const SetFile& file : files) {
    try {
      std::optional<IndexedSet> set = index.find(file.path);
      if (!set) {
        const FileStamp before = stampOf(file.path);  // a change while the file is read makes the row stale
        set = IndexedSet{readSummary(file.path), before.modifiedNs};
      }
      result.push_back(std::move(*set));
    } catch (const InputError& error) {
      failures.emplace_back(error.what());
    }
  }
  return result;
}

}  // namespace

fs::path Database::setPath(const std::string& object, const std::string& hand, int version) const {
  requireName(object, folder_.string(), "object");
  requireName(hand, folder_.string(), "hand");
  return folder_ / object / hand / fmt::format("v{:04}.h5", version);
}

std::vector<SetFile> Database::newestSets(const std::string& objectGlob, const std::string& handGlob) const {
  std::vector<SetFile> newest;
  for (SetFile& file : sets(objectGlob, handGlob)) {
    const bool isNewer = !newest.empty() && newest.back().object == file.object && newest.back().hand == file.hand;
    isNewer ? newest.back() = std::move(file) : newest.emplace_back(std::move(file));
  }
  return newest;
}

int Database::newestVersion(const std::string& object, const std::string& hand) const {
  int newest = 0;
  for (const fs::directory_entry& entry : entries(setPath(object, hand, 0).parent_path())) {
    newest = std::max(newest, versionOf(entry.path().filename().string()));
  }
  return newest;
}

fs::path Database::write(GraspSet set) const {
  const fs::path folder = setPath(set.object, set.hand, 0).parent_path();
  checkGraspSet(set, fmt::format("set {}/{}", set.object, set.hand));
  createFolders(folder);
  set.setVersion = newestVersion(set.object, set.hand);
  while (true) {
    // The version is part of the bytes, so a set whose number was taken meanwhile is encoded anew.
    set.setVersion = std::max(set.setVersion, newestVersion(set.object, set.hand)) + 1;
    const fs::path target = setPath(set.object, set.hand, set.setVersion);
    const TemporaryFile temporary(temporaryName(folder));
    temporary.write(encodeGraspSet(set));
    if (publishFile(temporary.path(), target)) return target;
  }
}

std::vector<fs::path> Database::setFolders() const {
  std::vector<fs::path> folders;
  for (const fs::path& object : subfolders(folder_)) {
    const std::vector<fs::path> hands = subfolders(object);
    folders.insert(folders.end(), hands.begin(), hands.end());
  }
  std::sort(folders.begin(), folders.end());
  return folders;
}

std::vector<fs::path> Database::files() const {
  std::vector<fs::path> paths;
  if (!fs::exists(folder_)) return paths;
  for (SetFile& set : sets()) paths.push_back(std::move(set.path));
  return paths;
}

void Database::requireFolder() const {
  if (fs::is_directory(folder_)) return;
  throw InputError(fmt::format("{}: is no folder, want a database (--db DIR or HANDHOLD_DB)", folder_.string()));
}

std::vector<SetFile> Database::sets(const std::string& objectGlob, const std::string& handGlob) const {
  requireFolder();
  std::vector<SetFile> found;
  for (const fs::path& object : subfolders(folder_, objectGlob)) {
    for (const fs::path& hand : subfolders(object, handGlob)) {
      for (const fs::directory_entry& entry : entries(hand)) {
        const int version = versionOf(entry.path().filename().string());
        if (version > 0) found.push_back({entry.path(), object.filename(), hand.filename(), version});
      }
    }
  }
  std::sort(found.begin(), found.end(), [](const SetFile& a, const SetFile& b) {
    return std::tie(a.object, a.hand, a.version) < std::tie(b.object, b.hand, b.version);
  });
  return found;
}

std::vector<GraspSetSummary> Database::summaries(std::vector<std::string>& failures) const {
  std::vector<GraspSetSummary> result;
  for (IndexedSet& set : indexedSets(*this, failures)) result.push_back(std::move(set.summary));
  return result;
}

std::size_t Database::writeIndex(std::vector<std::string>& failures) const {
  const std::vector<IndexedSet> sets = indexedSets(*this, failures);
  const TemporaryFile temporary(temporaryName(folder_));
  temporary.write(encodeIndex(folder_, sets));
  replaceFile(temporary.path(), folder_ / kIndexName);
  return sets.size();
}

}  // namespace handhold
