#include "exchange/export_set.h"
#include "exchange/yaml_text.h"

#include <fmt/format.h>

namespace handhold {
namespace {

// How far the hand should, and must at least, come straight in and go straight out [m]: MoveIt asks, no set says.
constexpr double kDesiredDistance = 0.1, kMinDistance = 0.05;

std::string header(const std::string& frame) { return fmt::format("{{frame_id: {}}}", yamlText(frame)); }

std::string vectorMap(const Eigen::Vector3d& v) {
  return fmt::format("{{x: {}, y: {}, z: {}}}", yamlNumber(v.x()), yamlNumber(v.y()), yamlNumber(v.z()));
}

/// trajectory_msgs/JointTrajectory with one point.
std::string posture(const Hand& hand, const Eigen::VectorXd& jointPosition) {
  std::vector<std::string> names;
  std::vector<double> positions;
  for (const int joint : independentJoints(hand)) {
    names.push_back(hand.joints[static_cast<std::size_t>(joint)].name);
    positions.push_back(jointPosition[joint]);
  }
  const Eigen::Map<const Eigen::VectorXd> values(positions.data(), static_cast<Eigen::Index>(positions.size()));
  return fmt::format("{{joint_names: {}, points: [{{positions: {}}}]}}", yamlList(names), yamlList(values));
}

/// moveit_msgs/GripperTranslation.
std::string translation(const std::string& frame, const Eigen::Vector3d& direction) {
  return fmt::format("{{direction: {{header: {}, vector: {}}}, desired_distance: {}, min_distance: {}}}", header(frame),
                     vectorMap(direction), yamlNumber(kDesiredDistance), yamlNumber(kMinDistance));
}

}  // namespace

std::string moveitText(const ExportedSet& exported, GraspFrame frame) {
  const FoundSet& found = exported.found;
  const Hand& hand = exported.hand;
  const std::string object = yamlText(found.object);
  std::string text = fmt::format(
      "# {} x {} v{}, written by handhold. `grasps` are moveit_msgs/Grasp: grasp_pose is that of {} in the object "
      "frame [m].\n"
      "object: {}\n"
      "hand: {}\n"
      "frame: {}\n"
      "grasps:{}\n",
      found.object, found.hand, found.setVersion, frameName(hand, frame), object, yamlText(found.hand),
      yamlText(frameName(hand, frame)), found.grasps.empty() ? " []" : "");
  const std::vector<Eigen::Isometry3d> X_OF = framePoses(exported, frame, RootAxes::link);
  for (std::size_t i = 0; i < found.grasps.size(); ++i) {
    const FoundGrasp& grasp = found.grasps[i];
    const Eigen::Quaterniond q(X_OF[i].linear());
    const Eigen::Vector3d approach = grasp.X_OH.linear().transpose() * grasp.approachDirection.normalized();
    const std::string& root = hand.links[0].name;
    text += fmt::format(
        "  - id: {}\n"
        "    pre_grasp_posture: {}\n"
        "    grasp_posture: {}\n"
        "    grasp_pose: {{header: {}, pose: {{position: {}, orientation: {{x: {}, y: {}, z: {}, w: {}}}}}}}\n"
        "    grasp_quality: {}\n"
        "    pre_grasp_approach: {}\n"
        "    post_grasp_retreat: {}\n"
        "    post_place_retreat: {}\n"
        "    max_contact_force: 0.0\n"
        "    allowed_touch_objects: [{}]\n",
        yamlText(fmt::format("{}_{}_v{}_{}", found.object, found.hand, found.setVersion, grasp.grasp)),
        posture(hand, grasp.preshapeJointPosition), posture(hand, grasp.jointPosition), header(found.object),
        vectorMap(X_OF[i].translation()), yamlNumber(q.x()), yamlNumber(q.y()), yamlNumber(q.z()), yamlNumber(q.w()),
        yamlNumber(grasp.epsilon), translation(root, approach), translation(root, -approach),
        translation(root, -approach), object);
  }
  return text;
}

}  // namespace handhold
