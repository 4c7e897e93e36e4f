#include "rank/grasp_table.h"

#include "core/error.h"

#include <fmt/format.h>

namespace handhold {
namespace {

Eigen::Vector3d row3(const std::vector<float>& values, std::size_t row) {
  return Eigen::Vector3f(values[3 * row], values[3 * row + 1], values[3 * row + 2]).cast<double>();
}

Eigen::VectorXd rowOf(const std::vector<float>& values, std::size_t row, std::size_t width) {
  return Eigen::Map<const Eigen::VectorXf>(values.data() + row * width, static_cast<Eigen::Index>(width))
      .cast<double>();
}

/// By link of the set: does closing leave it where it is?
std::vector<bool> restingLinks(const GraspSet& set, const Hand& hand) {
  std::vector<bool> moves(hand.links.size(), false);
  for (const ClosingJoint& closing : hand.closing) {
    const std::vector<bool> moved = linksMovedBy(hand, closing.joint, true);
    for (std::size_t i = 0; i < moves.size(); ++i) moves[i] = moves[i] || moved[i];
  }
  std::vector<bool> resting(set.linkNames.size(), false);
  for (std::size_t i = 0; i < resting.size(); ++i) {
    for (std::size_t k = 0; k < moves.size(); ++k) {
      if (hand.links[k].name == set.linkNames[i]) resting[i] = !moves[k];
    }
  }
  return resting;
}

Eigen::Vector3d sidewaysOf(const GraspSet& set, std::size_t row, const Eigen::Vector3d& approach,
                           const std::vector<bool>& resting) {
  constexpr double kAcross = 0.1;  // of a unit normal; less is the palm, which lies along the approach
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::uint32_t c = set.contactBegin[row]; c < set.contactBegin[row + 1]; ++c) {
    if (!resting[set.contactLink[c]]) continue;
    const Eigen::Vector3d n = row3(set.contactNormal, c);  // into the object
    const Eigen::Vector3d across = n - approach.dot(n) * approach;
    if (across.norm() > kAcross) sum -= across;
  }
  return sum.norm() > kAcross ? Eigen::Vector3d(sum.normalized()) : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

void requireSameJoints(const GraspSet& set, const std::string& path, const Hand& hand) {
  std::vector<std::string> names;
  for (const Joint& joint : hand.joints) names.push_back(joint.name);
  if (names == set.jointNames) return;
  throw InputError(fmt::format("{}: was built with a hand whose joints are {}, want those of the robot's hand {}: {}",
                               path, fmt::join(set.jointNames, ", "), hand.name, fmt::join(names, ", ")));
}

/// Gq of every grasp (n).
std::vector<double> qualities(const GraspSet& set, const std::string& path, const HoldCalibration* calibration) {
  if (calibration != nullptr) return holdProbabilities(*calibration, set, path);
  std::vector<double> quality;
  for (const double epsilon : set.epsilon) quality.push_back(epsilon / set.epsilon.front());
  return quality;
}

}  // namespace

GraspTable makeGraspTable(GraspSet set, const std::string& path, const Hand& hand, const HoldCalibration* calibration) {
  requireSameJoints(set, path, hand);
  const std::vector<double> quality = qualities(set, path, calibration);
  GraspTable table;
  const std::size_t J = set.jointNames.size();
  const std::vector<bool> resting = restingLinks(set, hand);
  table.grasps.reserve(set.graspCount());
  for (std::size_t i = 0; i < set.graspCount(); ++i) {
    StoredGrasp& grasp = table.grasps.emplace_back();
    grasp.X_OH = set.X_OH(i);
    grasp.targetPoint = row3(set.targetPoint, i);
    grasp.approach = row3(set.approachDirection, i).normalized();
    grasp.sideways = sidewaysOf(set, i, grasp.approach, resting);
    grasp.approachClear = set.approachClear[i] != 0;
    grasp.epsilon = set.epsilon[i];
    grasp.quality = quality[i];
    grasp.trial = {set.trial[3 * i], set.trial[3 * i + 1], set.trial[3 * i + 2]};
    grasp.preshapePosition = rowOf(set.preshapeJointPosition, i, J);
    grasp.finalPosition = rowOf(set.jointPosition, i, J);
  }
  table.object = set.object;
  table.hand = set.hand;
  table.path = path;
  table.setVersion = set.setVersion;
  table.objectMesh = std::move(set.objectMesh);
  table.watertight = set.watertight;
  table.centerOfMass = set.centerOfMass;
  table.mapPoint = std::move(set.mapPoint);
  table.mapNormal = std::move(set.mapNormal);
  table.neighbors = set.neighbors;
  table.mapNeighbor = std::move(set.mapNeighbor);
  table.mapWeight = std::move(set.mapWeight);
  return table;
}

}  // namespace handhold
