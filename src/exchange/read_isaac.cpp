#include "core/yaml.h"
#include "exchange/read_formats.h"

#include <cmath>

namespace handhold {
namespace {

/// {w: W, xyz: [X, Y, Z]}, of unit length.
Eigen::Quaterniond readOrientation(const YamlValue& orientation) {
  const Eigen::Vector3d xyz = orientation.require("xyz").vector3();
  const Eigen::Quaterniond q(orientation.require("w").number(), xyz.x(), xyz.y(), xyz.z());
  if (std::abs(q.norm() - 1) > 1e-3)
    orientation.fail("is not of length 1, want a unit quaternion {w: W, xyz: [X, Y, Z]}");
  return q.normalized();
}

std::map<std::string, double> readJoints(const YamlValue& grasp, std::string_view key) {
  std::map<std::string, double> joints;
  const YamlValue* values = grasp.find(key);
  if (values == nullptr || values->kind() == YamlValue::Kind::null) return joints;
  for (const auto& [name, value] : values->entries()) joints[name] = value.number();
  return joints;
}

}  // namespace

// Keys that other programs add are passed over.
GraspFile readIsaac(const std::string& path) {
  const YamlValue top = YamlValue::parseFile(path);
  if (top.require("format").text() != "isaac_grasp") top.require("format").refuse("isaac_grasp");
  if (top.require("format_version").number() != 1) top.require("format_version").refuse("1.0");
  GraspFile result;
  result.format = "isaac_grasp";
  for (const char* key : {"gripper_frame", "gripper_frame_link"}) {
    if (const YamlValue* frame = top.find(key)) result.gripperFrame = frame->text();
  }
  for (const auto& [name, entry] : top.require("grasps").entries()) {
    if (const YamlValue* confidence = entry.find("confidence"); confidence != nullptr && confidence->number() <= 0) {
      ++result.failed;
      continue;
    }
    FileGrasp& grasp = result.grasps.emplace_back();
    grasp.name = entry.key();
    grasp.X_OF.linear() = readOrientation(entry.require("orientation")).toRotationMatrix();
    grasp.X_OF.translation() = entry.require("position").vector3();
    grasp.jointPosition = readJoints(entry, "cspace_position");
    grasp.pregraspPosition = readJoints(entry, "pregrasp_cspace_position");
  }
  return result;
}

}  // namespace handhold
