#pragma once

#include "mesh/object.h"
#include "mesh/ray_scene.h"

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// Points on an object's surface in the object frame, rounded to 32-bit floats as the database stores them.
struct SurfaceSamples {
  std::vector<Eigen::Vector3f> point;     // m
  std::vector<Eigen::Vector3f> normal;    // unit, outward normal of the triangle hit
  std::vector<Eigen::Vector3f> approach;  // unit, P_d of a grasp that aims here
  std::vector<std::uint32_t> triangle;
  double pitch = 0;           // m, of the six grids
  std::size_t backfaces = 0;  // rays dropped because they met a closed surface from behind (a defect of the mesh)
  std::size_t size() const { return point.size(); }
};

/// Casts a ray from every cell of six grids, one for each side of the bounding box, inwards; the first hit is a sample
/// (Berenson et al. 2007, II-C). Order: sides -x, +x, -y, +y, -z, +z, then rows, then columns. Each ray is moved inside
/// its cell by up to 5 % of the pitch (of the object's extent where that is smaller), by a fixed hash of (side, row,
/// column), so that none is aimed at a vertex.
/// Hits on the two faces of a thin wall come from opposite sides and are both kept. On an open mesh a hit from behind
/// counts with the normal turned towards the ray.
/// The approach direction is the negative normal. @throws InputError  `NAME: ...` more than 20 million rays, or no hit
SurfaceSamples sampleSurface(const ObjectModel& object, const RayScene& scene, double pitch, const std::string& name);

/// The largest pitch of a bisection whose grids give at least `count` hits, then exactly `count` of them, evenly spread
/// over the order. @throws InputError  the surface cannot give so many
SurfaceSamples sampleSurfaceCount(const ObjectModel& object, const RayScene& scene, std::size_t count,
                                  const std::string& name);

/// Where rays towards the centre of mass meet the surface, from `count` directions spread evenly over the sphere
/// (Fibonacci lattice): the target points of the approach-the-centre policy (Pelossof et al. 2004, reference [1] of the
/// paper). Directions whose ray misses the object are replaced by a denser lattice. @throws InputError  all rays miss
SurfaceSamples sampleSphere(const ObjectModel& object, const RayScene& scene, std::size_t count,
                            const std::string& name);

/// The surface points of the distance map (III-A), and for each target point its k nearest of them.
struct DistanceMapPoints {
  SurfaceSamples samples;
  int neighborCount = 0;                // k
  std::vector<std::uint32_t> neighbor;  // (targets, k), row-major, nearest first
  std::vector<float> weight;            // (targets, k), inverse distance, rows sum to 1
};

/// Finds for each of `target` the k nearest points whose normal is within 60 degrees of `targetNormal` (so that the
/// far side of a thin wall does not speak for this one), filled up by nearest of any normal when there are fewer.
void findNeighbors(DistanceMapPoints& map, const std::vector<Eigen::Vector3f>& target,
                   const std::vector<Eigen::Vector3f>& targetNormal, int k);

}  // namespace handhold
