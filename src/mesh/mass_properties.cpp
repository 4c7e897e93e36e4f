#include "mesh/mass_properties.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Integrals of 1, x and x x^T over a solid or a surface.
struct Moments {
  double zeroth = 0;
  Vector3d first = Vector3d::Zero();
  Matrix3d second = Matrix3d::Zero();
};

/// Over the simplex (a, b, c), or (0, a, b, c) since the origin adds nothing: `measure` is its size,
/// `first` = measure / vertices, `second` = measure / (vertices (vertices + 1)).
void addSimplex(Moments& moments, const std::array<Vector3d, 3>& corners, double measure, double vertices) {
  const auto& [a, b, c] = corners;
  const Vector3d s = a + b + c;
  moments.zeroth += measure;
  moments.first += measure / vertices * s;
  moments.second += measure / (vertices * (vertices + 1)) *
                    (s * s.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose());
}

}  // namespace

MassProperties massProperties(const TriangleMesh& mesh, bool watertight) {
  MassProperties result;
  if (mesh.vertices.empty()) return result;
  // Integrating about the middle keeps digits when the mesh is far from its origin.
  const Vector3d middle = boundingBox(mesh).center();
  Moments solid;
  Moments surface;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    auto corners = mesh.corners(i);
    for (auto& corner : corners) corner -= middle;
    const auto& [a, b, c] = corners;
    addSimplex(solid, corners, a.dot(b.cross(c)) / 6, 4);
    addSimplex(surface, corners, (b - a).cross(c - a).norm() / 2, 3);
  }
  const Moments& moments = watertight ? solid : surface;
  result.area = surface.zeroth;
  result.volume = watertight ? solid.zeroth : 0;
  if (moments.zeroth == 0) return result;
  const Vector3d center = moments.first / moments.zeroth;
  const Matrix3d covariance = moments.second - moments.zeroth * center * center.transpose();
  result.inertia = covariance.trace() * Matrix3d::Identity() - covariance;
  result.centerOfMass = middle + center;
  for (const auto& vertex : mesh.vertices) {
    result.radius = std::max(result.radius, (vertex - result.centerOfMass).norm());
  }
  return result;
}

}  // namespace handhold
