#pragma once

#include "scene/scene.h"

#include <memory>
#include <span>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// The obstacles of a scene, ready for rays: one static BVH a shape, kept as long as a scene holds the shape, and the
/// poses above them, so that a moved obstacle costs nothing (Embree, two levels).
/// @note Not thread safe while it is updated; const calls are safe from many threads.
class SceneRays {
 public:
  SceneRays();
  ~SceneRays();

  /// Takes over the obstacles and their poses. Shapes seen in the update before are not built again.
  void update(const std::vector<Obstacle>& obstacles);

  /// Distance [m] from `origin` along the unit vector `direction` (both in W) to the first obstacle, +inf for none.
  double cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

 private:
  friend class DistanceMap;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct DistanceMapSettings {
  double coneAngle = 0.26179938779914943;  // rad, theta: half the cone's opening, 15 degrees
  int rays = 32;                           // in a cone, the axis among them
  double far = 0.5;                        // m, what a cone counts that meets nothing nearer
};

/// Clearance of every stored surface point of the target (Berenson et al. 2007, equation 2, with its sign mended):
///
///     D(p) = min { far, min over r : r . n(p) >= cos(theta) of Dist(p, r) }                                      (1)
///
/// over a fixed set of rays about the normal: the axis, a spiral on the cap, a third of them on its rim. A point inside
/// an obstacle, or on its surface to 10 um, counts 0; nothing is inside a mesh that is not watertight. Equal bits from
/// any number of threads and in any order of the points, which go fastest when neighbours follow each other.
///
/// @param points   (S,3) row-major [m], in O     @param normals  (S,3) row-major, unit, outward, in O
/// @param X_WO     pose of the target
/// @param D        (S) [m]
/// @note  Const; safe from many threads. Allocates nothing when D has its size (watertight meshes: after a thread's
/// first
///        calls).
/// Source: README.md, equation (1).
class DistanceMap {
 public:
  explicit DistanceMap(const DistanceMapSettings& settings = {});
  void compute(const SceneRays& scene, std::span<const float> points, std::span<const float> normals,
               const Eigen::Isometry3d& X_WO, std::vector<float>& D) const;
  const std::vector<Eigen::Vector3d>& rays() const { return rays_; }  // unit, about +z

 private:
  DistanceMapSettings settings_;
  std::vector<Eigen::Vector3d> rays_;
  std::vector<Eigen::Vector3f> coneRays_;  // the same for Embree
};

}  // namespace handhold
