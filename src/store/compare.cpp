#include "store/compare.h"

#include "core/error.h"
#include "core/yaml.h"
#include "store/database.h"
#include "store/layout.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <sstream>
#include <tuple>

#include <fmt/format.h>

namespace handhold {
namespace {

/// Bit for bit; a NaN is a NaN.
template <class Number>
bool isEqual(Number a, Number b) {
  if constexpr (std::is_same_v<Number, double>) {
    return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (std::isnan(a) && std::isnan(b));
  } else if constexpr (std::is_same_v<Number, float>) {
    return std::bit_cast<std::uint32_t>(a) == std::bit_cast<std::uint32_t>(b) || (std::isnan(a) && std::isnan(b));
  } else {
    return a == b;
  }
}

template <class Number>
bool isEqual(const std::vector<Number>& a, const std::vector<Number>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](Number x, Number y) { return isEqual(x, y); });
}

/// Takes down the names for which something differs.
class Comparison {
 public:
  void add(const std::string& name, bool equal) {
    if (!equal) differing.push_back(name);
  }
  void addMesh(const std::string& folder, const TriangleMesh& a, const TriangleMesh& b) {
    add(folder + "/vertices", a.vertices == b.vertices);
    add(folder + "/triangles", a.triangles == b.triangles);
  }
  std::vector<std::string> differing;
};

template <class Number>
std::string numberText(Number value) {
  return fmt::format("{}", value);
}

// --- inputs

using Leaves = std::map<std::string, std::string>;

/// `[name=mug]` for a map that names itself, so that an item keeps its label when others come or go.
std::string labelOf(const YamlValue& item, std::size_t index) {
  if (item.kind() == YamlValue::Kind::map) {
    for (const char* key : {"name", "joint", "link"}) {
      const YamlValue* value = item.find(key);
      if (value != nullptr && value->kind() == YamlValue::Kind::scalar) return fmt::format("[{}]", value->text());
    }
  }
  return fmt::format("[{}]", index);
}

/// Every scalar below `value` by its key path; a list of scalars is one leaf.
void addLeaves(const YamlValue& value, const std::string& key, Leaves& leaves) {
  switch (value.kind()) {
    case YamlValue::Kind::null:
      leaves[key] = "empty";
      return;
    case YamlValue::Kind::scalar:
      leaves[key] = value.text();
      return;
    case YamlValue::Kind::map:
      for (const auto& [name, entry] : value.entries()) addLeaves(entry, key.empty() ? name : key + "." + name, leaves);
      return;
    case YamlValue::Kind::sequence: {
      const std::vector<YamlValue>& items = value.items();
      if (std::all_of(items.begin(), items.end(), [](auto& i) { return i.kind() == YamlValue::Kind::scalar; })) {
        std::string list;
        for (const YamlValue& item : items) list += (list.empty() ? "" : ", ") + item.text();
        leaves[key] = "[" + list + "]";
        return;
      }
      for (std::size_t i = 0; i < items.size(); ++i) addLeaves(items[i], key + labelOf(items[i], i), leaves);
    }
  }
}

/// Empty when the text is no YAML of ours.
Leaves leavesOf(const std::string& text) {
  Leaves leaves;
  try {
    addLeaves(YamlValue::parseText(text, "stored text"), "", leaves);
  } catch (const InputError&) {
    leaves.clear();
  }
  return leaves;
}

int firstDifferentLine(const std::string& a, const std::string& b) {
  std::istringstream linesA(a), linesB(b);
  std::string lineA, lineB;
  for (int number = 1;; ++number) {
    const bool moreA = static_cast<bool>(std::getline(linesA, lineA)),
               moreB = static_cast<bool>(std::getline(linesB, lineB));
    if (moreA != moreB || !moreA || lineA != lineB) return number;
  }
}

std::string linesText(const std::string& text, int firstDifferent) {
  return fmt::format("{} lines, other from line {}", std::count(text.begin(), text.end(), '\n'), firstDifferent);
}

std::string meshText(const TriangleMesh& mesh) {
  return fmt::format("{} vertices, {} triangles", mesh.vertices.size(), mesh.triangles.size());
}

std::string listText(const std::vector<std::string>& names) { return fmt::format("[{}]", fmt::join(names, ", ")); }

/// Collects what differs of the inputs.
class Inputs {
 public:
  std::vector<Pair<std::string>> changed;

  void add(const std::string& name, const std::string& a, const std::string& b) {
    if (a != b) changed.push_back({name, a, b});
  }

  /// A YAML text key by key; in one that differs in comments alone, or is none, where it starts to.
  /// @param catalogOf  of the entries of `catalog` only this object's matter (and those that name several)
  void addYaml(const std::string& name, const std::string& a, const std::string& b, const std::string& catalogOf) {
    if (a == b) return;
    const std::size_t before = changed.size();
    const Leaves leavesA = leavesOf(a), leavesB = leavesOf(b);
    bool othersChanged = false;
    Leaves all = leavesA;
    all.insert(leavesB.begin(), leavesB.end());
    for (const auto& [key, unused] : all) {
      const auto inA = leavesA.find(key), inB = leavesB.find(key);
      const std::string textA = inA == leavesA.end() ? "(not given)" : inA->second,
                        textB = inB == leavesB.end() ? "(not given)" : inB->second;
      if (textA == textB) continue;
      if (isOfAnotherObject(key, catalogOf)) {
        othersChanged = true;
      } else {
        add(name + " " + key, textA, textB);
      }
    }
    if (othersChanged) add(name + " catalog", "other objects", "others");
    if (changed.size() == before) addText(name, a, b);
  }

  void addText(const std::string& name, const std::string& a, const std::string& b) {
    if (a == b) return;
    const int line = firstDifferentLine(a, b);
    changed.push_back({name, linesText(a, line), linesText(b, line)});
  }

  void addMesh(const std::string& name, const TriangleMesh& a, const TriangleMesh& b) {
    if (a.vertices == b.vertices && a.triangles == b.triangles) return;
    std::string textA = meshText(a), textB = meshText(b);
    if (a.vertices.size() == b.vertices.size()) {
      std::size_t moved = 0;
      double largest = 0;
      for (std::size_t i = 0; i < a.vertices.size(); ++i) {
        const double shift = (a.vertices[i] - b.vertices[i]).norm();
        if (shift > 0) ++moved;
        largest = std::max(largest, shift);
      }
      textB += fmt::format("; {} moved, by up to {:.4g} mm", moved, 1e3 * largest);
    }
    changed.push_back({name, textA, textB});
  }

 private:
  static bool isOfAnotherObject(const std::string& key, const std::string& object) {
    if (object.empty() || !key.starts_with("catalog[")) return false;
    const std::string label = key.substr(8, key.find(']') - 8);
    const bool isNumber = label.find_first_not_of("0123456789") == std::string::npos;
    return label != object && !isNumber && label.find('{') == std::string::npos;
  }
};

std::vector<Pair<std::string>> changedInputs(const GraspSet& a, const GraspSet& b) {
  Inputs inputs;
  inputs.addYaml("job", a.job, b.job, a.object);
  forEachRootAttribute([&](const std::string& name, auto member) {
    if (name == "job" || name == "set_version" || name == "input_hash") return;
    if (!isEqual(a.*member, b.*member)) inputs.add(name, numberText(a.*member), numberText(b.*member));
  });
  inputs.addMesh("object mesh", a.objectMesh, b.objectMesh);
  inputs.add("watertight", a.watertight ? "yes" : "no", b.watertight ? "yes" : "no");
  inputs.add("object notes", listText(a.objectNotes), listText(b.objectNotes));
  inputs.addYaml("hand.yaml", a.config, b.config, "");
  inputs.addText("urdf", a.urdf, b.urdf);
  inputs.add("joints", listText(a.jointNames), listText(b.jointNames));
  inputs.add("links", listText(a.linkNames), listText(b.linkNames));
  inputs.add("preshapes", listText(a.preshapeNames), listText(b.preshapeNames));
  for (std::size_t i = 0; i < a.linkNames.size(); ++i) {
    const auto same = std::find(b.linkNames.begin(), b.linkNames.end(), a.linkNames[i]);
    if (same == b.linkNames.end()) continue;
    inputs.addMesh("mesh of link " + a.linkNames[i], a.linkMeshes[i], b.linkMeshes[same - b.linkNames.begin()]);
  }
  inputs.add("samples", numberText(a.samples), numberText(b.samples));
  inputs.add("rolls", numberText(a.rolls), numberText(b.rolls));
  return inputs.changed;
}

// --- counts and quality

std::vector<Pair<std::size_t>> countsOf(const GraspSet& a, const GraspSet& b) {
  std::vector<Pair<std::size_t>> counts = {{"trials", a.trialCount(), b.trialCount()}};
  const auto entry = [&](const std::string& name) -> Pair<std::size_t>& {
    const auto known = std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.name == name; });
    return known != counts.end() ? *known : counts.emplace_back(Pair<std::size_t>{name, 0, 0});
  };
  std::vector<std::size_t> ofA(a.outcomeNames.size()), ofB(b.outcomeNames.size());
  for (const std::uint8_t outcome : a.outcome) ++ofA[outcome];
  for (const std::uint8_t outcome : b.outcome) ++ofB[outcome];
  for (std::size_t i = 0; i < ofA.size(); ++i) entry(a.outcomeNames[i]).a += ofA[i];
  for (std::size_t i = 0; i < ofB.size(); ++i) entry(b.outcomeNames[i]).b += ofB[i];
  entry("by_reference") = {"by_reference", a.trialsByReference, b.trialsByReference};
  counts.push_back({"grasps", a.graspCount(), b.graspCount()});
  return counts;
}

/// Of the stored grasps, whose epsilon falls: the value that `share` of them do not exceed (nearest rank).
double quantile(const GraspSet& set, double share) {
  if (set.graspCount() == 0) return std::nan("");
  const double rank = std::ceil(share * static_cast<double>(set.graspCount()));
  return set.epsilon[set.graspCount() - std::max<std::size_t>(1, static_cast<std::size_t>(rank))];
}

double shareForceClosed(const GraspSet& set) {
  const auto name = std::find(set.outcomeNames.begin(), set.outcomeNames.end(), "force_closed");
  if (set.outcome.empty() || name == set.outcomeNames.end()) return set.outcome.empty() ? std::nan("") : 0;
  const auto index = static_cast<std::uint8_t>(name - set.outcomeNames.begin());
  return static_cast<double>(std::count(set.outcome.begin(), set.outcome.end(), index)) /
         static_cast<double>(set.outcome.size());
}

// --- grasps in both

/// What makes two grasps the same trial, wherever it stands in its set's table.
using GraspKey = std::tuple<std::array<float, 7>, std::string>;

GraspKey keyOf(const GraspSet& set, std::size_t row) {
  std::array<float, 7> numbers{};
  std::copy_n(set.targetPoint.begin() + 3 * row, 3, numbers.begin());
  std::copy_n(set.approachDirection.begin() + 3 * row, 3, numbers.begin() + 3);
  numbers[6] = set.roll[row];
  return {numbers, set.preshapeNames[set.trial[3 * row + 2]]};
}

Eigen::Isometry3d poseOf(const GraspSet& set, std::size_t row) {
  const double* p = set.handPose.data() + 7 * row;
  return Eigen::Translation3d(p[0], p[1], p[2]) * Eigen::Quaterniond(p[6], p[3], p[4], p[5]);
}

void compareGrasps(const GraspSet& a, const GraspSet& b, SetComparison& result) {
  std::map<GraspKey, std::size_t> rowsOfB;
  for (std::size_t row = 0; row < b.graspCount(); ++row) rowsOfB.emplace(keyOf(b, row), row);
  for (std::size_t row = 0; row < a.graspCount(); ++row) {
    const auto match = rowsOfB.find(keyOf(a, row));
    if (match == rowsOfB.end()) {
      ++result.onlyA;
      continue;
    }
    ++result.common;
    const std::size_t other = match->second;
    rowsOfB.erase(match);
    if (!isEqual(a.epsilon[row], b.epsilon[other])) ++result.epsilonChanged;
    result.largestEpsilonChange = std::max(result.largestEpsilonChange, std::abs(a.epsilon[row] - b.epsilon[other]));
    if (std::equal(a.handPose.begin() + 7 * row, a.handPose.begin() + 7 * (row + 1), b.handPose.begin() + 7 * other)) {
      continue;
    }
    ++result.poseChanged;
    const Eigen::Isometry3d X_AB = poseOf(a, row).inverse() * poseOf(b, other);
    result.largestShift = std::max(result.largestShift, X_AB.translation().norm());
    result.largestTurn = std::max(result.largestTurn, std::abs(Eigen::AngleAxisd(X_AB.linear()).angle()));
  }
  result.onlyB = b.graspCount() - result.common;
}

}  // namespace

std::vector<std::string> differences(const GraspSet& a, const GraspSet& b) {
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
  return comparison.differing;
}

std::string firstDifference(const GraspSet& a, const GraspSet& b) {
  const std::vector<std::string> all = differences(a, b);
  return all.empty() ? "" : all.front();
}

std::optional<GraspDifference> firstGraspDifference(const GraspSet& a, std::size_t rowA, const GraspSet& b,
                                                    std::size_t rowB) {
  const Sizes sizesA = sizesOf(a), sizesB = sizesOf(b);
  const std::size_t contactsA = a.contactBegin[rowA + 1] - a.contactBegin[rowA],
                    contactsB = b.contactBegin[rowB + 1] - b.contactBegin[rowB];
  if (contactsA != contactsB) {
    return GraspDifference{"/grasps/contact_begin", fmt::format("{} contacts", contactsA),
                           fmt::format("{} contacts", contactsB)};
  }
  std::optional<GraspDifference> first;
  forEachArray([&](const char* path, auto member, std::string_view symbols) {
    const bool ofGrasp = symbols[0] == 'n', ofContact = symbols[0] == 'C';
    if (first || (!ofGrasp && !ofContact)) return;
    std::size_t widthA = 1, widthB = 1;
    for (const char symbol : symbols.substr(1)) widthA *= sizesA.at(symbol), widthB *= sizesB.at(symbol);
    if (widthA != widthB) {
      first = {path, fmt::format("{} columns", widthA), fmt::format("{} columns", widthB)};
      return;
    }
    const std::size_t beginA = widthA * (ofGrasp ? rowA : a.contactBegin[rowA]),
                      beginB = widthA * (ofGrasp ? rowB : b.contactBegin[rowB]),
                      count = widthA * (ofGrasp ? 1 : contactsA);
    for (std::size_t i = 0; i < count && !first; ++i) {
      const auto x = (a.*member)[beginA + i], y = (b.*member)[beginB + i];
      if (!isEqual(x, y)) first = {path, numberText(x), numberText(y)};
    }
  });
  return first;
}

SetComparison compareSets(const GraspSet& a, const GraspSet& b) {
  SetComparison result;
  result.datasets = differences(a, b);
  result.inputs = changedInputs(a, b);
  result.counts = countsOf(a, b);
  result.quality = {{"share_force_closed", shareForceClosed(a), shareForceClosed(b)},
                    {"best_epsilon", quantile(a, 1), quantile(b, 1)},
                    {"p90_epsilon", quantile(a, 0.9), quantile(b, 0.9)},
                    {"median_epsilon", quantile(a, 0.5), quantile(b, 0.5)}};
  compareGrasps(a, b, result);
  return result;
}

}  // namespace handhold
