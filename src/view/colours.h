#pragma once

#include <Eigen/Core>

namespace handhold {

// Linear colours that all pictures share.
inline const Eigen::Vector3d kObjectColour(0.85, 0.36, 0.085);
inline const Eigen::Vector3d kPalmColour(0.10, 0.135, 0.19);
inline const Eigen::Vector3d kLinkColour(0.30, 0.33, 0.37);
inline const Eigen::Vector3d kTouchingColour(0.17, 0.31, 0.55);
inline const Eigen::Vector3d kContactColour(0.80, 0.012, 0.03);
inline const Eigen::Vector3d kApproachColour(0.02, 0.12, 0.80);
inline const Eigen::Vector3d kClosingColour(0.80, 0.012, 0.03);

}  // namespace handhold
