#pragma once

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Pose of every link in the root link H, for a hand that is known by its database record alone (forwardKinematics does
/// the same for a loaded Hand).
///
///     X_HL = X_HP X_PJ M(q),   M(q) = Rot(axis, q) or Trans(q axis), P the parent link of L
///
/// @param urdfText       /hand/urdf of the set
/// @param linkNames      /hand/link_names: the root link H first, then links below it in any order
/// @param jointNames     /hand/joint_names (J); a moving joint that is not named stands at zero
/// @param jointPosition  (J) [rad or m], taken as they are: a mimic joint has a position of its own
/// @return               one pose a link name
/// @throws InputError    no valid URDF, a link that it lacks or that is not below the root, a joint that is no moving
/// one
/// @note   Safe from many threads.
std::vector<Eigen::Isometry3d> linkPosesFromUrdf(const std::string& urdfText, const std::vector<std::string>& linkNames,
                                                 const std::vector<std::string>& jointNames,
                                                 const Eigen::VectorXd& jointPosition);

}  // namespace handhold
