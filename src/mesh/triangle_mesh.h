#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Triangles in one frame [m]. Coordinates are representable as 32-bit floats, so that what a database stores is
/// exactly what was computed with. Triangles run counter-clockwise seen from outside.
struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  std::array<Eigen::Vector3d, 3> corners(std::size_t triangle) const {
    const auto& t = triangles[triangle];
    return {vertices[t[0]], vertices[t[1]], vertices[t[2]]};
  }
  /// Unit normal by the right-hand rule; the triangle must have an area.
  Eigen::Vector3d normal(std::size_t triangle) const {
    const auto [a, b, c] = corners(triangle);
    return (b - a).cross(c - a).normalized();
  }
};

/// Rounds every coordinate to the nearest 32-bit float.
void roundToFloat(TriangleMesh& mesh);

/// The box around all vertices.
Eigen::AlignedBox3d boundingBox(const TriangleMesh& mesh);

/// Adds the triangles of `part`, moved by `X`, to `mesh`.
void append(TriangleMesh& mesh, const TriangleMesh& part, const Eigen::Isometry3d& X);

/// For every vertex the lowest one of the piece that it belongs to; pieces are connected by shared vertices.
std::vector<std::uint32_t> connectedPieces(const TriangleMesh& mesh);

/// The connected pieces themselves, in the order of their first vertices, which stay in order; vertices of no triangle
/// are left out.
std::vector<TriangleMesh> splitPieces(const TriangleMesh& mesh);

/// A vertex of each connected piece: any of them can be inside something while the others are not.
std::vector<Eigen::Vector3d> pieceVertices(const TriangleMesh& mesh);

/// True when the oriented boundary is empty: every directed edge is used as often as its opposite. Then winding numbers
/// are whole and volume integrals are defined, even where more than two faces share an edge.
bool isWatertight(const TriangleMesh& mesh);

}  // namespace handhold
