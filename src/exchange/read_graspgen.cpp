#include "core/error.h"
#include "core/file.h"
#include "exchange/read_formats.h"

#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using JsonInput = nlohmann::json;

/// A value of the file with the path that leads to it.
struct Place {
  const std::string& file;
  std::string key;
  const JsonInput& value;

  [[noreturn]] void refuse(std::string_view wanted) const {
    const std::string text = value.is_structured()
                                 ? fmt::format("{} of {}", value.is_array() ? "a list" : "a map", value.size())
                                 : value.dump(-1, ' ', false, JsonInput::error_handler_t::replace).substr(0, 60);
    throw InputError(fmt::format("{}: {} is {}, want {}", file, key.empty() ? "the file" : key, text, wanted));
  }
  Place at(const char* name) const {
    if (!value.is_object()) refuse("a map");
    const auto found = value.find(name);
    if (found == value.end())
      throw InputError(fmt::format("{}: {} has no key \"{}\", want one", file, key.empty() ? "the file" : key, name));
    return {file, key.empty() ? name : key + "." + name, *found};
  }
  Place at(std::size_t index) const { return {file, fmt::format("{}[{}]", key, index), value[index]}; }
  std::size_t length(std::string_view wanted) const {
    if (!value.is_array()) refuse(wanted);
    return value.size();
  }
  double number() const {
    if (!value.is_number()) refuse("a number");
    return value.get<double>();
  }
};

Eigen::Isometry3d readTransform(const Place& place) {
  constexpr const char* kWanted = "four lists of four numbers";
  std::array<double, 16> rows;
  if (place.length(kWanted) != 4) place.refuse(kWanted);
  for (std::size_t i = 0; i < 4; ++i) {
    const Place row = place.at(i);
    if (row.length("four numbers") != 4) row.refuse("four numbers");
    for (std::size_t j = 0; j < 4; ++j) rows[4 * i + j] = row.at(j).number();
  }
  return rigidTransform(rows, fmt::format("{}: {}", place.file, place.key));
}

/// true, false, or a number that is 0 where the grasp failed.
bool readVerdict(const Place& place) {
  return place.value.is_boolean() ? place.value.get<bool>() : place.number() != 0;
}

JsonInput parse(const std::string& path) {
  try {
    return JsonInput::parse(readFile(path));
  } catch (const JsonInput::exception& error) {  // also for a number that is too large
    std::string reason = error.what();
    std::replace(reason.begin(), reason.end(), '\n', ' ');
    throw InputError(fmt::format("{}: is no valid JSON: {}", path, reason));
  }
}

}  // namespace

GraspFile readGraspGen(const std::string& path) {
  const JsonInput json = parse(path);
  const Place top{path, "", json};
  GraspFile result;
  result.format = "graspgen";
  result.rootAxes = RootAxes::palm;
  if (json.is_object() && json.contains("object") && json["object"].contains("scale")) {
    const Place scale = top.at("object").at("scale");
    result.objectScale = scale.number();
    if (!(*result.objectScale > 0)) scale.refuse("a number > 0");
  }
  const Place grasps = top.at("grasps"), transforms = grasps.at("transforms");
  const std::size_t count = transforms.length("a list of 4x4 matrices");
  const bool isJudged = grasps.value.contains("object_in_gripper");
  if (isJudged && grasps.at("object_in_gripper").length("a list") != count)
    grasps.at("object_in_gripper").refuse(fmt::format("a list of {} as transforms is", count));
  for (std::size_t i = 0; i < count; ++i) {
    if (isJudged && !readVerdict(grasps.at("object_in_gripper").at(i))) {
      ++result.failed;
      continue;
    }
    FileGrasp& grasp = result.grasps.emplace_back();
    const Place transform = transforms.at(i);
    grasp.name = transform.key;
    grasp.X_OF = readTransform(transform);
  }
  return result;
}

}  // namespace handhold
