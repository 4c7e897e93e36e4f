#include "mesh/triangle_mesh.h"

#include "core/float_rounding.h"
#include "mesh/edges.h"

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

bool isWatertight(const TriangleMesh& mesh) {
  return !mesh.triangles.empty() && countEdges(edgeUses(mesh)).unbalanced == 0;
}

}  // namespace handhold
