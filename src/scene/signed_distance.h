#pragma once

#include "scene/scene.h"

#include <memory>

#include <Eigen/Geometry>

namespace handhold {

/// Signed distance from points to one obstacle shape: outside positive. Exact for boxes, cylinders, spheres and clouds
/// (unsigned inside a cloud's union of balls beyond the nearest ball); meshes by a grid of exact distances, built once
/// a shape (0.1 s), interpolated, negative inside where they are watertight: off by at most `error()` on the grid.
/// Outside it (a few millimetres around the mesh) never more than `error()` too large, and never below 0.7 of the
/// distance less `error()`. For scores; collisions are for exact tests.
/// @note Immutable; safe from many threads.
/// Source: README.md, equations (2) and (3).
class SignedDistance {
 public:
  explicit SignedDistance(std::shared_ptr<const ObstacleShape> shape);
  ~SignedDistance();
  SignedDistance(SignedDistance&&) noexcept;
  SignedDistance& operator=(SignedDistance&&) noexcept;

  /// m. @param p_S  in the shape's frame
  double operator()(const Eigen::Vector3d& p_S) const;
  /// m, bound of the error near the surface, and of what is too large anywhere; 0 where distances are exact.
  double error() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace handhold
