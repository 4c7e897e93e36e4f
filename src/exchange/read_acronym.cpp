#include "exchange/read_formats.h"
#include "store/hdf5_file.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace handhold {
namespace {

constexpr const char* kTransforms = "/grasps/transforms";
constexpr const char* kVerdicts = "/grasps/qualities/flex/object_in_gripper";

/// True for each grasp that held; all where the file does not say.
std::vector<bool> readVerdicts(const Hdf5View& file, std::size_t count) {
  std::vector<bool> held(count, true);
  for (const char* path : {"/grasps", "/grasps/qualities", "/grasps/qualities/flex", kVerdicts}) {
    if (!file.has(path)) return held;
  }
  Shape shape;
  const std::vector<double> values = file.numbers(kVerdicts, shape);
  if (shape != Shape{count})
    file.refuse(
        fmt::format("{} has shape {}, want ({}) as {} has grasps", kVerdicts, shapeText(shape), count, kTransforms));
  std::transform(values.begin(), values.end(), held.begin(), [](double value) { return value != 0; });
  return held;
}

std::optional<double> readScale(const Hdf5View& file) {
  if (!file.has("/object") || !file.has("/object/scale")) return std::nullopt;
  Shape shape;
  const std::vector<double> values = file.numbers("/object/scale", shape);
  if (values.size() != 1 || !std::isfinite(values[0]) || values[0] <= 0) {
    file.refuse(fmt::format("/object/scale is {}, want one number > 0",
                            values.size() == 1 ? fmt::format("{}", values[0]) : "of shape " + shapeText(shape)));
  }
  return values[0];
}

}  // namespace

GraspFile readAcronym(const std::string& path) {
  const Hdf5View file(path);
  Shape shape;
  const std::vector<double> values = file.numbers(kTransforms, shape);
  if (shape.size() != 3 || shape[1] != 4 || shape[2] != 4)
    file.refuse(fmt::format("{} has shape {}, want (n, 4, 4)", kTransforms, shapeText(shape)));
  GraspFile result;
  result.format = "acronym";
  result.rootAxes = RootAxes::palm;
  result.objectScale = readScale(file);
  const std::vector<bool> held = readVerdicts(file, shape[0]);
  for (std::size_t i = 0; i < held.size(); ++i) {
    if (!held[i]) {
      ++result.failed;
      continue;
    }
    FileGrasp& grasp = result.grasps.emplace_back();
    grasp.name = fmt::format("{}[{}]", kTransforms, i);
    std::array<double, 16> rows;
    std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(16 * i), 16, rows.begin());
    grasp.X_OF = rigidTransform(rows, fmt::format("{}: {}", path, grasp.name));
  }
  return result;
}

}  // namespace handhold
