#pragma once

#include <Eigen/Geometry>

namespace handhold {

/// A grasp that was planned elsewhere: where the hand is, and its joints where they are known.
struct GivenGrasp {
  Eigen::Isometry3d X_OH = Eigen::Isometry3d::Identity();  // of the hand's root link H in the object O
  int preshape = 0;                                        // in which it arrives: index into Hand::preshapes
  Eigen::VectorXd jointPosition;                           // (J); empty: not known, the policy closes the hand
};

}  // namespace handhold
