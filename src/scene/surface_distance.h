#pragma once

#include "mesh/triangle_mesh.h"

#include <cstdint>
#include <limits>
#include <memory>

namespace handhold {

/// Unsigned distance from points to the surface of a mesh, exact (Embree point queries in single precision, the
/// distance itself in double).
/// @note Immutable; safe from many threads.
class SurfaceDistance {
 public:
  explicit SurfaceDistance(const TriangleMesh& mesh);
  ~SurfaceDistance();

  /// m; `limit` where the surface is farther than that, or where there is none.
  double operator()(const Eigen::Vector3d& point, double limit = std::numeric_limits<double>::infinity()) const;
  /// m. `triangle` is a guess of the nearest one, and then the nearest one: near ones make the search short.
  double from(std::uint32_t& triangle, const Eigen::Vector3d& point) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace handhold
