#pragma once

#include "plan/motion.h"

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace handhold {

struct TrajectoryPoint {
  double time = 0;                     // s, from the start of the trajectory
  Eigen::VectorXd position, velocity;  // (n) rad and rad/s, or m and m/s
};

/// A part of a trajectory with a name: points begin .. end, both included; the next part begins with the last point.
struct TrajectorySegment {
  std::string name;
  std::size_t begin = 0, end = 0;
};

/// Joint positions over time; cubic between two points, by their positions and velocities.
struct Trajectory {
  std::vector<TrajectoryPoint> points;
  std::vector<TrajectorySegment> segments;
};

struct JointLimits {
  Eigen::VectorXd velocity, acceleration;  // (n) rad/s, rad/s^2 (or m)
};

/// Appends a path as one segment, at rest at its ends. Along each part between two stops the speed rises, stays and
/// falls (a trapezoid over the time that the slowest joint needs); then the part is slowed down until every cubic keeps
/// within the limits.
/// @param path     begins where the trajectory ends
/// @param corners  true: straight lines, with a stop at every point; false: points of one smooth curve
void appendSegment(const std::string& name, const JointPath& path, bool corners, const JointLimits& limits,
                   Trajectory& trajectory);

/// Position at time t [s] within the cubic from point i to i + 1.
Eigen::VectorXd positionAt(const Trajectory& trajectory, std::size_t i, double t);

/// Largest velocity and acceleration of the cubic from `a` to `b`, by joint.
void cubicPeaks(const TrajectoryPoint& a, const TrajectoryPoint& b, Eigen::VectorXd& velocity,
                Eigen::VectorXd& acceleration);

}  // namespace handhold
