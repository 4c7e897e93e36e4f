#include "core/file.h"

#include "core/error.h"

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <fnmatch.h>
#include <sys/stat.h>
#include <unistd.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kTemporaryPrefix = ".tmp-";
constexpr auto kAbandonedAfter = std::chrono::hours(6);  // writing a set takes seconds

std::string hostName() {
  char host[64] = {};
  ::gethostname(host, sizeof host - 1);
  return host;
}

void syncToDisk(const fs::path& path, int flags) {
  const int descriptor = ::open(path.c_str(), flags | O_CLOEXEC);
  if (descriptor < 0) throw SystemError(fmt::format("{}: cannot be opened: {}", path.string(), std::strerror(errno)));
  const int result = ::fsync(descriptor);
  const int reason = errno;
  ::close(descriptor);
  // Some network file systems refuse fsync on folders with EINVAL; there is nothing more to ask of them.
  if (result != 0 && reason != EINVAL) {
    throw SystemError(fmt::format("{}: cannot be written to disk: {}", path.string(), std::strerror(reason)));
  }
}

void syncFolderOf(const fs::path& file) {
  syncToDisk(file.has_parent_path() ? file.parent_path() : fs::path("."), O_RDONLY | O_DIRECTORY);
}

}  // namespace

std::string readFile(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (fs::exists(status) && !fs::is_regular_file(status)) {  // a pipe may wait for ever, a device may never end
    throw InputError(fmt::format("{}: cannot be read: is {}", path.string(),
                                 fs::is_directory(status) ? "a folder" : "not a regular file"));
  }
  errno = 0;
  std::ifstream stream(path, std::ios::binary);
  std::string content;
  std::vector<char> block(std::size_t{64} << 10);
  while (stream.read(block.data(), static_cast<std::streamsize>(block.size())) || stream.gcount() > 0) {
    content.append(block.data(), static_cast<std::size_t>(stream.gcount()));
  }
  // The end of the file is no failure, an error half way is one.
  if (!stream.eof()) throw InputError(fmt::format("{}: cannot be read: {}", path.string(), std::strerror(errno)));
  return content;
}

bool publishFile(const fs::path& temporary, const fs::path& target) {
  syncToDisk(temporary, O_RDONLY);
  const int result = ::link(temporary.c_str(), target.c_str());
  const int reason = errno;
  ::unlink(temporary.c_str());
  if (result != 0 && reason == EEXIST) return false;
  if (result != 0) {
    throw SystemError(fmt::format("{}: cannot be created: {}", target.string(), std::strerror(reason)));
  }
  syncFolderOf(target);
  return true;
}

void replaceContent(const fs::path& target, std::string_view content) {
  const fs::path temporary = temporaryName(target.has_parent_path() ? target.parent_path() : fs::path("."));
  std::ofstream stream(temporary, std::ios::binary);
  stream << content;
  stream.close();
  if (stream && ::rename(temporary.c_str(), target.c_str()) == 0) return;
  const int reason = errno;
  ::unlink(temporary.c_str());
  throw SystemError(fmt::format("{}: cannot be written: {}", target.string(), std::strerror(reason)));
}

void replaceFile(const fs::path& temporary, const fs::path& target) {
  syncToDisk(temporary, O_RDONLY);
  if (::rename(temporary.c_str(), target.c_str()) != 0) {
    const int reason = errno;
    ::unlink(temporary.c_str());
    throw SystemError(fmt::format("{}: cannot be replaced: {}", target.string(), std::strerror(reason)));
  }
  syncFolderOf(target);
}

void createFolders(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw SystemError(fmt::format("{}: cannot be created: {}", folder.string(), error.message()));
}

OpenFolder::OpenFolder(const fs::path& path) : descriptor_(::open(path.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC)) {}

OpenFolder::~OpenFolder() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

bool OpenFolder::isAt(const fs::path& path) const {
  if (descriptor_ < 0) return true;
  struct stat own {
  }, other{};
  if (::fstat(descriptor_, &own) != 0) return true;
  return ::stat(path.c_str(), &other) == 0 && own.st_dev == other.st_dev && own.st_ino == other.st_ino;
}

fs::path temporaryName(const fs::path& folder) {
  static std::atomic<unsigned> counter{0};
  // Builders on several machines share the folder.
  return folder / fmt::format("{}{}-{}-{}", kTemporaryPrefix, hostName(), ::getpid(), counter++);
}

bool isAbandonedTemporary(const fs::path& path) {
  const std::string name = path.filename().string();
  if (!name.starts_with(kTemporaryPrefix) && !name.starts_with(kChunksPrefix)) return false;
  std::error_code error;
  const fs::file_time_type written = fs::last_write_time(path, error);
  if (!error && fs::file_time_type::clock::now() - written > kAbandonedAfter) return true;
  // .tmp-HOST-PID-COUNTER, and a host's name may have a '-' too
  const std::string mine = fmt::format("{}{}-", kTemporaryPrefix, hostName());
  if (!name.starts_with(mine)) return false;
  pid_t process = 0;
  const char* end = name.data() + name.size();
  const auto [stop, wrong] = std::from_chars(name.data() + mine.size(), end, process);
  const bool isPlain = wrong == std::errc() && process > 0 && stop != end && *stop == '-' &&
                       name.find_first_not_of("0123456789", stop + 1 - name.data()) == std::string::npos;
  return isPlain && ::kill(process, 0) != 0 && errno == ESRCH;
}

bool matchesGlob(std::string_view text, std::string_view pattern) {
  return ::fnmatch(std::string(pattern).c_str(), std::string(text).c_str(), FNM_PATHNAME) == 0;
}

void requireName(std::string_view name, std::string_view where, std::string_view what) {
  bool good = !name.empty() && name.size() <= 100 && std::isalnum(static_cast<unsigned char>(name[0])) != 0;
  for (const char c : name) {
    good = good && (std::isalnum(static_cast<unsigned char>(c)) != 0 || std::strchr("._-+", c) != nullptr) && c != '\0';
  }
  if (!good) {
    std::string shown(name.substr(0, 100));
    std::replace_if(
        shown.begin(), shown.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, '?');
    throw InputError(
        fmt::format("{}: {} is \"{}\", want 1 to 100 letters, digits, '.', '_', '-' or '+', the first a "
                    "letter or digit",
                    where, what, shown));
  }
}

std::string expandEnvironment(std::string_view text, std::string_view where) {
  std::string result;
  std::size_t position = 0;
  while (position < text.size()) {
    const std::size_t open = text.find("${", position);
    const std::size_t close = open == std::string_view::npos ? open : text.find('}', open);
    if (close == std::string_view::npos) break;
    const std::string name(text.substr(open + 2, close - open - 2));
    const char* value = std::getenv(name.c_str());
    if (value == nullptr) {
      throw InputError(fmt::format("{}: ${{{}}} is not set, want an environment variable with a path", where, name));
    }
    result += text.substr(position, open - position);
    result += value;
    position = close + 1;
  }
  result += text.substr(position);
  return result;
}

std::string shellQuoted(const std::string& word) {
  const bool plain = std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || (c != '\0' && std::strchr("._-+/:=,@%", c) != nullptr);
  });
  if (plain && !word.empty()) return word;
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? "'\\''" : std::string(1, c);
  return text + "'";
}

fs::path programFolder() { return fs::read_symlink("/proc/self/exe").parent_path(); }

}  // namespace handhold
