#pragma once

#include "mesh/object.h"

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// Spheres in blocks of 16 neighbours and superblocks of 16 blocks, x, y, z, radius as arrays.
struct SphereTree {
  static constexpr int kWidth = 16;
  struct Spheres {
    std::vector<float> x, y, z, radius;
    std::size_t size() const { return x.size(); }
    void add(const Eigen::Vector3d& center, double r);
  };
  Spheres blocks, superblocks;  // both padded to a multiple of 16 with spheres that nothing can touch
};

/// Numbers that are used together, in one line of the cache.
struct alignas(64) Record {
  std::array<float, 16> value{};
};

/// An order of the indices, never empty, in which runs of 16 (and of 256) lie close together; the last is repeated up
/// to a multiple of 16.
std::vector<std::uint32_t> orderByPlace(const std::vector<Eigen::Vector3d>& place);

/// Spheres of a few millimetres that cover a surface (blocks of the tree).
SphereTree coverSurface(const TriangleMesh& mesh);

/// The object's surface as points and as small triangles, ordered so that neighbours stand together. Coordinates are
/// relative to `center`, so that single precision holds to a few nanometres.
/// @note Immutable; safe from many threads.
struct ObjectShell {
  static constexpr double kLongestEdge = 4.5e-3;          // m; longer triangles are split
  static constexpr double kSharpEdgeStep = 1.2e-3;        // m, between points along edges that stick out
  static constexpr std::size_t kMostTriangles = 400'000;  // with more the longest edge grows

  static constexpr double kBlockRadius = 7e-3;  // m, of the points' blocks at most

  explicit ObjectShell(const ObjectModel& object);

  Eigen::Vector3d center;
  bool closed = false;
  double longestEdge = kLongestEdge;
  double radius = 0;  // m, around `center`

  SphereTree pointTree;
  /// The corners of the small triangles and points along edges that stick out; block b at 16 b, filled up with its
  /// last.
  std::array<std::vector<float>, 3> point;

  SphereTree triangleTree;
  std::array<std::vector<float>, 6> triangleBox;  // around its blocks: centers, half sizes
  std::array<std::vector<float>, 4> sphere;       // around each small triangle: x, y, z, radius; block b at 16 b
  std::vector<Record> triangle;       // the small triangles: corners (9), unit normal outward (3), sphere (4)
  std::vector<std::uint32_t> source;  // the triangle of the object's mesh that a small one is part of

  std::vector<Record> sourceTriangle;         // of the object's mesh: corners (9)
  std::vector<Eigen::Vector3d> sourceNormal;  // unit
};

}  // namespace handhold
