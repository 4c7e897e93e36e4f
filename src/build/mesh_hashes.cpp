#include "build/mesh_hashes.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/log.h"

#include <ctime>
#include <sstream>

#include <fmt/format.h>
#include <sys/stat.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr const char* kHeader = "handhold mesh hashes 1";

long long nanoseconds(const timespec& time) { return time.tv_sec * 1'000'000'000LL + time.tv_nsec; }

}  // namespace

std::string meshHash(const std::string& path) {
  try {
    const std::string content = readFile(path);
    return hashBytes(content.data(), content.size());
  } catch (const InputError&) {
    return "";
  }
}

MeshHashes::MeshHashes(const fs::path& folder, double settleSeconds)
    : file_(folder / "mesh-hashes.txt"),
      settleTime_(static_cast<long long>(1e9 * settleSeconds)),
      entries_(read(file_)) {}

MeshHashes::Entries MeshHashes::read(const fs::path& file) {
  Entries entries;
  std::error_code missing;
  if (!fs::exists(file, missing)) return entries;
  try {
    const std::string text = readFile(file);
    const std::size_t last = text.rfind('\n');  // the last line says what the others hash to
    const std::size_t end = last == std::string::npos || last == 0 ? 0 : text.rfind('\n', last - 1) + 1;
    if (!text.starts_with(kHeader) || text.substr(end) != hashBytes(text.data(), end) + "\n") return entries;
    std::istringstream lines(text.substr(0, end));
    std::string line, path;
    std::getline(lines, line);
    Entry entry;
    while (lines >> entry.hash >> entry.bytes >> entry.modified >> entry.changed && lines.get() == ' ' &&
           std::getline(lines, path)) {
      entries[path] = entry;
    }
  } catch (const InputError& error) {
    logWarning(error.what());
  }
  return entries;
}

std::string MeshHashes::of(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return "";
  const Entry now{"", status.st_size, nanoseconds(status.st_mtim), nanoseconds(status.st_ctim)};
  const std::string key = fs::absolute(path).lexically_normal().string();
  const auto known = entries_.find(key);
  if (known != entries_.end() && known->second.bytes == now.bytes && known->second.modified == now.modified &&
      known->second.changed == now.changed) {
    return known->second.hash;
  }
  Entry entry = now;
  timespec clock{};
  ::clock_gettime(CLOCK_REALTIME, &clock);
  entry.hash = meshHash(path);
  const bool isSettled = nanoseconds(clock) - std::max(now.modified, now.changed) >= settleTime_;
  if (!entry.hash.empty() && isSettled && key.find('\n') == std::string::npos) learned_[key] = entries_[key] = entry;
  return entry.hash;
}

void MeshHashes::save() {
  if (learned_.empty()) return;
  Entries all = read(file_);
  for (const auto& [path, entry] : learned_) all[path] = entry;
  std::string text = fmt::format("{}\n", kHeader);
  for (const auto& [path, entry] : all) {
    text += fmt::format("{} {} {} {} {}\n", entry.hash, entry.bytes, entry.modified, entry.changed, path);
  }
  text += hashBytes(text.data(), text.size()) + "\n";
  try {
    std::error_code error;
    fs::create_directories(file_.parent_path(), error);  // replaceContent tells when it could not
    replaceContent(file_, text);
    learned_.clear();
  } catch (const SystemError& error) {
    logWarning(error.what());
  }
}

}  // namespace handhold
