#include "mesh/import.h"

#include "core/error.h"
#include "core/file.h"
#include "mesh/repair.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kHelperName = "handhold-import";
constexpr std::size_t kMaxErrorBytes = std::size_t{64} << 10;
constexpr std::size_t kVerticesPerTriangle = 3;  // a soup; files with yet more unused vertices are refused

[[noreturn]] void throwSystem(const std::string& what, int reason) {
  throw SystemError(fmt::format("{}: {}", what, std::strerror(reason)));
}

/// An open file descriptor.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int value) : value_(value) {}
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  ~Descriptor() { close(); }

  int get() const { return value_; }
  void close() {
    if (value_ >= 0) ::close(value_);
    value_ = -1;
  }

 private:
  int value_ = -1;
};

/// Closed on exec, so that a child started by another thread does not hold it open. Never one of 0, 1, 2, which the
/// child's own redirections would overwrite.
struct Pipe {
  Descriptor read;
  Descriptor write;

  Pipe() {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) throwSystem("pipe to handhold-import", errno);
    const Descriptor low[2] = {Descriptor(ends[0]), Descriptor(ends[1])};
    read = Descriptor(::fcntl(low[0].get(), F_DUPFD_CLOEXEC, 3));
    write = Descriptor(::fcntl(low[1].get(), F_DUPFD_CLOEXEC, 3));
    if (read.get() < 0 || write.get() < 0) throwSystem("pipe to handhold-import", errno);
  }
};

/// A running child in a process group of its own (Ctrl-C at the terminal is the parent's to handle). Killed and reaped
/// at the latest on destruction.
class Child {
 public:
  Child(const std::string& helper, const std::vector<std::string>& arguments, const Pipe& out, const Pipe& err) {
    std::vector<char*> argv = {const_cast<char*>(helper.c_str())};
    for (const auto& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, out.write.get(), STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, err.write.get(), STDERR_FILENO);
    posix_spawn_file_actions_addclosefrom_np(&actions, 3);  // what other libraries opened without close-on-exec
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t none;
    sigset_t all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    const int result = ::posix_spawn(&pid_, helper.c_str(), &actions, &attributes, argv.data(), environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    if (result != 0) throwSystem(helper + ": cannot be started", result);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (!running_) return;
    ::kill(-pid_, SIGKILL);
    while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }

  /// The wait status once the child has ended; nothing at the deadline.
  std::optional<int> wait(Clock::time_point deadline) {
    int status = 0;
    while (true) {
      const pid_t ended = ::waitpid(pid_, &status, WNOHANG);
      if (ended == pid_) {
        running_ = false;
        return status;
      }
      if (ended < 0 && errno != EINTR) {
        running_ = false;  // someone else reaped it
        throwSystem("waiting for handhold-import", errno);
      }
      if (Clock::now() >= deadline) return std::nullopt;
      ::poll(nullptr, 0, 1);  // both pipes are closed by now, so it is about to end
    }
  }

 private:
  pid_t pid_ = -1;
  bool running_ = true;
};

/// The helper's stdout, checked while it arrives: nothing is stored beyond what a valid header announces.
class Answer {
 public:
  Answer(const std::string& path, const ImportLimits& limits) : path_(path), limits_(limits) {}

  void add(const char* data, std::size_t size) {
    const bool hadHeader = bytes_.size() >= sizeof header_;
    bytes_.append(data, size);
    if (!hadHeader && bytes_.size() >= sizeof header_) readHeader();
    if (bytes_.size() >= sizeof header_ && bytes_.size() > expected_) damaged();
  }

  ImportedMesh unpack() const {
    if (bytes_.size() < sizeof header_ || bytes_.size() != expected_) damaged();
    ImportedMesh imported;
    const char* from = bytes_.data() + sizeof header_;
    imported.mesh.vertices.resize(header_.nVertices);
    imported.mesh.triangles.resize(header_.nTriangles);
    for (auto& vertex : imported.mesh.vertices) from = take(from, vertex.data(), 3 * sizeof(double));
    for (auto& triangle : imported.mesh.triangles) from = take(from, triangle.data(), 3 * sizeof(std::uint32_t));
    std::string notes(from, header_.notesBytes);
    for (std::size_t end = notes.find('\n'); end != std::string::npos; end = notes.find('\n')) {
      imported.notes.push_back(notes.substr(0, end));
      notes.erase(0, end + 1);
    }
    return imported;
  }

 private:
  static const char* take(const char* from, void* to, std::size_t size) {
    std::memcpy(to, from, size);
    return from + size;
  }

  [[noreturn]] void damaged() const {
    throw SystemError(fmt::format("{}: {} gave a damaged answer", path_, kHelperName));
  }

  void readHeader() {
    std::memcpy(&header_, bytes_.data(), sizeof header_);
    if (header_.magic != kImportMagic || header_.notesBytes > kMaxNotesBytes) damaged();
    const std::size_t maxVertices = kVerticesPerTriangle * limits_.triangles;
    if (header_.nTriangles > limits_.triangles || header_.nVertices > maxVertices) {
      throw InputError(fmt::format("{}: has {} triangles and {} vertices, want at most {} and {}", path_,
                                   header_.nTriangles, header_.nVertices, limits_.triangles, maxVertices));
    }
    expected_ = sizeof header_ + header_.nVertices * 3 * sizeof(double) +
                header_.nTriangles * 3 * sizeof(std::uint32_t) + header_.notesBytes;
    bytes_.reserve(expected_);
  }

  const std::string& path_;
  const ImportLimits& limits_;
  ImportHeader header_;
  std::size_t expected_ = 0;
  std::string bytes_;
};

bool isCancelled(const ImportLimits& limits) { return limits.cancel != nullptr && limits.cancel->load(); }

/// Reads both pipes until the child has closed them; false at the deadline or when cancelled.
bool receive(Pipe& out, Pipe& err, Clock::time_point deadline, const ImportLimits& limits, Answer& answer,
             std::string& errors) {
  constexpr std::int64_t kLook = 100;  // ms between two looks at the cancel flag
  std::vector<char> buffer(std::size_t{64} << 10);
  std::array<pollfd, 2> polled = {pollfd{out.read.get(), POLLIN, 0}, pollfd{err.read.get(), POLLIN, 0}};
  while (polled[0].fd >= 0 || polled[1].fd >= 0) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
    if (left <= 0 || isCancelled(limits)) return false;
    const int ready = ::poll(polled.data(), polled.size(), static_cast<int>(std::min<std::int64_t>(left, kLook)));
    if (ready < 0 && errno != EINTR) throwSystem("reading from handhold-import", errno);
    if (ready <= 0) continue;
    for (std::size_t k = 0; k < polled.size(); ++k) {
      if (polled[k].fd < 0 || polled[k].revents == 0) continue;
      const ssize_t got = ::read(polled[k].fd, buffer.data(), buffer.size());
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) {
        polled[k].fd = -1;  // poll skips it
      } else if (k == 0) {
        answer.add(buffer.data(), static_cast<std::size_t>(got));
      } else if (errors.size() < kMaxErrorBytes) {
        errors.append(buffer.data(), static_cast<std::size_t>(got));
      }
    }
  }
  return true;
}

std::string lastLine(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text.substr(text.find_last_of('\n') + 1);
}

/// Turns an end other than success into the error it stands for.
void requireSuccess(int status, const std::string& errors, const std::string& path, const ImportLimits& limits) {
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) {
    throw SystemError(fmt::format("{}: the importer was killed (signal 9), perhaps for want of memory", path));
  }
  if (WIFSIGNALED(status)) {
    throw InputError(fmt::format("{}: the importer crashed on it (signal {})", path, WTERMSIG(status)));
  }
  const std::string message = lastLine(errors);
  const int code = WEXITSTATUS(status);
  if (code == static_cast<int>(ImportExit::good)) return;
  if (code == static_cast<int>(ImportExit::outOfMemory)) {
    throw InputError(fmt::format("{}: needs more than {} MiB of memory to be read", path, limits.bytes >> 20));
  }
  if (code == static_cast<int>(ImportExit::refused) && !message.empty()) throw InputError(message);
  if (code == static_cast<int>(ImportExit::systemError)) {
    throw SystemError(fmt::format("{}: {}: {}", path, kHelperName, message));
  }
  throw InputError(fmt::format("{}: the importer crashed on it (exit status {})", path, code));
}

}  // namespace

std::string importHelper() {
  const fs::path folder = programFolder();
  std::vector<fs::path> places = {folder, (folder / "../libexec/handhold").lexically_normal()};
  const char* const given = std::getenv("HANDHOLD_LIBEXEC");
  if (given != nullptr && *given != '\0') places.insert(places.begin(), given);
  std::vector<std::string> tried;
  for (const fs::path& place : places) {
    std::error_code error;
    if (fs::exists(place / kHelperName, error)) return (place / kHelperName).string();
    tried.push_back(place.string());
  }
  throw SystemError(fmt::format("{}: not found in {}; HANDHOLD_LIBEXEC may name its folder", kHelperName,
                                fmt::join(tried, " nor in ")));
}

ImportedMesh importInChild(const std::string& helper, const std::string& path, const ImportLimits& limits) {
  const auto deadline =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limits.seconds));
  Pipe out;
  Pipe err;
  Child child(
      helper,
      {path, fmt::format("{}", limits.seconds), fmt::format("{}", limits.bytes), fmt::format("{}", limits.triangles)},
      out, err);
  out.write.close();
  err.write.close();
  Answer answer(path, limits);
  std::string errors;
  const bool finished = receive(out, err, deadline, limits, answer, errors);
  const auto status = finished ? child.wait(deadline) : std::nullopt;
  if (isCancelled(limits)) throw InputError(fmt::format("{}: reading was stopped", path));
  if (!status) throw InputError(fmt::format("{}: the importer took longer than {} s", path, limits.seconds));
  requireSuccess(*status, errors, path, limits);
  return answer.unpack();
}

ObjectModel loadObject(const std::string& path, const MeshUnit& unit, const ImportLimits& limits) {
  ImportedMesh imported = importInChild(importHelper(), path, limits);
  ObjectModel object = repairObject(std::move(imported.mesh), unit, path);
  object.notes.insert(object.notes.begin(), imported.notes.begin(), imported.notes.end());
  return object;
}

TriangleMesh loadMesh(const std::string& path, const Eigen::Vector3d& scale, const ImportLimits& limits) {
  TriangleMesh mesh = importInChild(importHelper(), path, limits).mesh;
  requireSound(mesh, path);
  for (auto& vertex : mesh.vertices) vertex = vertex.cwiseProduct(scale);
  if (scale.prod() < 0) {
    for (auto& t : mesh.triangles) std::swap(t[1], t[2]);  // a mirror turns the inside out
  }
  cleanMesh(mesh, path);
  return mesh;
}

}  // namespace handhold
