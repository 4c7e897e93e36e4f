#pragma once

#include "mesh/triangle_mesh.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// What a DistanceField says of a point near its surface.
struct FieldValue {
  bool isBelow = false;
  double distance = 0;        // m
  Eigen::Vector3d direction;  // unit
};

/// Signed distance to a solid, outside positive, at the nodes of a grid around it, interpolated between them.
///
///     d(p) = min over the closed pieces of the mesh,   a piece's d < 0 where rays say that p is inside it      (1)
///
/// Exact at the nodes within kFieldBand of the surface; farther away at most the distance, so that a ball of that
/// radius is free. A mesh with inner walls or holes is one piece, and inside is what most of three rays call so.
/// @note Immutable; safe from many threads.
/// Source: README.md, "Shapes".
class DistanceField {
 public:
  /// @param spacing  m, of the grid; raised where the grid would have more nodes than kMostFieldNodes
  DistanceField(const TriangleMesh& mesh, double spacing);

  double spacing() const { return spacing_; }

  /// m. @param p  in the mesh frame
  double operator()(const Eigen::Vector3d& p) const {
    const Cell cell = cellAt(p);
    return cell.outside == 0 ? cell.value() : std::sqrt(cell.outside + std::pow(std::max(0.0, cell.value()), 2));
  }

  /// The distance at a point, where it is below `limit`, and the unit vector along which it grows; `isBelow` is false
  /// where it is not, and where the field has no direction (in the middle of a wall).
  FieldValue below(const Eigen::Vector3d& p, double limit) const {
    const Cell cell = cellAt(p);
    FieldValue result;
    result.distance = cell.value();
    if (result.distance >= limit || cell.outside > 0) return result;
    result.direction = cell.gradient() * inverseSpacing_;
    const double length = result.direction.norm();
    if (length < 0.1) return result;
    result.direction /= length;
    result.isBelow = true;
    return result;
  }

 private:
  /// The eight corners around a point and where it is among them.
  struct Cell {
    double c[8];  // x fastest
    double u, v, w;
    double outside;  // squared distance to the grid

    double value() const {
      const double c00 = c[0] + u * (c[1] - c[0]), c10 = c[2] + u * (c[3] - c[2]);
      const double c01 = c[4] + u * (c[5] - c[4]), c11 = c[6] + u * (c[7] - c[6]);
      const double c0 = c00 + v * (c10 - c00), c1 = c01 + v * (c11 - c01);
      return c0 + w * (c1 - c0);
    }
    Eigen::Vector3d gradient() const {
      const double x0 = c[1] - c[0], x1 = c[3] - c[2], x2 = c[5] - c[4], x3 = c[7] - c[6];
      const double dx = (1 - w) * ((1 - v) * x0 + v * x1) + w * ((1 - v) * x2 + v * x3);
      const double c00 = c[0] + u * x0, c10 = c[2] + u * x1, c01 = c[4] + u * x2, c11 = c[6] + u * x3;
      const double dy = (1 - w) * (c10 - c00) + w * (c11 - c01);
      const double dz = (1 - v) * (c01 - c00) + v * (c11 - c10);
      return {dx, dy, dz};
    }
  };

  Cell cellAt(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d inside = p.cwiseMax(low_).cwiseMin(high_);
    const Eigen::Vector3d at = (inside - low_) * inverseSpacing_;
    const int x = std::min(static_cast<int>(at.x()), count_.x() - 2);
    const int y = std::min(static_cast<int>(at.y()), count_.y() - 2);
    const int z = std::min(static_cast<int>(at.z()), count_.z() - 2);
    const std::ptrdiff_t row = count_.x(), layer = row * count_.y();
    const float* n = values_.data() + z * layer + y * row + x;
    Cell cell;
    cell.c[0] = n[0], cell.c[1] = n[1], cell.c[2] = n[row], cell.c[3] = n[row + 1];
    n += layer;
    cell.c[4] = n[0], cell.c[5] = n[1], cell.c[6] = n[row], cell.c[7] = n[row + 1];
    cell.u = at.x() - x, cell.v = at.y() - y, cell.w = at.z() - z;
    cell.outside = (p - inside).squaredNorm();
    return cell;
  }

  void addPiece(const TriangleMesh& piece);

  Eigen::Vector3d low_, high_;
  double spacing_, inverseSpacing_;
  Eigen::Vector3i count_;
  std::vector<float> values_;  // x fastest
};

/// Distances are exact within this much of the surface [m].
inline constexpr double kFieldBand = 4e-3;
inline constexpr double kMostFieldNodes = 16e6;

}  // namespace handhold
