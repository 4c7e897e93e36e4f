#include "scene/surface_distance.h"

#include "mesh/embree_scene.h"

#include <algorithm>
#include <cmath>

#include <embree3/rtcore.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

double squaredDistanceToSegment(const Vector3d& p, const Vector3d& a, const Vector3d& b) {
  const Vector3d ab = b - a;
  const double t = std::clamp((p - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
  return (a + t * ab - p).squaredNorm();
}

/// The triangle has an area. Above its face the distance is that to its plane, else that to the nearest edge.
double squaredDistance(const Vector3d& p, const std::array<Vector3d, 3>& t) {
  const Vector3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
  bool isAbove = true;
  for (int k = 0; k < 3; ++k) isAbove &= normal.cross(t[(k + 1) % 3] - t[k]).dot(p - t[k]) >= 0;
  if (isAbove) {
    const double height = normal.dot(p - t[0]);
    return height * height / normal.squaredNorm();
  }
  return std::min({squaredDistanceToSegment(p, t[0], t[1]), squaredDistanceToSegment(p, t[1], t[2]),
                   squaredDistanceToSegment(p, t[2], t[0])});
}

struct Nearest {
  const TriangleMesh* mesh;
  Vector3d point;
  double squared;  // of the distance found so far
  std::uint32_t triangle = 0;
};

/// Embree culls in floats: a radius a little larger than the distance loses nothing.
float cullRadius(double squared) { return static_cast<float>(std::sqrt(squared) * (1 + 1e-5) + 1e-7); }

bool visitTriangle(RTCPointQueryFunctionArguments* arguments) {
  auto& nearest = *static_cast<Nearest*>(arguments->userPtr);
  const double squared = squaredDistance(nearest.point, nearest.mesh->corners(arguments->primID));
  if (squared >= nearest.squared) return false;
  nearest.squared = squared;
  nearest.triangle = arguments->primID;
  arguments->query->radius = std::min(arguments->query->radius, cullRadius(squared));
  return true;
}

}  // namespace

struct SurfaceDistance::Impl {
  TriangleMesh mesh;
  EmbreeScene scene{mesh};

  void search(Nearest& nearest) const {
    RTCPointQuery query{};
    query.x = static_cast<float>(nearest.point.x());
    query.y = static_cast<float>(nearest.point.y());
    query.z = static_cast<float>(nearest.point.z());
    query.radius = cullRadius(nearest.squared);
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(scene.handle(), &query, &context, visitTriangle, &nearest);
  }
};

SurfaceDistance::SurfaceDistance(const TriangleMesh& mesh) : impl_(new Impl{mesh}) {}
SurfaceDistance::~SurfaceDistance() = default;

double SurfaceDistance::operator()(const Vector3d& point, double limit) const {
  Nearest nearest{&impl_->mesh, point, limit * limit};
  impl_->search(nearest);
  return std::sqrt(nearest.squared);
}

double SurfaceDistance::from(std::uint32_t& triangle, const Vector3d& point) const {
  Nearest nearest{&impl_->mesh, point, squaredDistance(point, impl_->mesh.corners(triangle)), triangle};
  impl_->search(nearest);
  triangle = nearest.triangle;
  return std::sqrt(nearest.squared);
}

}  // namespace handhold
