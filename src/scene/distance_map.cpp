#include "scene/distance_map.h"

#include "core/error.h"
#include "mesh/embree_scene.h"
#include "scene/inside.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

#include <embree3/rtcore.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3f;
using Eigen::Vector3d;
using Eigen::Vector3f;

/// A target stands on its table: whichever side of the table's surface rounding puts a point on, it touches it. Rays
/// start this far behind their point, and a point less deep than this is not inside [m].
constexpr double kTouch = 1e-5;

/// The two tangents and the unit vector n as columns (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
Matrix3f basisAbout(const Vector3f& n) {
  const float sign = std::copysign(1.0F, n.z());
  const float a = -1.0F / (sign + n.z());
  const float b = n.x() * n.y() * a;
  Matrix3f basis;
  basis.col(0) << 1.0F + sign * n.x() * n.x() * a, sign * b, -sign * n.x();
  basis.col(1) << b, sign + n.y() * n.y() * a, -n.y();
  basis.col(2) = n;
  return basis;
}

Eigen::AlignedBox3d moved(const Eigen::AlignedBox3d& box, const Isometry3d& X) {
  Eigen::AlignedBox3d result;
  for (int i = 0; i < 8; ++i) {
    result.extend(X * box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(i)));
  }
  return result;
}

/// Distance along a ray to the first surface, `limit` when nothing is nearer.
float castRay(RTCScene scene, const Vector3f& origin, const Vector3f& direction, float limit) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit ray;
  ray.ray.org_x = origin.x();
  ray.ray.org_y = origin.y();
  ray.ray.org_z = origin.z();
  ray.ray.tnear = 0;
  ray.ray.dir_x = direction.x();
  ray.ray.dir_y = direction.y();
  ray.ray.dir_z = direction.z();
  ray.ray.time = 0;
  ray.ray.tfar = limit;
  ray.ray.mask = ~0U;
  ray.ray.flags = 0;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene, &context, &ray);
  return ray.ray.tfar;
}

}  // namespace

struct SceneRays::Impl {
  /// What is built once for a shape.
  struct Shape {
    std::shared_ptr<const ObstacleShape> shape;
    EmbreeScene surface;
    Inside inside;
    Eigen::AlignedBox3d box;

    explicit Shape(const std::shared_ptr<const ObstacleShape>& source)
        : shape(source), surface(source->mesh), inside(source), box(boundingBox(source->mesh)) {}
  };

  struct Placed {
    std::shared_ptr<const Shape> shape;
    Isometry3d X_SW;
    Eigen::AlignedBox3d box;  // in W
  };

  std::vector<Placed> placed;
  RTCScene scene = rtcNewScene(embreeDevice());

  ~Impl() { rtcReleaseScene(scene); }
  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  std::shared_ptr<const Shape> find(const std::shared_ptr<const ObstacleShape>& source) const {
    const auto found =
        std::find_if(placed.begin(), placed.end(), [&](const Placed& one) { return one.shape->shape == source; });
    return found != placed.end() ? found->shape : nullptr;
  }

  void commit() {
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    for (const Placed& one : placed) {
      RTCGeometry instance = rtcNewGeometry(embreeDevice(), RTC_GEOMETRY_TYPE_INSTANCE);
      rtcSetGeometryInstancedScene(instance, one.shape->surface.handle());
      const Eigen::Matrix<float, 3, 4> X_WS = one.X_SW.inverse().matrix().topRows<3>().cast<float>();
      rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, X_WS.data());
      rtcCommitGeometry(instance);
      rtcAttachGeometry(scene, instance);
      rtcReleaseGeometry(instance);
    }
    rtcCommitScene(scene);
    requireEmbree("placing the obstacles");
  }

  bool contains(const Vector3d& p_W) const {
    return std::any_of(placed.begin(), placed.end(), [&](const Placed& one) {
      return one.box.contains(p_W) && one.shape->inside(one.X_SW * p_W, kTouch);
    });
  }
};

SceneRays::SceneRays() : impl_(std::make_unique<Impl>()) { impl_->commit(); }
SceneRays::~SceneRays() = default;

void SceneRays::update(const std::vector<Obstacle>& obstacles) {
  auto next = std::make_unique<Impl>();
  for (const Obstacle& obstacle : obstacles) {
    if (obstacle.shape->mesh.triangles.empty()) continue;  // a cloud whose points were all dropped
    auto shape = impl_->find(obstacle.shape);
    if (shape == nullptr) shape = next->find(obstacle.shape);
    if (shape == nullptr) shape = std::make_shared<const Impl::Shape>(obstacle.shape);
    next->placed.push_back({shape, obstacle.X_WS.inverse(), moved(shape->box, obstacle.X_WS)});
  }
  next->commit();
  impl_ = std::move(next);
}

double SceneRays::cast(const Vector3d& origin, const Vector3d& direction) const {
  return castRay(impl_->scene, origin.cast<float>(), direction.cast<float>(), std::numeric_limits<float>::infinity());
}

DistanceMap::DistanceMap(const DistanceMapSettings& settings) : settings_(settings) {
  assert(settings.rays >= 1 && settings.coneAngle >= 0 && settings.coneAngle < std::numbers::pi / 2 &&
         settings.far > 0);
  const auto add = [&](double share, double angle) {  // share of the cap's area about the axis
    const double z = 1 - share * (1 - std::cos(settings_.coneAngle));
    const double r = std::sqrt(1 - z * z);
    rays_.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
    coneRays_.push_back(rays_.back().cast<float>());
  };
  const double goldenAngle = std::numbers::pi * (3 - std::sqrt(5.0));
  const int rim = settings_.rays / 3;
  const int spiral = settings_.rays - 1 - rim;
  add(0, 0);
  for (int k = 1; k <= spiral; ++k) add(k / (spiral + 1.0), k * goldenAngle);
  for (int k = 0; k < rim; ++k) add(1, 2 * std::numbers::pi * k / rim);
}

void DistanceMap::compute(const SceneRays& scene, std::span<const float> points, std::span<const float> normals,
                          const Isometry3d& X_WO, std::vector<float>& D) const {
  assert(points.size() == normals.size() && points.size() % 3 == 0);
  const SceneRays::Impl& rays = *scene.impl_;
  const Matrix3f R_WO = X_WO.linear().cast<float>();
  const auto touch = static_cast<float>(kTouch);
  D.resize(points.size() / 3);
  std::size_t nearestRay = 0;  // of the point before: most often also near here, and then the others are short
  for (std::size_t i = 0; i < D.size(); ++i) {
    const Vector3f p_O(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    const Vector3f n_O(normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]);
    const Vector3d p_W = X_WO * p_O.cast<double>();
    if (rays.contains(p_W)) {
      D[i] = 0;
      continue;
    }
    const Vector3f origin = p_W.cast<float>();
    const Matrix3f cone = R_WO * basisAbout(n_O);
    float nearest = static_cast<float>(settings_.far);
    const auto shoot = [&](std::size_t k) {
      const Vector3f direction = cone * coneRays_[k];
      const float limit = nearest + touch;
      const float distance = castRay(rays.scene, origin - touch * direction, direction, limit);
      if (distance >= limit) return false;
      nearest = std::max(0.0F, distance - touch);
      return true;
    };
    const std::size_t first = nearestRay;
    shoot(first);
    for (std::size_t k = 0; k < rays_.size() && nearest > 0; ++k) {
      if (k != first && shoot(k)) nearestRay = k;
    }
    D[i] = nearest;
  }
}

}  // namespace handhold
