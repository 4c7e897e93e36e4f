#pragma once

#include <cmath>

#include <Eigen/Core>

// No other library includes it.
namespace handhold {

struct TangentBasis {
  Eigen::Vector3d t;
  Eigen::Vector3d b;
};

/// Two tangents from the unit normal alone, t x b = n. Continuous but on the plane n_z = 0, where the sign flips; the
/// denominator is never below 1.
inline TangentBasis tangentBasis(const Eigen::Vector3d& n) {
  const double sign = std::copysign(1.0, n.z());
  const double a = -1 / (sign + n.z());
  const double b = n.x() * n.y() * a;
  return {{1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()}, {b, sign + n.y() * n.y() * a, -n.y()}};
}

}  // namespace handhold
