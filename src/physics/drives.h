#pragma once

#include "hand/hand.h"
#include "quality/contact.h"

#include <span>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A grasp as it is stored: where the hand is, how it arrives and how it holds.
struct GraspPosture {
  Eigen::Isometry3d X_OH = Eigen::Isometry3d::Identity();  // of the root link H in the object O
  Eigen::VectorXd preshape, joints;                        // (J)
  std::vector<Contact> contacts;                           // in O
};

/// A position servo: force = stiffness (target - q) - damping q', at most `effort` either way.
struct Drive {
  int joint = -1;
  bool holds = false;  // closing does not move it: kept where the preshape has it, at any load
  std::vector<std::pair<int, double>> followers;  // joints coupled to it and their multipliers
  int breaksFrom = -1;                            // joint that it follows until that is stopped; -1: none
  double stiffness = 0, damping = 0, armature = 0;
  double effort = 0;  // N m or N; 0: not known, no limit
};

/// The servos of a hand: one for each joint that closes, one for each that can break away from it (a finger whose
/// proximal link is stopped goes on), and one for every joint that closing does not move. What else mimics follows.
/// Stiffnesses keep  stiffness dt^2 / armature <= 0.3  at dt = 4 ms, so that light fingers do not ring.
std::vector<Drive> drivesOf(const Hand& hand);

/// Where a drive is to be when its finger has gone the share `s` of its way from the preshape to the grasp: a joint
/// that breaks away follows the one before it as coupled, then goes on alone; both at one speed. Straight for all
/// others.
double closingTarget(const Hand& hand, const Drive& drive, const GraspPosture& posture, double s);

/// Forces that press the contacts of a grasp without moving the object.
struct Squeeze {
  Eigen::VectorXd torque;  // (drives) N m or N
  double normalForce = 0;  // N, sum over the contacts; less than was asked for where an effort is reached
  double residual = 0;     // of the wrench on the object, for each newton of the sum; torque / 0.05 m
};

/// Contact forces x >= 0 along the edges of friction cones (friction 0.3, 8 edges) that balance each other,
///
///     min  |W x|^2 + 0.09 (sum x - 1)^2 + 0.001 |x|^2,    tau = J^T f(x)                                       (2)
///
/// scaled to a sum of normal forces of `normalForce` [N], less where a drive's effort would be passed.
/// Without contacts there is none.
Squeeze balancedSqueeze(const Hand& hand, const std::vector<Drive>& drives, const GraspPosture& posture,
                        const Eigen::Vector3d& centerOfMass, double normalForce);

}  // namespace handhold
