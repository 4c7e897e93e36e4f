#include "mesh/ray_scene.h"

#include "mesh/embree_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <embree3/rtcore.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

// Directions without symmetry, so that rays seldom meet an edge or run along a face of a made object.
const std::array<Vector3d, 3> kInsideDirections = {Vector3d(0.5720614, 0.3219417, 0.7543923).normalized(),
                                                   Vector3d(-0.6631279, 0.7142853, 0.2236173).normalized(),
                                                   Vector3d(0.1873541, -0.5419827, -0.8192347).normalized()};
// Relative to distance plus mesh size: the rounding of Embree's single precision with room to spare.
constexpr double kSameDistance = 1e-6;

/// The context of one ray that passes through everything and writes down what it met.
struct CrossingContext {
  RTCIntersectContext context;  // first, so that Embree's pointer is also a pointer to this
  std::vector<RayHit>* hits;
};

void recordHit(const RTCFilterFunctionNArguments* arguments) {
  if (arguments->valid[0] == 0) return;
  const auto* crossing = reinterpret_cast<const CrossingContext*>(arguments->context);
  crossing->hits->push_back(
      {RTCRayN_tfar(arguments->ray, arguments->N, 0), RTCHitN_primID(arguments->hit, arguments->N, 0)});
  arguments->valid[0] = 0;  // go on
}

RTCRayHit makeRay(const Vector3d& origin, const Vector3d& direction) {
  RTCRayHit ray{};
  ray.ray.org_x = static_cast<float>(origin.x());
  ray.ray.org_y = static_cast<float>(origin.y());
  ray.ray.org_z = static_cast<float>(origin.z());
  ray.ray.dir_x = static_cast<float>(direction.x());
  ray.ray.dir_y = static_cast<float>(direction.y());
  ray.ray.dir_z = static_cast<float>(direction.z());
  ray.ray.tfar = std::numeric_limits<float>::infinity();
  ray.ray.mask = ~0U;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return ray;
}

bool shareVertex(const std::array<std::uint32_t, 3>& a, const std::array<std::uint32_t, 3>& b) {
  return std::any_of(a.begin(), a.end(), [&](std::uint32_t v) { return std::find(b.begin(), b.end(), v) != b.end(); });
}

}  // namespace

struct RayScene::Impl {
  TriangleMesh mesh;
  double size = 0;  // m, diagonal
  EmbreeScene scene;

  explicit Impl(const TriangleMesh& source)
      : mesh(source),
        size(mesh.vertices.empty() ? 0 : boundingBox(mesh).diagonal().norm()),
        scene(mesh, EmbreeScene::Filter::context) {}

  int sign(std::uint32_t triangle, const Vector3d& direction) const {
    const auto [a, b, c] = mesh.corners(triangle);
    return (b - a).cross(c - a).dot(direction) > 0 ? 1 : -1;
  }

  bool isSameCrossing(const RayHit& a, const RayHit& b, const Vector3d& direction) const {
    return std::abs(a.distance - b.distance) <= kSameDistance * (size + std::abs(a.distance)) &&
           sign(a.triangle, direction) == sign(b.triangle, direction) &&
           shareVertex(mesh.triangles[a.triangle], mesh.triangles[b.triangle]);
  }
};

RayScene::RayScene(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>(mesh)) {}
RayScene::~RayScene() = default;
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;

RayHit RayScene::cast(const Vector3d& origin, const Vector3d& direction) const {
  RTCRayHit ray = makeRay(origin, direction);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(impl_->scene.handle(), &context, &ray);
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  return {ray.ray.tfar, ray.hit.primID};
}

void RayScene::crossings(const Vector3d& origin, const Vector3d& direction, std::vector<RayCrossing>& result) const {
  thread_local std::vector<RayHit> hits;
  hits.clear();
  result.clear();
  CrossingContext crossing{};
  rtcInitIntersectContext(&crossing.context);
  crossing.context.filter = recordHit;
  crossing.hits = &hits;
  RTCRayHit ray = makeRay(origin, direction);
  rtcIntersect1(impl_->scene.handle(), &crossing.context, &ray);
  std::sort(hits.begin(), hits.end(), [](const RayHit& a, const RayHit& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.triangle < b.triangle;
  });
  // A ray through an edge or a vertex meets several triangles there; they are one crossing.
  for (const RayHit& hit : hits) {
    bool known = false;
    for (auto old = result.rbegin(); old != result.rend() && !known; ++old) {
      if (hit.distance - old->hit.distance > kSameDistance * (impl_->size + hit.distance)) break;
      known = impl_->isSameCrossing(old->hit, hit, direction);
    }
    if (!known) result.push_back({hit, impl_->sign(hit.triangle, direction)});
  }
}

bool RayScene::contains(const Vector3d& point) const {
  thread_local std::vector<RayCrossing> met;
  int votes = 0;
  for (const auto& direction : kInsideDirections) {
    crossings(point, direction, met);
    int winding = 0;
    for (const auto& crossing : met) winding += crossing.sign;
    votes += winding > 0 ? 1 : 0;
  }
  return votes >= 2;
}

}  // namespace handhold
