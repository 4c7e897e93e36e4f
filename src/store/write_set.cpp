#include "core/error.h"
#include "core/hash.h"
#include "store/layout.h"

#include <cassert>
#include <cmath>
#include <set>
#include <tuple>

#include <fmt/format.h>

namespace handhold {
namespace {

[[noreturn]] void refuse(std::string_view where, std::string_view message) {
  throw InputError(fmt::format("{}: {}", where, message));
}

Shape shapeOf(std::string_view symbols, const Sizes& sizes) {
  Shape shape;
  for (const char symbol : symbols) shape.push_back(sizes.at(symbol));
  return shape;
}

/// A text that HDF5 would cut short.
bool hasZero(std::string_view text) { return text.find('\0') != std::string_view::npos; }

void checkTexts(const GraspSet& set, std::string_view where) {
  const auto check = [&](std::string_view path, const std::vector<std::string>& texts) {
    for (const std::string& text : texts) {
      if (hasZero(text)) refuse(where, fmt::format("{} has a zero byte in a text, want none", path));
    }
  };
  forEachTexts([&](std::string_view path, auto member) { check(path, set.*member); });
  forEachText([&](std::string_view path, auto member) { check(path, {set.*member}); });
  forEachRootAttribute([&](std::string_view name, auto member) {
    if constexpr (std::is_same_v<decltype(member), std::string GraspSet::*>) check(name, {set.*member});
  });
  check("/trials/outcome@names", set.outcomeNames);
  check("/timings", {set.host, set.created});
}

void checkProvenance(const GraspSet& set, std::string_view where) {
  const bool isHex = set.inputHash.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!isHex || set.inputHash.empty() || set.inputHash.size() > 64) {
    refuse(where, fmt::format("/@input_hash is \"{}\", want 1 to 64 hexadecimal digits", set.inputHash));
  }
  forEachRootAttribute([&](std::string_view name, auto member) {
    if constexpr (std::is_same_v<decltype(member), double GraspSet::*>) {
      if (!std::isfinite(set.*member)) refuse(where, fmt::format("/@{} is {}, want a number", name, set.*member));
    }
  });
  if (set.robustnessTrials < 0)
    refuse(where, fmt::format("/@robustness_trials is {}, want >= 0", set.robustnessTrials));
  if (set.robustnessPosition < 0)
    refuse(where, fmt::format("/@robustness_position is {}, want >= 0", set.robustnessPosition));
  if (set.robustnessRotation < 0)
    refuse(where, fmt::format("/@robustness_rotation is {}, want >= 0", set.robustnessRotation));
  if (set.torsionRadius < 0) refuse(where, fmt::format("/@torsion_radius is {}, want >= 0", set.torsionRadius));
  if (!set.centerOfMass.allFinite()) refuse(where, "/object/center_of_mass is not finite, want three numbers");
}

void checkMesh(const TriangleMesh& mesh, const std::string& folder, std::string_view where) {
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    for (const double x : mesh.vertices[i]) {
      const bool isFloat = std::isfinite(x) && static_cast<double>(static_cast<float>(x)) == x;
      if (!isFloat) refuse(where, fmt::format("{}/vertices row {} has {}, want a 32-bit float", folder, i, x));
    }
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (const std::uint32_t vertex : mesh.triangles[i]) {
      if (vertex < mesh.vertices.size()) continue;
      refuse(where,
             fmt::format("{}/triangles row {} has vertex {}, want below {}", folder, i, vertex, mesh.vertices.size()));
    }
  }
}

void checkHand(const GraspSet& set, std::string_view where) {
  std::set<std::string_view> seen;
  for (const std::string& name : set.linkNames) {
    if (name.empty() || !seen.insert(name).second) {
      refuse(where, fmt::format("/hand/link_names has \"{}\", want names that differ and are not empty", name));
    }
  }
  if (set.linkMeshes.size() != set.linkNames.size()) {
    refuse(where, fmt::format("/hand/links has {} meshes, want {}", set.linkMeshes.size(), set.linkNames.size()));
  }
  for (std::size_t i = 0; i < set.linkNames.size(); ++i) {
    checkMesh(set.linkMeshes[i], linkFolder(set.linkNames[i]), where);
  }
  if (set.preshapes != set.preshapeNames.size()) {
    refuse(where, fmt::format("/hand/preshape_names has {} names, want {} as /trials/outcome has preshapes",
                              set.preshapeNames.size(), set.preshapes));
  }
}

/// The arrays below `group`.
void checkArrays(const GraspSet& set, std::string_view group, std::string_view where) {
  const Sizes sizes = sizesOf(set);
  forEachArray([&](std::string_view path, auto member, std::string_view symbols) {
    if (!path.starts_with(group)) return;
    const auto& values = set.*member;
    const Shape shape = shapeOf(symbols, sizes);
    std::size_t count = 1;
    for (const std::size_t length : shape) count *= length;
    if (values.size() != count) {
      refuse(where, fmt::format("{} has {} numbers, want shape {}", path, values.size(), shapeText(shape)));
    }
    if constexpr (std::is_floating_point_v<std::decay_t<decltype(values[0])>>) {
      if (path == "/trials/epsilon") return;  // NaN there means that it was not evaluated
      const bool allowsNan = isLaterArray(path), allowsInfinity = path == "/grasps/load_margin";
      for (std::size_t i = 0; i < count; ++i) {
        const bool isAllowed =
            std::isfinite(values[i]) || (allowsNan && std::isnan(values[i])) || (allowsInfinity && values[i] > 0);
        if (!isAllowed) {
          refuse(where, fmt::format("{} is {} at element {}, want a number", path, values[i], i));
        }
      }
    }
  });
}

void checkOutcomes(const GraspSet& set, std::string_view where) {
  for (std::size_t i = 0; i < set.outcome.size(); ++i) {
    if (set.outcome[i] >= set.outcomeNames.size()) {
      refuse(where, fmt::format("/trials/outcome is {} at element {}, want below {}", set.outcome[i], i,
                                set.outcomeNames.size()));
    }
  }
  if (set.trialsByReference > set.trialCount()) {
    refuse(where, fmt::format("/trials@by_reference is {}, want at most {}", set.trialsByReference, set.trialCount()));
  }
}

/// Rows refer to trials that exist and stand in their order: falling epsilon, ties by trial.
void checkRows(const GraspSet& set, std::string_view where) {
  const auto key = [&](std::size_t row) {
    return std::tuple(-set.epsilon[row], set.trial[3 * row], set.trial[3 * row + 1], set.trial[3 * row + 2]);
  };
  for (std::size_t row = 0; row < set.graspCount(); ++row) {
    const auto [_, sample, roll, preshape] = key(row);
    if (sample >= set.samples || roll >= set.rolls || preshape >= set.preshapes) {
      refuse(where, fmt::format("/grasps/trial row {} is ({}, {}, {}), want below ({}, {}, {})", row, sample, roll,
                                preshape, set.samples, set.rolls, set.preshapes));
    }
    if (row > 0 && !(key(row - 1) < key(row))) {
      refuse(where, fmt::format("/grasps/epsilon row {} is {} after {}, want falling numbers, ties by trial", row,
                                set.epsilon[row], set.epsilon[row - 1]));
    }
    if (set.epsilonLower[row] > set.epsilonUpper[row]) {
      refuse(where, fmt::format("/grasps/epsilon_lower row {} is {}, want at most epsilon_upper {}", row,
                                set.epsilonLower[row], set.epsilonUpper[row]));
    }
    const float lower = set.robustnessLower[row], upper = set.robustnessUpper[row];
    if (lower < 0 || set.robustness[row] < lower || upper < set.robustness[row] || upper > 1) {
      refuse(where, fmt::format("/grasps/robustness row {} is {} in [{}, {}], want an interval within [0, 1] around it",
                                row, set.robustness[row], lower, upper));
    }
    if (set.loadMargin[row] < 0) {
      refuse(where, fmt::format("/grasps/load_margin row {} is {}, want at least 0", row, set.loadMargin[row]));
    }
  }
}

void checkContactBegin(const GraspSet& set, std::string_view where) {
  const std::vector<std::uint32_t>& begin = set.contactBegin;
  if (begin.front() != 0) refuse(where, fmt::format("/grasps/contact_begin starts with {}, want 0", begin.front()));
  for (std::size_t row = 1; row < begin.size(); ++row) {
    if (begin[row] < begin[row - 1]) {
      refuse(where,
             fmt::format("/grasps/contact_begin row {} is {} after {}, want no fall", row, begin[row], begin[row - 1]));
    }
  }
}

void checkContacts(const GraspSet& set, std::string_view where) {
  checkContactBegin(set, where);
  if (set.contactBegin.back() != set.contactLink.size()) {
    refuse(where, fmt::format("/grasps/contact_begin ends with {}, want the number of contacts {}",
                              set.contactBegin.back(), set.contactLink.size()));
  }
  for (std::size_t i = 0; i < set.contactLink.size(); ++i) {
    if (set.contactLink[i] >= set.linkNames.size()) {
      refuse(where,
             fmt::format("/contacts/link row {} is {}, want below {}", i, set.contactLink[i], set.linkNames.size()));
    }
  }
}

void checkNeighbors(const GraspSet& set, std::string_view where) {
  const std::size_t nPoints = set.mapPoint.size() / 3;
  for (std::size_t i = 0; i < set.mapNeighbor.size(); ++i) {
    if (set.mapNeighbor[i] >= nPoints) {
      refuse(where,
             fmt::format("/distance_map/neighbor is {} at element {}, want below {}", set.mapNeighbor[i], i, nPoints));
    }
  }
}

void addMesh(Hdf5Builder& file, const std::string& folder, const TriangleMesh& mesh) {
  std::vector<float> vertices;
  for (const Eigen::Vector3d& vertex : mesh.vertices) {
    for (const double x : vertex) vertices.push_back(static_cast<float>(x));
  }
  std::vector<std::uint32_t> triangles;
  for (const auto& triangle : mesh.triangles) triangles.insert(triangles.end(), triangle.begin(), triangle.end());
  file.addArray(folder + "/vertices", {mesh.vertices.size(), 3}, vertices);
  file.addArray(folder + "/triangles", {mesh.triangles.size(), 3}, triangles);
}

void addTimings(Hdf5Builder& file, const GraspSet& set) {
  std::vector<std::string> names;
  std::vector<double> seconds;
  for (const auto& [name, value] : set.seconds) {
    names.push_back(name);
    seconds.push_back(value);
  }
  file.addTexts("/timings/stage_names", names);
  file.addArray("/timings/seconds", {seconds.size()}, seconds);
  file.setText("/timings", "host", set.host);
  file.setText("/timings", "created", set.created);
}

std::string encodeHdf5(const GraspSet& set) {
  Hdf5Builder file(kBlockBytes);
  file.setNumber("/", "format_version", std::int32_t{kFormatVersion});
  forEachRootAttribute([&](const char* name, auto member) {
    if constexpr (std::is_same_v<decltype(member), std::string GraspSet::*>) {
      file.setText("/", name, set.*member);
    } else {
      file.setNumber("/", name, set.*member);
    }
  });
  for (const char* group : {"/object", "/hand", "/hand/links", "/samples", "/trials", "/grasps", "/contacts",
                            "/distance_map", "/timings"}) {
    file.addGroup(group);
  }
  addMesh(file, "/object", set.objectMesh);
  file.addArray("/object/center_of_mass", {3}, std::vector<double>(set.centerOfMass.begin(), set.centerOfMass.end()));
  file.setNumber("/object", "watertight", static_cast<std::uint8_t>(set.watertight ? 1 : 0));
  forEachTexts([&](const char* path, auto member) { file.addTexts(path, set.*member); });
  forEachText([&](const char* path, auto member) { file.addText(path, set.*member); });
  for (std::size_t i = 0; i < set.linkNames.size(); ++i) {
    file.addGroup(linkFolder(set.linkNames[i]));
    addMesh(file, linkFolder(set.linkNames[i]), set.linkMeshes[i]);
  }
  const Sizes sizes = sizesOf(set);
  forEachArray([&](const char* path, auto member, std::string_view symbols) {
    file.addArray(path, shapeOf(symbols, sizes), set.*member);
  });
  file.setTexts("/trials/outcome", "names", set.outcomeNames);
  file.setNumber("/trials", "by_reference", set.trialsByReference);
  addTimings(file, set);
  return file.image();
}

}  // namespace

Sizes sizesOf(const GraspSet& set) {
  const std::size_t n = set.graspCount();
  return {{'N', set.samples},
          {'R', set.rolls},
          {'M', set.preshapes},
          {'n', n},
          {'+', n + 1},
          {'J', set.jointNames.size()},
          {'C', set.contactLink.size()},
          {'S', set.mapPoint.size() / 3},
          {'k', static_cast<std::size_t>(set.neighbors)},
          {'3', 3},
          {'7', 7}};
}

std::string linkFolder(std::string_view linkName) {
  std::string folder = "/hand/links/";
  if (linkName == ".") return folder + "%2E";
  for (const char c : linkName) {
    if (c == '%') {
      folder += "%25";
    } else if (c == '/') {
      folder += "%2F";
    } else {
      folder += c;
    }
  }
  return folder;
}

void checkGraspSet(const GraspSet& set, std::string_view where) {
  checkTexts(set, where);
  checkProvenance(set, where);
  checkMesh(set.objectMesh, "/object", where);
  checkHand(set, where);
  checkArrays(set, "/", where);
  checkOutcomes(set, where);
  checkRows(set, where);
  checkContacts(set, where);
  checkNeighbors(set, where);
}

void checkGraspTable(const GraspSet& set, std::string_view where) {
  checkProvenance(set, where);
  checkArrays(set, "/grasps/", where);
  checkRows(set, where);
  checkContactBegin(set, where);
}

std::string encodeBlock(const SetBlock& block) {
  std::string text(kMagic);
  text += fmt::format("format_version {}\nobject {}\nhand {}\nset_version {}\ninput_hash {}\n", kFormatVersion,
                      block.object, block.hand, block.setVersion, block.inputHash);
  text += fmt::format("bytes {}\nxxh3_128 {}\n", block.bytes, block.checksum);
  text += fmt::format("block_xxh3_128 {}\n", hashBytes(text.data(), text.size()));
  assert(text.size() <= kBlockBytes);  // names have at most 100 characters, hashes 64
  text.resize(kBlockBytes, '\0');
  return text;
}

std::string encodeGraspSet(const GraspSet& set) {
  const std::string image = encodeHdf5(set);
  SetBlock block{set.object, set.hand, set.setVersion, set.inputHash, image.size(), ""};
  block.checksum = hashBytes(image.data(), image.size());
  return encodeBlock(block) + image;
}

}  // namespace handhold
