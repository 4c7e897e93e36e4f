#include "core/error.h"
#include "core/hash.h"
#include "store/database.h"
#include "store/layout.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const fs::path& path, std::string_view message) {
  throw InputError(fmt::format("{}: {}", path.string(), message));
}

/// A file opened for reading.
class InputFile {
 public:
  explicit InputFile(const fs::path& path)
      : path_(path),
        descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {  // a pipe would make it wait
    if (descriptor_ < 0) refuse(path_, fmt::format("cannot be read: {}", std::strerror(errno)));
  }
  ~InputFile() { ::close(descriptor_); }
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  std::size_t size() const {
    struct stat status {};
    if (::fstat(descriptor_, &status) != 0) refuse(path_, fmt::format("cannot be read: {}", std::strerror(errno)));
    if (!S_ISREG(status.st_mode)) refuse(path_, "is a folder or a device, want a file");
    return static_cast<std::size_t>(status.st_size);
  }

  /// Fills `buffer` as far as the file goes on.
  std::size_t read(char* buffer, std::size_t size) const {
    std::size_t done = 0;
    while (done < size) {
      const ssize_t count = ::read(descriptor_, buffer + done, size - done);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) refuse(path_, fmt::format("cannot be read: {}", std::strerror(errno)));
      if (count == 0) break;
      done += static_cast<std::size_t>(count);
    }
    return done;
  }

 private:
  fs::path path_;
  int descriptor_;
};

/// The value of the line `KEY VALUE` at the beginning of `text`, which is then cut off; empty when it is another line.
std::string takeLine(std::string_view& text, std::string_view key) {
  const std::size_t end = text.find('\n');
  if (end == std::string_view::npos || !text.starts_with(key) || end <= key.size() || text[key.size()] != ' ')
    return "";
  const std::string value(text.substr(key.size() + 1, end - key.size() - 1));
  text.remove_prefix(end + 1);
  return value;
}

template <class Number>
Number toNumber(const std::string& text) {
  Number number = 0;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

/// Reads the first 512 bytes and refuses all that the writer would not have written, to the last bit.
SetBlock readBlock(const InputFile& file, const fs::path& path) {
  std::string bytes(kBlockBytes, '\0');
  const std::size_t size = file.size();
  bytes.resize(file.read(bytes.data(), kBlockBytes));
  if (!bytes.starts_with(kMagic)) {
    const std::string_view line = kMagic.substr(0, kMagic.size() - 1);
    refuse(path, size == 0 ? std::string("is empty, want a grasp set")
                           : fmt::format("is no grasp set: it does not start with \"{}\"", line));
  }
  std::string_view text = std::string_view(bytes).substr(kMagic.size());
  const int version = toNumber<int>(takeLine(text, "format_version"));
  if (version > kFormatVersion) {
    refuse(path, fmt::format("has format version {}, want at most {}: it was written by a newer Handhold", version,
                             kFormatVersion));
  }
  SetBlock block;
  block.object = takeLine(text, "object");
  block.hand = takeLine(text, "hand");
  block.setVersion = toNumber<int>(takeLine(text, "set_version"));
  block.inputHash = takeLine(text, "input_hash");
  block.bytes = toNumber<std::size_t>(takeLine(text, "bytes"));
  block.checksum = takeLine(text, "xxh3_128");
  if (bytes != encodeBlock(block)) {
    refuse(path, fmt::format("is damaged: its first {} bytes do not match the checksum in them", kBlockBytes));
  }
  if (size != kBlockBytes + block.bytes) {
    refuse(path, fmt::format("is damaged: it has {} bytes, want {}", size, kBlockBytes + block.bytes));
  }
  return block;
}

/// Reads the block and compares the checksum of all that follows, before HDF5 sees any of it: HDF5 can crash on or hang
/// over a damaged file.
SetBlock verifyFile(const fs::path& path) {
  const InputFile file(path);
  const SetBlock block = readBlock(file, path);
  ContentHash hash;
  std::vector<char> buffer(std::size_t{1} << 20);
  while (const std::size_t count = file.read(buffer.data(), buffer.size())) hash.addBytes(buffer.data(), count);
  const std::string found = hash.hex();
  if (found != block.checksum) {
    refuse(path, fmt::format("is damaged: the checksum of its data is {}, want {}", found, block.checksum));
  }
  return block;
}

/// Refuses a shape that contradicts `sizes`; sizes not known yet are learned from it.
void matchShape(const Hdf5View& file, const char* path, const Shape& shape, std::string_view symbols, Sizes& sizes) {
  bool matches = shape.size() == symbols.size();
  for (std::size_t i = 0; matches && i < symbols.size(); ++i) {
    const auto [entry, isNew] = sizes.try_emplace(symbols[i], shape[i]);
    matches = entry->second == shape[i];
    if (isNew && symbols[i] == 'n') sizes['+'] = shape[i] + 1;
  }
  if (matches) return;
  std::string wanted;
  for (const char symbol : symbols) {
    const auto entry = sizes.find(symbol);
    const std::string name = symbol == '+' ? "n+1" : std::string(1, symbol);
    const bool isSymbol = entry != sizes.end() && symbol != '3' && symbol != '7';
    wanted += (wanted.empty() ? "" : ", ") + (isSymbol ? fmt::format("{}={}", name, entry->second) : name);
  }
  file.refuse(fmt::format("{} has shape {}, want ({})", path, shapeText(shape), wanted));
}

TriangleMesh readMesh(const Hdf5View& file, const std::string& folder) {
  Shape shape;
  Sizes sizes{{'3', 3}};
  TriangleMesh mesh;
  const std::string verticesPath = folder + "/vertices";
  const std::vector<float> vertices = file.array<float>(verticesPath, shape);
  matchShape(file, verticesPath.c_str(), shape, "V3", sizes);
  for (std::size_t i = 0; i < vertices.size(); i += 3) {
    mesh.vertices.emplace_back(vertices[i], vertices[i + 1], vertices[i + 2]);
  }
  const std::string trianglesPath = folder + "/triangles";
  const std::vector<std::uint32_t> triangles = file.array<std::uint32_t>(trianglesPath, shape);
  matchShape(file, trianglesPath.c_str(), shape, "F3", sizes);
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    mesh.triangles.push_back({triangles[i], triangles[i + 1], triangles[i + 2]});
  }
  return mesh;
}

void readRootAttributes(const Hdf5View& file, GraspSet& set) {
  const int version = file.number<std::int32_t>("/", "format_version");
  if (version != kFormatVersion) {
    file.refuse(fmt::format("/@format_version is {}, want {} as in the first bytes", version, kFormatVersion));
  }
  forEachRootAttribute([&](const std::string& name, auto member) {
    if (isLaterAttribute(name) && !file.hasAttribute("/", name)) return;  // from before it
    if constexpr (std::is_same_v<decltype(member), std::string GraspSet::*>) {
      set.*member = file.textAttribute("/", name);
    } else {
      set.*member = file.number<std::decay_t<decltype(set.*member)>>("/", name);
    }
  });
}

/// The copies in the first 512 bytes must say what the attributes say.
void checkBlock(const Hdf5View& file, const SetBlock& block, const GraspSet& set) {
  const auto check = [&](std::string_view name, const auto& inBlock, const auto& attribute) {
    if (inBlock != attribute) {
      file.refuse(fmt::format("/@{} is {}, want {} as in the first bytes", name, attribute, inBlock));
    }
  };
  check("object", block.object, set.object);
  check("hand", block.hand, set.hand);
  check("set_version", block.setVersion, set.setVersion);
  check("input_hash", block.inputHash, set.inputHash);
}

/// Sets from before the attribute were run by the reference policy alone.
std::uint64_t readByReference(const Hdf5View& file, std::size_t trials) {
  return file.hasAttribute("/trials", "by_reference") ? file.number<std::uint64_t>("/trials", "by_reference") : trials;
}

/// What the names alone say about the lengths of the arrays.
Sizes knownSizes(const GraspSet& set) {
  return {{'3', 3}, {'7', 7}, {'J', set.jointNames.size()}, {'M', set.preshapeNames.size()}};
}

/// Reads the arrays below `group`; the lengths that are not known yet are learned from them.
void readArrays(const Hdf5View& file, std::string_view group, Sizes& sizes, GraspSet& set) {
  forEachArray([&](const char* path, auto member, std::string_view symbols) {
    if (!std::string_view(path).starts_with(group)) return;
    auto& values = set.*member;
    if constexpr (std::is_floating_point_v<typename std::decay_t<decltype(values)>::value_type>) {
      if (isLaterArray(path) && !file.has(path)) {  // from before them
        values.assign(sizes.at('n'), std::nanf(""));
        return;
      }
    }
    Shape shape;
    values = file.array<typename std::decay_t<decltype(values)>::value_type>(path, shape);
    matchShape(file, path, shape, symbols, sizes);
  });
  set.samples = sizes.at('N');
  set.rolls = sizes.at('R');
  set.preshapes = sizes.at('M');
}

void readTimings(const Hdf5View& file, std::map<std::string, double>& seconds, std::string& host,
                 std::string& created) {
  const std::vector<std::string> names = file.texts("/timings/stage_names");
  Shape shape;
  const std::vector<double> values = file.array<double>("/timings/seconds", shape);
  if (shape != Shape{names.size()}) {
    file.refuse(fmt::format("/timings/seconds has shape {}, want ({})", shapeText(shape), names.size()));
  }
  for (std::size_t i = 0; i < names.size(); ++i) seconds[names[i]] = values[i];
  host = file.textAttribute("/timings", "host");
  created = file.textAttribute("/timings", "created");
}

bool readWatertight(const Hdf5View& file) {
  const int value = file.number<std::uint8_t>("/object", "watertight");
  if (value > 1) file.refuse(fmt::format("/object@watertight is {}, want 0 or 1", value));
  return value == 1;
}

GraspSet decodeGraspSet(const Hdf5View& file, const SetBlock& block) {
  GraspSet set;
  readRootAttributes(file, set);
  checkBlock(file, block, set);
  set.objectMesh = readMesh(file, "/object");
  set.watertight = readWatertight(file);
  Shape shape;
  const std::vector<double> center = file.array<double>("/object/center_of_mass", shape);
  if (shape != Shape{3}) file.refuse(fmt::format("/object/center_of_mass has shape {}, want (3)", shapeText(shape)));
  set.centerOfMass = {center[0], center[1], center[2]};
  forEachTexts([&](const char* path, auto member) { set.*member = file.texts(path); });
  forEachText([&](const char* path, auto member) { set.*member = file.text(path); });
  for (const std::string& name : set.linkNames) set.linkMeshes.push_back(readMesh(file, linkFolder(name)));
  Sizes sizes = knownSizes(set);
  readArrays(file, "/", sizes, set);
  set.neighbors = static_cast<int>(sizes.at('k'));
  set.outcomeNames = file.textsAttribute("/trials/outcome", "names");
  set.trialsByReference = readByReference(file, set.trialCount());
  readTimings(file, set.seconds, set.host, set.created);
  return set;
}

/// Of the first grasp its bounds and load margin, of all the least critical friction and the largest load margin; NaN
/// where no row has a number.
void readLaterArrays(const Hdf5View& file, Sizes& sizes, GraspSetSummary& summary) {
  Shape shape;
  const auto read = [&]<class T>(const char* path, T) {
    if (!file.has(path)) return std::vector<T>{};
    std::vector<T> values = file.array<T>(path, shape);
    matchShape(file, path, shape, "n", sizes);
    return values;
  };
  const std::vector<double> lower = read("/grasps/epsilon_lower", 0.0), upper = read("/grasps/epsilon_upper", 0.0);
  if (!lower.empty()) summary.bestEpsilonLower = lower.front();
  if (!upper.empty()) summary.bestEpsilonUpper = upper.front();
  for (const float friction : read("/grasps/critical_friction", 0.0f)) {
    summary.leastCriticalFriction = std::fmin(summary.leastCriticalFriction, friction);
  }
  const auto first = [&](const char* path) {
    const std::vector<float> values = read(path, 0.0f);
    return values.empty() ? std::nan("") : static_cast<double>(values.front());
  };
  summary.bestRobustness = first("/grasps/robustness");
  summary.bestRobustnessLower = first("/grasps/robustness_lower");
  summary.bestRobustnessUpper = first("/grasps/robustness_upper");
  const std::vector<float> margins = read("/grasps/load_margin", 0.0f);
  if (!margins.empty()) summary.bestLoadMargin = margins.front();
  for (const float margin : margins) {
    summary.largestLoadMargin = std::fmax(summary.largestLoadMargin, margin);
    summary.loadMargins += std::isnan(margin) ? 0 : 1;
  }
}

/// How often each outcome occurs, in the order of their names.
std::vector<std::pair<std::string, std::size_t>> countOutcomes(const Hdf5View& file,
                                                               const std::vector<std::uint8_t>& outcome) {
  std::vector<std::pair<std::string, std::size_t>> counts;
  for (const std::string& name : file.textsAttribute("/trials/outcome", "names")) counts.emplace_back(name, 0);
  for (const std::uint8_t index : outcome) {
    if (index >= counts.size()) {
      file.refuse(fmt::format("/trials/outcome has {}, want below {}", index, counts.size()));
    }
    ++counts[index].second;
  }
  return counts;
}

}  // namespace

GraspSet readGraspSet(const fs::path& path) {
  const SetBlock block = verifyFile(path);
  GraspSet set = decodeGraspSet(Hdf5View(path), block);
  checkGraspSet(set, path.string());
  return set;
}

GraspSet readGraspTable(const fs::path& path) {
  const SetBlock block = verifyFile(path);
  const Hdf5View file(path);
  GraspSet set;
  readRootAttributes(file, set);
  checkBlock(file, block, set);
  set.jointNames = file.texts("/hand/joint_names");
  set.preshapeNames = file.texts("/hand/preshape_names");
  Sizes sizes = knownSizes(set);
  matchShape(file, "/trials/outcome", file.shape<std::uint8_t>("/trials/outcome"), "NRM", sizes);
  readArrays(file, "/grasps/", sizes, set);
  checkGraspTable(set, path.string());
  return set;
}

GraspSetSummary readSummary(const fs::path& path) {
  const SetBlock block = verifyFile(path);
  const Hdf5View file(path);
  GraspSet set;
  readRootAttributes(file, set);
  checkBlock(file, block, set);
  Shape trials, grasps;
  const std::vector<std::uint8_t> outcome = file.array<std::uint8_t>("/trials/outcome", trials);
  const std::vector<double> epsilon = file.array<double>("/grasps/epsilon", grasps);
  Sizes sizes;
  matchShape(file, "/trials/outcome", trials, "NRM", sizes);
  matchShape(file, "/grasps/epsilon", grasps, "n", sizes);

  GraspSetSummary summary;
  summary.path = path;
  summary.object = set.object;
  summary.hand = set.hand;
  summary.inputHash = set.inputHash;
  summary.generator = set.generator;
  summary.policy = set.policy;
  summary.setVersion = set.setVersion;
  summary.friction = set.friction;
  summary.coneEdges = set.coneEdges;
  summary.torsionRadius = set.torsionRadius;
  summary.robustnessTrials = set.robustnessTrials;
  summary.robustnessPosition = set.robustnessPosition;
  summary.robustnessRotation = set.robustnessRotation;
  summary.watertight = readWatertight(file);
  summary.samples = trials[0];
  summary.rolls = trials[1];
  summary.preshapes = trials[2];
  summary.trialsByReference = readByReference(file, outcome.size());
  summary.grasps = epsilon.size();
  summary.bytes = kBlockBytes + block.bytes;
  summary.outcomes = countOutcomes(file, outcome);
  summary.bestEpsilon = epsilon.empty() ? 0 : epsilon.front();
  readLaterArrays(file, sizes, summary);
  readTimings(file, summary.seconds, summary.host, summary.created);
  summary.objectNotes = file.texts("/object/notes");
  return summary;
}

std::string readInputHash(const fs::path& path) { return readBlock(InputFile(path), path).inputHash; }

}  // namespace handhold
