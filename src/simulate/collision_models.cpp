#include "simulate/collision_models.h"

#include "mesh/ray_scene.h"

#include <algorithm>
#include <limits>

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/narrowphase/collision.h>

namespace handhold {
namespace {

using Bvh = fcl::BVHModel<fcl::OBBRSS<double>>;

std::unique_ptr<Bvh> makeBvh(const TriangleMesh& mesh) {
  std::vector<fcl::Triangle> triangles;
  triangles.reserve(mesh.triangles.size());
  for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
  auto bvh = std::make_unique<Bvh>();
  bvh->beginModel(static_cast<int>(triangles.size()), static_cast<int>(mesh.vertices.size()));
  bvh->addSubModel(mesh.vertices, triangles);
  bvh->endModel();
  return bvh;
}

bool touches(const Bvh& a, const Eigen::Isometry3d& X_A, const Bvh& b, const Eigen::Isometry3d& X_B) {
  static const fcl::CollisionRequest<double> request(1, false);
  fcl::CollisionResult<double> result;
  return fcl::collide(&a, X_A, &b, X_B, request, result) > 0;
}

}  // namespace

struct CollisionModels::Impl {
  struct LinkModel {
    std::unique_ptr<Bvh> bvh;  // null without geometry
    Eigen::AlignedBox3d box;
    std::unique_ptr<RayScene> enclosing;  // only when the object is small enough to lie inside the link
  };

  const Hand& hand;
  const ObjectModel& object;
  std::unique_ptr<Bvh> objectBvh;
  RayScene objectScene;
  Eigen::AlignedBox3d objectBox;
  std::vector<LinkModel> links;
};

CollisionModels::CollisionModels(const Hand& hand, const ObjectModel& object)
    : impl_(new Impl{hand, object, makeBvh(object.mesh), RayScene(object.mesh), boundingBox(object.mesh), {}}) {
  for (const HandLink& link : hand.links) {
    Impl::LinkModel& model = impl_->links.emplace_back();
    if (link.mesh.triangles.empty()) continue;
    model.bvh = makeBvh(link.mesh);
    model.box = boundingBox(link.mesh);
    if (impl_->objectBox.diagonal().norm() < model.box.diagonal().norm()) {
      model.enclosing = std::make_unique<RayScene>(link.mesh);
    }
  }
}

CollisionModels::~CollisionModels() = default;

bool CollisionModels::surfacesTouch(int link, const Eigen::Isometry3d& X_OL) const {
  const Impl::LinkModel& model = impl_->links[link];
  return model.bvh != nullptr && touches(*impl_->objectBvh, Eigen::Isometry3d::Identity(), *model.bvh, X_OL);
}

bool CollisionModels::isContained(int link, const Eigen::Isometry3d& X_OL) const {
  const Impl::LinkModel& model = impl_->links[link];
  if (model.bvh == nullptr) return false;
  for (const Eigen::Vector3d& p_L : impl_->hand.links[link].piecePoints) {
    const Eigen::Vector3d p_O = X_OL * p_L;
    if (impl_->objectBox.contains(p_O) && impl_->objectScene.contains(p_O)) return true;
  }
  if (model.enclosing == nullptr) return false;
  const Eigen::Vector3d p_L = X_OL.inverse() * impl_->object.mesh.vertices[0];
  return model.box.contains(p_L) && model.enclosing->contains(p_L);
}

bool CollisionModels::linksTouch(int a, const Eigen::Isometry3d& X_HA, int b, const Eigen::Isometry3d& X_HB) const {
  return touches(*impl_->links[a].bvh, X_HA, *impl_->links[b].bvh, X_HB);
}

void CollisionModels::trianglesNear(int link, const Eigen::Isometry3d& X_OL, double margin,
                                    std::vector<std::uint32_t>& triangles) const {
  triangles.clear();
  const Impl::LinkModel& model = impl_->links[link];
  if (model.bvh == nullptr) return;
  const fcl::Box<double> box(model.box.sizes() + Eigen::Vector3d::Constant(2 * margin));
  const Eigen::Isometry3d X_OB = X_OL * Eigen::Translation3d(model.box.center());
  const fcl::CollisionRequest<double> request(std::numeric_limits<int>::max(), false);
  fcl::CollisionResult<double> result;
  fcl::collide(impl_->objectBvh.get(), Eigen::Isometry3d::Identity(), &box, X_OB, request, result);
  for (std::size_t i = 0; i < result.numContacts(); ++i) {
    triangles.push_back(static_cast<std::uint32_t>(result.getContact(i).b1));
  }
  std::sort(triangles.begin(), triangles.end());
  triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
}

std::vector<std::pair<int, int>> linkPairsApart(const Hand& hand, const std::vector<Eigen::Isometry3d>& X_HL) {
  std::vector<std::unique_ptr<Bvh>> models;
  for (const HandLink& link : hand.links) {
    models.push_back(link.mesh.triangles.empty() ? nullptr : makeBvh(link.mesh));
  }
  std::vector<std::pair<int, int>> pairs;
  for (std::size_t a = 0; a < models.size(); ++a) {
    for (std::size_t b = a + 1; b < models.size(); ++b) {
      if (models[a] == nullptr || models[b] == nullptr) continue;
      if (!touches(*models[a], X_HL[a], *models[b], X_HL[b]))
        pairs.emplace_back(static_cast<int>(a), static_cast<int>(b));
    }
  }
  return pairs;
}

}  // namespace handhold
