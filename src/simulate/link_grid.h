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

/// The signed distance to a link's surface, negative inside, on a lattice in the link frame, and the link's triangles
/// in bins. Within `kBand` of the surface the distances are exact at the nodes; beyond they are lower bounds. Where the
/// mesh is open its inside is not known: then distances are lowered by `kOpenShrink` steps so that a sheet has one.
/// Triangles that lie inside another piece of the link are left out: nothing can touch them first.
/// @note Immutable; safe from many threads.
struct LinkGrid {
  static constexpr double kBand = 4e-3;        // m
  static constexpr double kMargin = 4e-3;      // m, of the lattice around the link
  static constexpr double kBinStep = 2.5e-3;   // m
  static constexpr double kReach = 3.5e-3;     // m, a bin lists the triangles that come this close to it
  static constexpr double kOpenShrink = 0.75;  // lattice steps

  /// @throws Cancelled  soon after `cancel` became true
  explicit LinkGrid(const TriangleMesh& mesh, const std::atomic<bool>* cancel = nullptr);

  /// A lower bound of the signed distance at `p`, in the link frame, unless `p` lies deeper than kBand inside.
  double lowerBound(const Eigen::Vector3d& p) const;
  /// An upper bound of it inside and within kBand of the surface; +inf outside the lattice.
  double upperBound(const Eigen::Vector3d& p) const;

  Lattice<float> distance;
  std::vector<float> error;         // per cell, at its lowest node: how far above the truth interpolation may lie [m]
  bool closed = false;              // oriented outward and without boundary
  Eigen::Vector3d center;           // of the bounding sphere
  double radius = 0;                // m
  Lattice<std::uint32_t> binBegin;  // first entry of each bin in binTriangles; nodes are the bins' centres
  std::vector<std::uint32_t> binTriangles;
  std::array<std::vector<float>, 6> binBox;  // of each entry of binTriangles: lower (3), upper (3)
  /// Per triangle: corners (9), unit normal and offset (4), in 13 arrays.
  std::array<std::vector<float>, 13> triangle;
  std::vector<Eigen::Vector3d> normal;  // unit
};

}  // namespace handhold
