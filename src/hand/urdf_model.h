#pragma once

// Private to src/hand: what the reader of hand files and the reader of stored hands share.

#include <memory>
#include <string>

#include <Eigen/Geometry>

namespace urdf {
class ModelInterface;
class Pose;
}  // namespace urdf

namespace handhold {

/// The model in a URDF text; `path` begins messages. Never null, and it has a root link.
/// @throws InputError  `PATH: is no valid URDF: REASON`
/// @note   Safe from many threads.
std::shared_ptr<urdf::ModelInterface> parseUrdf(const std::string& path, const std::string& text);

/// Position and unit quaternion as a rigid transform.
Eigen::Isometry3d toPose(const urdf::Pose& pose);

}  // namespace handhold
