#include "exchange/export_set.h"
#include "mesh/mass_properties.h"
#include "store/hdf5_file.h"

#include <cstdint>

namespace handhold {
namespace {

void addScalar(Hdf5Builder& file, const std::string& path, double value) {
  file.addArray(path, {}, std::vector<double>{value});
}

void addObject(Hdf5Builder& file, const GraspSet& set, const std::string& meshName) {
  file.addGroup("/object");
  file.addText("/object/file", meshName);
  addScalar(file, "/object/scale", 1);
  file.addArray("/object/com", {3}, std::vector<double>(set.centerOfMass.begin(), set.centerOfMass.end()));
  if (set.watertight) addScalar(file, "/object/volume", massProperties(set.objectMesh, true).volume);
  addScalar(file, "/object/friction", set.friction);
}

void addGripper(Hdf5Builder& file, const ExportedSet& exported) {
  file.addGroup("/gripper");
  file.addText("/gripper/type", exported.found.hand);
  std::vector<double> open;
  for (const int joint : independentJoints(exported.hand)) {
    open.push_back(exported.found.grasps.front().preshapeJointPosition[joint]);
  }
  file.addArray("/gripper/configuration", {open.size()}, open);
}

/// What ACRONYM has no place for. Its readers pass over groups that they do not know.
void addExtras(Hdf5Builder& file, const FoundSet& found) {
  const std::string group = "/grasps/qualities/handhold";
  file.addGroup(group);
  const auto addColumn = [&](const std::string& name, double FoundGrasp::*member) {
    std::vector<double> values;
    for (const FoundGrasp& grasp : found.grasps) values.push_back(grasp.*member);
    file.addArray(group + "/" + name, {values.size()}, values);
  };
  addColumn("epsilon", &FoundGrasp::epsilon);
  addColumn("epsilon_lower", &FoundGrasp::epsilonLower);
  addColumn("epsilon_upper", &FoundGrasp::epsilonUpper);
  addColumn("critical_friction", &FoundGrasp::criticalFriction);
  addColumn("load_margin", &FoundGrasp::loadMargin);
  addColumn("robustness", &FoundGrasp::robustness);
  std::vector<std::uint32_t> rows;
  std::vector<double> closed, open;
  for (const FoundGrasp& grasp : found.grasps) {
    rows.push_back(static_cast<std::uint32_t>(grasp.grasp));
    closed.insert(closed.end(), grasp.jointPosition.begin(), grasp.jointPosition.end());
    open.insert(open.end(), grasp.preshapeJointPosition.begin(), grasp.preshapeJointPosition.end());
  }
  const Shape joints = {found.grasps.size(), found.jointNames.size()};
  file.addArray(group + "/grasp", {rows.size()}, rows);
  file.addTexts(group + "/joint_names", found.jointNames);
  file.addArray(group + "/joint_position", joints, closed);
  file.addArray(group + "/preshape_joint_position", joints, open);
}

}  // namespace

std::string acronymFile(const ExportedSet& exported, GraspFrame frame, const std::string& meshName) {
  const std::size_t n = exported.found.grasps.size();
  std::vector<double> transforms;
  for (const Eigen::Isometry3d& X_OF : framePoses(exported, frame, RootAxes::palm)) {
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> rows = X_OF.matrix();
    transforms.insert(transforms.end(), rows.data(), rows.data() + rows.size());
  }
  Hdf5Builder file(0);
  file.addGroup("/grasps");
  file.addArray("/grasps/transforms", {n, 4, 4}, transforms);
  file.addGroup("/grasps/qualities");
  file.addGroup("/grasps/qualities/flex");
  // Every stored grasp is force closed; no simulation has judged it.
  file.addArray("/grasps/qualities/flex/object_in_gripper", {n}, std::vector<std::int64_t>(n, 1));
  addExtras(file, exported.found);
  addGripper(file, exported);
  addObject(file, exported.set, meshName);
  return file.image();
}

}  // namespace handhold
