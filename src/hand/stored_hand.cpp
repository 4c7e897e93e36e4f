#include "hand/stored_hand.h"

#include "core/error.h"
#include "hand/urdf_model.h"

#include <map>

#include <fmt/format.h>
#include <urdf_parser/urdf_parser.h>

namespace handhold {
namespace {

using JointPositions = std::map<std::string, double>;

constexpr const char* kName = "the stored URDF";

JointPositions positionsByName(const urdf::ModelInterface& model, const std::vector<std::string>& jointNames,
                               const Eigen::VectorXd& jointPosition) {
  if (static_cast<Eigen::Index>(jointNames.size()) != jointPosition.size()) {
    throw InputError(fmt::format("{}: {} joint names with {} positions, want as many", kName, jointNames.size(),
                                 jointPosition.size()));
  }
  JointPositions result;
  for (std::size_t i = 0; i < jointNames.size(); ++i) {
    const auto joint = model.getJoint(jointNames[i]);
    if (joint == nullptr || joint->type == urdf::Joint::FIXED) {
      throw InputError(fmt::format("{}: has no moving joint {}", kName, jointNames[i]));
    }
    result[jointNames[i]] = jointPosition[i];
  }
  return result;
}

/// Pose of a joint's child link in its parent link.
Eigen::Isometry3d childPose(const urdf::Joint& joint, const JointPositions& positions) {
  Eigen::Isometry3d X_PL = toPose(joint.parent_to_joint_origin_transform);
  const auto position = positions.find(joint.name);
  if (position == positions.end()) return X_PL;
  const Eigen::Vector3d axis(joint.axis.x, joint.axis.y, joint.axis.z);
  if (!(axis.norm() > 0))
    throw InputError(fmt::format("{}: joint {}: axis is zero, want a direction", kName, joint.name));
  if (joint.type == urdf::Joint::PRISMATIC) {
    X_PL.translate(position->second * axis.normalized());
  } else {
    X_PL.rotate(Eigen::AngleAxisd(position->second, axis.normalized()));
  }
  return X_PL;
}

}  // namespace

std::vector<Eigen::Isometry3d> linkPosesFromUrdf(const std::string& urdfText, const std::vector<std::string>& linkNames,
                                                 const std::vector<std::string>& jointNames,
                                                 const Eigen::VectorXd& jointPosition) {
  const auto model = parseUrdf(kName, urdfText);
  const JointPositions positions = positionsByName(*model, jointNames, jointPosition);
  std::vector<Eigen::Isometry3d> X_HL;
  for (const std::string& name : linkNames) {
    auto link = model->getLink(name);
    if (link == nullptr) throw InputError(fmt::format("{}: has no link {}", kName, name));
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    for (; link->name != linkNames[0]; link = link->getParent()) {
      if (link->parent_joint == nullptr) {
        throw InputError(fmt::format("{}: link {} is not below {}, the root link", kName, name, linkNames[0]));
      }
      X = childPose(*link->parent_joint, positions) * X;
    }
    X_HL.push_back(X);
  }
  return X_HL;
}

}  // namespace handhold
