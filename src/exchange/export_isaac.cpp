#include "exchange/export_set.h"
#include "exchange/yaml_text.h"

#include <algorithm>

#include <fmt/format.h>

namespace handhold {
namespace {

/// `{"finger_1": 0.01}`
std::string jointMap(const Hand& hand, const Eigen::VectorXd& jointPosition) {
  std::string text;
  for (const int joint : independentJoints(hand)) {
    text += fmt::format("{}{}: {}", text.empty() ? "" : ", ",
                        yamlText(hand.joints[static_cast<std::size_t>(joint)].name), yamlNumber(jointPosition[joint]));
  }
  return "{" + text + "}";
}

}  // namespace

std::string isaacText(const ExportedSet& exported, GraspFrame frame) {
  const FoundSet& found = exported.found;
  std::string text = fmt::format(
      "# {} x {} v{}, written by handhold. Poses: {} in the object frame [m], quaternions of unit length.\n"
      "# confidence: epsilon as a share of the set's best ({}).\n"
      "format: isaac_grasp\n"
      "format_version: 1.0\n"
      "object_frame: {}\n"
      "gripper_frame: {}\n"
      "grasps:{}\n",
      found.object, found.hand, found.setVersion, frameName(exported.hand, frame), exported.set.epsilon.front(),
      yamlText(found.object), yamlText(frameName(exported.hand, frame)), found.grasps.empty() ? " {}" : "");
  const std::vector<Eigen::Isometry3d> X_OF = framePoses(exported, frame, RootAxes::link);
  for (std::size_t i = 0; i < found.grasps.size(); ++i) {
    const FoundGrasp& grasp = found.grasps[i];
    const Eigen::Quaterniond q(X_OF[i].linear());
    text += fmt::format(
        "  grasp_{}:\n"
        "    confidence: {}\n"
        "    position: {}\n"
        "    orientation: {{w: {}, xyz: {}}}\n"
        "    cspace_position: {}\n"
        "    pregrasp_cspace_position: {}\n",
        grasp.grasp, yamlNumber(grasp.epsilon / exported.set.epsilon.front()), yamlList(X_OF[i].translation()),
        yamlNumber(q.w()), yamlList(q.vec()), jointMap(exported.hand, grasp.jointPosition),
        jointMap(exported.hand, grasp.preshapeJointPosition));
  }
  return text;
}

}  // namespace handhold
