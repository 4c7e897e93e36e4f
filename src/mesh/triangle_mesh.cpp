#include "mesh/triangle_mesh.h"

#include "core/float_rounding.h"
#include "mesh/edges.h"

#include <algorithm>
#include <map>
#include <numeric>

namespace handhold {

void roundToFloat(TriangleMesh& mesh) {
  for (auto& vertex : mesh.vertices) {
    for (double& x : vertex) x = roundedToFloat(x);
  }
}

Eigen::AlignedBox3d boundingBox(const TriangleMesh& mesh) {
  Eigen::AlignedBox3d box;
  for (const auto& vertex : mesh.vertices) box.extend(vertex);
  return box;
}

void append(TriangleMesh& mesh, const TriangleMesh& part, const Eigen::Isometry3d& X) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.reserve(mesh.vertices.size() + part.vertices.size());
  mesh.triangles.reserve(mesh.triangles.size() + part.triangles.size());
  for (const auto& vertex : part.vertices) mesh.vertices.push_back(X * vertex);
  for (const auto& t : part.triangles) mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

std::vector<std::uint32_t> connectedPieces(const TriangleMesh& mesh) {
  std::vector<std::uint32_t> parent(mesh.vertices.size());
  std::iota(parent.begin(), parent.end(), 0U);
  const auto rootOf = [&](std::uint32_t vertex) {
    while (parent[vertex] != vertex) vertex = parent[vertex] = parent[parent[vertex]];
    return vertex;
  };
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t other : {t[1], t[2]}) {
      const auto [low, high] = std::minmax({rootOf(t[0]), rootOf(other)});
      parent[high] = low;
    }
  }
  for (std::uint32_t& vertex : parent) vertex = rootOf(vertex);
  return parent;
}

std::vector<TriangleMesh> splitPieces(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> pieceOf = connectedPieces(mesh);
  std::map<std::uint32_t, TriangleMesh> pieces;
  std::vector<std::uint32_t> place(mesh.vertices.size());
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    TriangleMesh& piece = pieces[pieceOf[i]];
    place[i] = static_cast<std::uint32_t>(piece.vertices.size());
    piece.vertices.push_back(mesh.vertices[i]);
  }
  for (const auto& t : mesh.triangles)
    pieces[pieceOf[t[0]]].triangles.push_back({place[t[0]], place[t[1]], place[t[2]]});
  std::vector<TriangleMesh> result;
  for (auto& [_, piece] : pieces) {
    if (!piece.triangles.empty()) result.push_back(std::move(piece));
  }
  return result;
}

std::vector<Eigen::Vector3d> pieceVertices(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> piece = connectedPieces(mesh);
  std::vector<Eigen::Vector3d> vertices;
  for (std::uint32_t i = 0; i < piece.size(); ++i) {
    if (piece[i] == i) vertices.push_back(mesh.vertices[i]);
  }
  return vertices;
}

bool isWatertight(const TriangleMesh& mesh) {
  return !mesh.triangles.empty() && countEdges(edgeUses(mesh)).unbalanced == 0;
}

}  // namespace handhold
