#include "mesh/primitives.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace handhold {
namespace {

using std::numbers::pi;

/// Segments of a circle whose chords stay within `error`: r (1 - cos(pi / n)) <= e.
int circleSegments(double radius, double error) {
  const double cosine = std::max(0.0, 1 - error / radius);
  return std::clamp(static_cast<int>(std::ceil(pi / std::acos(cosine))), 12, 400);
}

Eigen::Vector3d onCircle(double radius, int i, int n, double z) {
  const double angle = 2 * pi * i / n;
  return {radius * std::cos(angle), radius * std::sin(angle), z};
}

using Index = std::uint32_t;

}  // namespace

TriangleMesh boxMesh(const Eigen::Vector3d& size) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.vertices.push_back(0.5 * size.cwiseProduct(Eigen::Vector3d(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1)));
  }
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

TriangleMesh cylinderMesh(double radius, double length, double chordError) {
  const int n = circleSegments(radius, chordError);
  TriangleMesh mesh;
  for (int i = 0; i < n; ++i) mesh.vertices.push_back(onCircle(radius, i, n, -length / 2));
  for (int i = 0; i < n; ++i) mesh.vertices.push_back(onCircle(radius, i, n, length / 2));
  mesh.vertices.emplace_back(0, 0, -length / 2);
  mesh.vertices.emplace_back(0, 0, length / 2);
  const Index bottom = 2 * n, top = 2 * n + 1;
  for (Index i = 0; i < static_cast<Index>(n); ++i) {
    const Index j = (i + 1) % n, a = i, b = j, c = n + i, d = n + j;
    mesh.triangles.push_back({a, b, d});
    mesh.triangles.push_back({a, d, c});
    mesh.triangles.push_back({bottom, b, a});
    mesh.triangles.push_back({top, c, d});
  }
  return mesh;
}

TriangleMesh sphereMesh(double radius, double chordError) {
  const int around = circleSegments(radius, chordError / 2);  // the chords of both directions add up
  const int bands = std::max(6, around / 2);
  TriangleMesh mesh;
  for (int band = 1; band < bands; ++band) {
    const double polar = pi * band / bands;
    for (int i = 0; i < around; ++i) {
      mesh.vertices.push_back(onCircle(radius * std::sin(polar), i, around, radius * std::cos(polar)));
    }
  }
  const Index north = static_cast<Index>(mesh.vertices.size()), south = north + 1;
  mesh.vertices.emplace_back(0, 0, radius);
  mesh.vertices.emplace_back(0, 0, -radius);
  const auto at = [&](int band, int i) { return static_cast<Index>((band - 1) * around + i % around); };
  for (int i = 0; i < around; ++i) {
    mesh.triangles.push_back({north, at(1, i), at(1, i + 1)});
    mesh.triangles.push_back({south, at(bands - 1, i + 1), at(bands - 1, i)});
    for (int band = 1; band + 1 < bands; ++band) {
      mesh.triangles.push_back({at(band, i), at(band + 1, i), at(band + 1, i + 1)});
      mesh.triangles.push_back({at(band, i), at(band + 1, i + 1), at(band, i + 1)});
    }
  }
  return mesh;
}

}  // namespace handhold
