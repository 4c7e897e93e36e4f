#include "robot/touching_links.h"

#include "mesh/ray_scene.h"

#include <algorithm>

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/narrowphase/collision.h>

namespace handhold {
namespace {

using Bvh = fcl::BVHModel<fcl::OBBRSS<double>>;

struct Model {
  explicit Model(const Link& link) : box(boundingBox(link.mesh)), inside(link.mesh), piecePoints(link.piecePoints) {
    std::vector<fcl::Triangle> triangles;
    triangles.reserve(link.mesh.triangles.size());
    for (const auto& t : link.mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    bvh.beginModel(static_cast<int>(triangles.size()), static_cast<int>(link.mesh.vertices.size()));
    bvh.addSubModel(link.mesh.vertices, triangles);
    bvh.endModel();
  }

  bool contains(const Model& other, const Eigen::Isometry3d& X) const {
    return std::any_of(other.piecePoints.begin(), other.piecePoints.end(), [&](const Eigen::Vector3d& point) {
      const Eigen::Vector3d p = X * point;
      return box.contains(p) && inside.contains(p);
    });
  }

  Bvh bvh;
  Eigen::AlignedBox3d box;
  RayScene inside;
  const std::vector<Eigen::Vector3d>& piecePoints;
};

}  // namespace

struct TouchingLinks::Impl {
  Mechanism mechanism;
  std::vector<std::unique_ptr<Model>> models;  // null without geometry
};

TouchingLinks::TouchingLinks(const Mechanism& mechanism) : impl_(new Impl{mechanism, {}}) {
  for (const Link& link : impl_->mechanism.links) {
    impl_->models.push_back(link.mesh.triangles.empty() ? nullptr : std::make_unique<Model>(link));
  }
}

TouchingLinks::~TouchingLinks() = default;

bool TouchingLinks::touch(int a, int b, const std::vector<Eigen::Isometry3d>& X_BL) const {
  const Model *const first = impl_->models[a].get(), *const second = impl_->models[b].get();
  if (first == nullptr || second == nullptr) return false;
  const Eigen::Isometry3d X = X_BL[a].inverse() * X_BL[b];
  const double reach = (first->box.diagonal().norm() + second->box.diagonal().norm()) / 2;
  if ((first->box.center() - X * second->box.center()).norm() > reach) return false;
  const fcl::CollisionRequest<double> request(1, false);
  fcl::CollisionResult<double> result;
  fcl::collide(&first->bvh, Eigen::Isometry3d::Identity(), &second->bvh, X, request, result);
  return result.isCollision() || first->contains(*second, X) || second->contains(*first, X.inverse());
}

}  // namespace handhold
