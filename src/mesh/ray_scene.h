#pragma once

#include "mesh/triangle_mesh.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// Where a ray first meets the surface; `distance` is +inf when it misses.
struct RayHit {
  double distance = std::numeric_limits<double>::infinity();  // m along the unit direction
  std::uint32_t triangle = 0;
  bool missed() const { return !(distance < std::numeric_limits<double>::infinity()); }
};

/// A place where a ray passes through the surface: sign +1 going out (along the normal), -1 going in.
struct RayCrossing {
  RayHit hit;
  int sign = 0;
};

/// The surface of one mesh, ready for rays (Embree, robust mode, instruction set pinned to AVX2 where the machine has
/// it so that results are equal everywhere).
/// @note Const calls are safe from many threads. Never aim exactly at a mesh vertex: such rays can slip through.
class RayScene {
 public:
  explicit RayScene(const TriangleMesh& mesh);
  ~RayScene();
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;

  /// First hit of the ray from `origin` along the unit vector `direction`, both in the mesh frame [m].
  RayHit cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

  /// All crossings of the ray, nearest first. A ray through an edge or vertex meets several triangles of one side
  /// there: that is one crossing, with the lowest of the triangles at the first distance.
  void crossings(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                 std::vector<RayCrossing>& result) const;

  /// True when `point` is enclosed by the surface: the signed crossings of a ray add up to a winding number, inside is
  /// where it is positive, and the majority of three fixed directions decides (they agree on a watertight mesh; on an
  /// open one the majority is the best that a ray can tell).
  bool contains(const Eigen::Vector3d& point) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace handhold
