#include "rank/link_clearance.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace handhold {
namespace {

/// Points on the triangles, one for each cell of a grid that the surface passes through.
std::vector<Eigen::Vector3d> surfacePoints(const TriangleMesh& mesh, double spacing) {
  std::set<std::array<long, 3>> taken;
  std::vector<Eigen::Vector3d> points;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = mesh.corners(t);
    const double longest = std::max({(b - a).norm(), (c - a).norm(), (c - b).norm()});
    const int n = std::max(1, static_cast<int>(std::ceil(2 * longest / spacing)));
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; i + j <= n; ++j) {
        const Eigen::Vector3d p = a + (b - a) * i / n + (c - a) * j / n;
        const Eigen::Array3d cell = (p.array() / spacing).floor();
        if (taken.insert({static_cast<long>(cell[0]), static_cast<long>(cell[1]), static_cast<long>(cell[2])}).second)
          points.push_back(p);
      }
    }
  }
  return points;
}

}  // namespace

LinkClearance::LinkClearance(const Mechanism& mechanism, double spacing, const std::vector<bool>& included) {
  for (std::size_t i = 0; i < mechanism.links.size(); ++i) {
    if (mechanism.links[i].mesh.triangles.empty() || (!included.empty() && !included[i])) continue;
    LinkPoints link;
    link.link = static_cast<int>(i);
    link.points = surfacePoints(mechanism.links[i].mesh, spacing);
    link.center = boundingBox(mechanism.links[i].mesh).center();
    for (const Eigen::Vector3d& p : link.points) link.radius = std::max(link.radius, (p - link.center).norm());
    links_.push_back(std::move(link));
  }
}

double LinkClearance::operator()(const Eigen::Isometry3d& X_WH, const std::vector<Eigen::Isometry3d>& X_HL,
                                 const std::vector<ObstacleDistance>& obstacles, double far) const {
  double least = far;
  for (const ObstacleDistance& obstacle : obstacles) {
    const Eigen::Isometry3d X_SH = obstacle.X_WS.inverse() * X_WH;
    const SignedDistance& distance = *obstacle.distance;
    for (const LinkPoints& link : links_) {
      const Eigen::Isometry3d X_SL = X_SH * X_HL[link.link];
      if (distance(X_SL * link.center) - link.radius - distance.error() >= least) continue;
      for (const Eigen::Vector3d& p : link.points) least = std::min(least, distance(X_SL * p));
      if (least <= 0) return least;
    }
  }
  return least;
}

}  // namespace handhold
