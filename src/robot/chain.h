#pragma once

#include "hand/mechanism.h"

#include <vector>

#include <Eigen/Geometry>

namespace handhold {

struct Robot;

/// The joints of an arm, with everything that does not move between them folded into constant poses:
///
///     X_AT(q) = X_1 M_1(q_1) X_2 M_2(q_2) ... X_n M_n(q_n) X_tip,   M(q) = Rot(axis, q) or Trans(q axis)        (1)
///
/// A is the base link of the arm, T its tip link. Immutable; safe from many threads.
struct ArmChain {
  struct Step {
    JointType type = JointType::revolute;
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();  // from the step before to the joint's frame
    Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();      // unit, in the joint's frame
    double lower = 0, upper = 0;                          // rad or m; infinite for continuous joints
  };
  std::vector<Step> steps;
  Eigen::Isometry3d X_tip = Eigen::Isometry3d::Identity();

  Eigen::Index size() const { return static_cast<Eigen::Index>(steps.size()); }
};

/// The chain of one arm; joints outside the arm but between base and tip (none, usually) stand at their home.
ArmChain makeChain(const Robot& robot, int arm);

/// X_AT of (1). @param q  (n) rad or m, limits are not looked at
Eigen::Isometry3d tipPose(const ArmChain& chain, const Eigen::VectorXd& q);

/// The same with the geometric Jacobian (6, n) of the tip's origin in A: rows 0-2 linear [m/rad or 1], rows 3-5
/// angular.
Eigen::Isometry3d tipPose(const ArmChain& chain, const Eigen::VectorXd& q, Eigen::Matrix<double, 6, Eigen::Dynamic>& J);

/// Where the arm begins, its shoulder: the point nearest to the axes of the first two of its last six joints at q = 0,
/// in A. What is in front of six joints (a chest, a rail, a redundant joint) carries the shoulder.
Eigen::Vector3d shoulderPoint(const ArmChain& chain);

}  // namespace handhold
