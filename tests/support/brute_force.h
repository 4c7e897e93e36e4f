#pragma once

#include "mesh/triangle_mesh.h"
#include "simulate/contacts.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace handhold::testing {

/// Does the segment pq cross the triangle? Signed volumes; independent of the library under test.
inline bool segmentCrosses(const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Corners& t) {
  const auto volume = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                         const Eigen::Vector3d& d) { return (b - a).cross(c - a).dot(d - a); };
  if (volume(t[0], t[1], t[2], p) * volume(t[0], t[1], t[2], q) > 0) return false;
  const double a = volume(p, q, t[0], t[1]), b = volume(p, q, t[1], t[2]), c = volume(p, q, t[2], t[0]);
  return (a >= 0 && b >= 0 && c >= 0) || (a <= 0 && b <= 0 && c <= 0);
}

inline bool trianglesCross(const Corners& a, const Corners& b) {
  for (int i = 0; i < 3; ++i) {
    if (segmentCrosses(a[i], a[(i + 1) % 3], b) || segmentCrosses(b[i], b[(i + 1) % 3], a)) return true;
  }
  return false;
}

inline Corners moved(Corners corners, const Eigen::Isometry3d& X) {
  for (auto& corner : corners) corner = X * corner;
  return corners;
}

/// Every triangle against every other.
inline bool surfacesCross(const TriangleMesh& a, const TriangleMesh& b, const Eigen::Isometry3d& X_AB) {
  for (std::size_t j = 0; j < b.triangles.size(); ++j) {
    const Corners tb = moved(b.corners(j), X_AB);
    Eigen::AlignedBox3d box(tb[0]);
    box.extend(tb[1]).extend(tb[2]);
    for (std::size_t i = 0; i < a.triangles.size(); ++i) {
      const Corners ta = a.corners(i);
      Eigen::AlignedBox3d other(ta[0]);
      other.extend(ta[1]).extend(ta[2]);
      if (box.intersects(other) && trianglesCross(ta, tb)) return true;
    }
  }
  return false;
}

/// Distance of a point to a surface, over all triangles.
inline double distanceTo(const Eigen::Vector3d& p, const TriangleMesh& mesh) {
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    best = std::min(best, (closestPointOnTriangle(p, mesh.corners(i)) - p).norm());
  }
  return best;
}

/// Winding number of a closed surface about a point by solid angles (van Oosterom, Strackee 1983).
inline double windingNumber(const Eigen::Vector3d& p, const TriangleMesh& mesh) {
  double sum = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    auto [a, b, c] = mesh.corners(i);
    a -= p, b -= p, c -= p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    sum += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return sum / (4 * std::numbers::pi);
}

}  // namespace handhold::testing
