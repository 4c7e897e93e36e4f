#pragma once

// Private to src/robot: what both solvers share.

#include "robot/inverse_kinematics.h"

#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Damped least squares from `q` within the limits: true when the residual came below the tolerances. Equation (8)
/// of README.md.
/// @param X_AT  wanted pose of the tip in the arm's base
/// @param q     (n) start, within the limits; ends where the steps ended
bool convergeTip(const ArmChain& chain, const Eigen::Isometry3d& X_AT, const IkSettings& settings, int iterations,
                 Eigen::VectorXd& q);

/// Nearest to `near` first (largest joint change); equally near ones keep their order.
void sortNearestFirst(const Eigen::VectorXd& near, std::vector<Eigen::VectorXd>& solutions);

/// Two postures are one solution when no joint differs by more [rad or m].
inline constexpr double kDistinct = 1e-4;

}  // namespace handhold
