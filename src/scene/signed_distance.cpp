#include "scene/signed_distance.h"

#include "scene/inside.h"
#include "scene/surface_distance.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr double kFinestSpacing = 1e-3;  // m
constexpr std::size_t kMostNodes = 60'000;

/// Signed distance to a mesh at the nodes of a grid around it.
class DistanceGrid {
 public:
  explicit DistanceGrid(const std::shared_ptr<const ObstacleShape>& shape) {
    assert(!shape->mesh.triangles.empty());
    const Eigen::AlignedBox3d box = boundingBox(shape->mesh);
    for (spacing_ = kFinestSpacing; !place(box); spacing_ *= 1.1) {
    }
    const SurfaceDistance distance(shape->mesh);
    const Inside inside(shape);
    std::uint32_t nearest = 0;  // to the node before
    values_.reserve(static_cast<std::size_t>(count_.prod()));
    for (int z = 0; z < count_.z(); ++z) {
      for (int y = 0; y < count_.y(); ++y) {
        for (int x = 0; x < count_.x(); ++x) {
          const Vector3d p = low_ + spacing_ * Vector3d(x, y, z);
          const double d = distance.from(nearest, p);
          values_.push_back(static_cast<float>(inside(p) ? -d : d));
        }
      }
    }
  }

  double spacing() const { return spacing_; }

  /// Equations (2) and (3) of README.md.
  double operator()(const Vector3d& p) const {
    const Vector3d c = p.cwiseMax(low_).cwiseMin(high_);
    const double inGrid = interpolate((c - low_) / spacing_);
    const double squaredOutside = (p - c).squaredNorm();
    return squaredOutside == 0 ? inGrid : std::sqrt(squaredOutside + inGrid * inGrid);
  }

 private:
  /// One spacing of room around the mesh; false when that takes too many nodes.
  bool place(const Eigen::AlignedBox3d& box) {
    const Vector3d cells = (box.sizes() / spacing_).array().ceil() + 2;
    if ((cells.array() + 1).prod() > static_cast<double>(kMostNodes)) return false;
    count_ = cells.cast<int>() + Vector3i::Ones();
    low_ = box.center() - spacing_ / 2 * cells;
    high_ = box.center() + spacing_ / 2 * cells;
    return true;
  }

  double interpolate(const Vector3d& at) const {
    const Vector3i cell = at.cast<int>().cwiseMin(count_ - Vector3i::Constant(2));
    const Vector3d u = at - cell.cast<double>();
    const std::ptrdiff_t row = count_.x();
    const std::ptrdiff_t layer = row * count_.y();
    const float* corner = values_.data() + cell.z() * layer + cell.y() * row + cell.x();
    const auto along = [&](const float* from) { return from[0] + u.x() * (from[1] - from[0]); };
    const auto across = [&](const float* from) {
      const double near = along(from);
      return near + u.y() * (along(from + row) - near);
    };
    const double below = across(corner);
    return below + u.z() * (across(corner + layer) - below);
  }

  Vector3d low_, high_;
  double spacing_ = 0;
  Vector3i count_;
  std::vector<float> values_;  // x fastest
};

/// Distance of a point to the box |x| <= half, negative inside; in two dimensions for a cylinder's section.
template <typename Vector>
double distanceToBox(const Vector& p, const Vector& half) {
  const Vector q = p.cwiseAbs() - half;
  return q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
}

}  // namespace

struct SignedDistance::Impl {
  std::shared_ptr<const ObstacleShape> shape;
  std::unique_ptr<PointTree> cloud;
  std::unique_ptr<DistanceGrid> grid;
};

SignedDistance::SignedDistance(std::shared_ptr<const ObstacleShape> shape) : impl_(std::make_unique<Impl>()) {
  impl_->shape = std::move(shape);
  if (const auto* cloud = std::get_if<ObstacleShape::Points>(&impl_->shape->kind)) {
    impl_->cloud = std::make_unique<PointTree>(cloud->points);
  } else if (std::holds_alternative<ObstacleShape::Mesh>(impl_->shape->kind)) {
    impl_->grid = std::make_unique<DistanceGrid>(impl_->shape);
  }
}

SignedDistance::~SignedDistance() = default;
SignedDistance::SignedDistance(SignedDistance&&) noexcept = default;
SignedDistance& SignedDistance::operator=(SignedDistance&&) noexcept = default;

double SignedDistance::operator()(const Vector3d& p_S) const {
  struct Measure {
    const Impl& impl;
    const Vector3d& p;

    double operator()(const ObstacleShape::Box& box) const { return distanceToBox<Vector3d>(p, box.size / 2); }
    double operator()(const ObstacleShape::Cylinder& cylinder) const {
      return distanceToBox<Eigen::Vector2d>({p.head<2>().norm(), p.z()}, {cylinder.radius, cylinder.length / 2});
    }
    double operator()(const ObstacleShape::Sphere& sphere) const { return p.norm() - sphere.radius; }
    double operator()(const ObstacleShape::Points& cloud) const { return impl.cloud->distance(p) - cloud.radius; }
    double operator()(const ObstacleShape::Mesh&) const { return (*impl.grid)(p); }
  };
  return std::visit(Measure{*impl_, p_S}, impl_->shape->kind);
}

double SignedDistance::error() const {
  return impl_->grid == nullptr ? 0 : impl_->grid->spacing() * std::sqrt(3.0) / 2;
}

}  // namespace handhold
