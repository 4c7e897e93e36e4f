#include "store/database.h"

#include "core/error.h"
#include "core/file.h"
#include "store/layout.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
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

/// The visible folders in a folder.
std::vector<fs::path> subfolders(const fs::path& folder) {
  std::vector<fs::path> result;
  for (const fs::directory_entry& entry : entries(folder)) {
    std::error_code error;
    const bool isHidden = entry.path().filename().string().starts_with('.');
    if (!isHidden && entry.is_directory(error)) result.push_back(entry.path());
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

template <class Number>
bool isEqual(const Number& a, const Number& b) {
  if constexpr (std::is_floating_point_v<Number>) return a == b || (std::isnan(a) && std::isnan(b));
  return a == b;
}

template <class Number>
bool isEqual(const std::vector<Number>& a, const std::vector<Number>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](Number x, Number y) { return isEqual(x, y); });
}

/// Takes down the first name for which something differs.
class Comparison {
 public:
  void add(const std::string& name, bool equal) {
    if (!equal && first_.empty()) first_ = name;
  }
  void addMesh(const std::string& folder, const TriangleMesh& a, const TriangleMesh& b) {
    add(folder + "/vertices", a.vertices == b.vertices);
    add(folder + "/triangles", a.triangles == b.triangles);
  }
  const std::string& first() const { return first_; }

 private:
  std::string first_;
};

}  // namespace

fs::path Database::setPath(const std::string& object, const std::string& hand, int version) const {
  requireName(object, folder_.string(), "object");
  requireName(hand, folder_.string(), "hand");
  return folder_ / object / hand / fmt::format("v{:04}.h5", version);
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
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) fail(folder, "cannot be created", error.message());
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

std::vector<fs::path> Database::files() const {
  std::vector<std::tuple<std::string, std::string, int, fs::path>> found;
  for (const fs::path& object : subfolders(folder_)) {
    for (const fs::path& hand : subfolders(object)) {
      for (const fs::directory_entry& entry : entries(hand)) {
        const int version = versionOf(entry.path().filename().string());
        if (version > 0) found.emplace_back(object.filename(), hand.filename(), version, entry.path());
      }
    }
  }
  std::sort(found.begin(), found.end());
  std::vector<fs::path> paths;
  paths.reserve(found.size());
  for (const auto& entry : found) paths.push_back(std::get<3>(entry));
  return paths;
}

std::string firstDifference(const GraspSet& a, const GraspSet& b) {
  Comparison comparison;
  forEachRootAttribute([&](const std::string& name, auto member) {
    if (name == "generator" || name == "set_version") return;
    comparison.add("/@" + name, isEqual(a.*member, b.*member));
  });
  comparison.addMesh("/object", a.objectMesh, b.objectMesh);
  comparison.add("/object/center_of_mass", a.centerOfMass == b.centerOfMass);
  comparison.add("/object@watertight", a.watertight == b.watertight);
  forEachTexts([&](const char* path, auto member) { comparison.add(path, a.*member == b.*member); });
  forEachText([&](const char* path, auto member) { comparison.add(path, a.*member == b.*member); });
  for (std::size_t i = 0; i < a.linkMeshes.size() && i < b.linkMeshes.size() && i < a.linkNames.size(); ++i) {
    comparison.addMesh(linkFolder(a.linkNames[i]), a.linkMeshes[i], b.linkMeshes[i]);
  }
  const Sizes sizesA = sizesOf(a), sizesB = sizesOf(b);
  forEachArray([&](const char* path, auto member, std::string_view symbols) {
    const bool sameShape = std::all_of(symbols.begin(), symbols.end(),
                                       [&](char symbol) { return sizesA.at(symbol) == sizesB.at(symbol); });
    comparison.add(path, sameShape && isEqual(a.*member, b.*member));
  });
  comparison.add("/trials/outcome@names", a.outcomeNames == b.outcomeNames);
  comparison.add("/trials@by_reference", a.trialsByReference == b.trialsByReference);
  return comparison.first();
}

}  // namespace handhold
