#pragma once

#include "mesh/triangle_mesh.h"

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Values on the nodes of a regular lattice in one frame.
template <class T>
struct Lattice {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();  // of node 0 [m]
  float step = 0;                                    // m
  std::array<int, 3> size = {0, 0, 0};               // nodes along x, y, z; x runs fastest
  std::vector<T> value;

  std::size_t index(int x, int y, int z) const { return (static_cast<std::size_t>(z) * size[1] + y) * size[0] + x; }
  Eigen::Vector3d node(int x, int y, int z) const {
    return origin.cast<double>() + static_cast<double>(step) * Eigen::Vector3d(x, y, z);
  }
};

/// Axis-aligned boxes: lower x, y, z, then upper x, y, z, as arrays, padded to a multiple of 16 with boxes that meet
/// nothing.
struct Boxes {
  std::array<std::vector<float>, 6> bound;

  std::size_t size() const { return bound[0].size(); }
};

/// Planes that tell what is near a surface: per node n of a lattice a direction g, in 1 / kDirectionUnit, and a height
/// h, in kUnit, rounded down. No part of the surface within `reach` of n rises above the plane g.(x - n) = -h; so what
/// lies within rho of n, rho < reach, at points q, is at least min(min_q g.(q - n) + h, reach - rho) away from it.
struct Planes {
  static constexpr float kDirectionUnit = 32767;
  static constexpr float kUnit = 1e-6F;  // m

  Lattice<std::array<std::int16_t, 4>> nodes;
  float reach = 0;  // m
};

/// The signed distance to a link's surface, negative inside, on a lattice in the link frame, and the link's triangles
/// in blocks of 16 neighbours and superblocks of 16 blocks. Within `kBand` of the surface the distances are exact at
/// the nodes; beyond they are lower bounds. Where the mesh is open its inside is not known: then distances are lowered
/// by `kOpenShrink` steps so that a sheet has one. Triangles that lie inside another piece of the link are left out:
/// nothing can touch them first.
/// @note Immutable; safe from many threads.
struct LinkGrid {
  static constexpr double kBand = 4e-3;        // m
  static constexpr double kMargin = 4e-3;      // m, of the lattice around the link
  static constexpr double kOpenShrink = 0.75;  // lattice steps
  static constexpr float kUnit = 1e-6F;        // m, of `nodePairs`

  /// @throws Cancelled  soon after `cancel` became true
  explicit LinkGrid(const TriangleMesh& mesh, const std::atomic<bool>* cancel = nullptr);

  /// A lower bound of the signed distance at `p`, in the link frame, unless `p` lies deeper than kBand inside.
  double lowerBound(const Eigen::Vector3d& p) const;
  /// An upper bound of it inside and within kBand of the surface; +inf outside the lattice.
  double upperBound(const Eigen::Vector3d& p) const;

  Lattice<float> distance;
  /// For the kernels, which so gather half as often: per node its distance in the low half and that of the next node
  /// along x in the high one, in units, rounded down; what sixteen bits cannot hold is cut off at their ends.
  std::vector<std::int32_t> nodePairs;
  Planes planes;           // on the same lattice
  Planes blockPlanes;      // for blocks of triangles: wider steps, a lattice that extends by its reach beyond the link
  bool closed = false;     // oriented outward and without boundary
  Eigen::Vector3d center;  // of the bounding sphere
  double radius = 0;       // m
  Boxes triangleBoxes, blockBoxes, superblockBoxes;
  /// Per triangle, block b at 16 b: corners (9), unit normal and offset (4), its box as in Boxes (6).
  struct alignas(16) Triangle {
    std::array<float, 20> value{};
  };
  std::vector<Triangle> triangle;
  std::vector<std::uint32_t> source;    // of each triangle: its index in the mesh
  std::vector<Eigen::Vector3d> normal;  // unit, of each triangle of the mesh

 private:
  void addTriangles(const TriangleMesh& mesh, const std::vector<std::uint32_t>& visible);
};

}  // namespace handhold
