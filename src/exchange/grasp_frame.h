#pragma once

#include "hand/hand.h"

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Which frame of the hand a file's poses are of.
enum class GraspFrame {
  root,  // origin: that of the root link
  tcp,   // origin: the tool centre point of hand.yaml; axes: those of the palm frame
};

/// Whose axes a format wants at the root's origin.
enum class RootAxes {
  link,  // the root link's own, as its URDF has them
  palm,  // those of the palm frame: +z approach, +x closing
};

/// Pose of that frame F in the root link H, joints (J) at `jointPosition`: the preshape's, as the hand arrives.
Eigen::Isometry3d framePose(const Hand& hand, const Eigen::VectorXd& jointPosition, GraspFrame frame, RootAxes axes);

/// The name of the frame: the root link's, or `tcp`.
std::string frameName(const Hand& hand, GraspFrame frame);

}  // namespace handhold
