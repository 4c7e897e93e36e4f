#include "simulate/collision_models.h"

#include "mesh/ray_scene.h"

#include <algorithm>
#include <iterator>
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

struct LinkModels::Impl {
  std::vector<std::unique_ptr<Bvh>> bvhs;  // null without geometry
};

LinkModels::LinkModels(const Hand& hand) : impl_(new Impl) {
  for (const Link& link : hand.links) {
    impl_->bvhs.push_back(link.mesh.triangles.empty() ? nullptr : makeBvh(link.mesh));
  }
}

LinkModels::~LinkModels() = default;

bool LinkModels::touch(int a, const Eigen::Isometry3d& X_HA, int b, const Eigen::Isometry3d& X_HB) const {
  const Bvh* const first = impl_->bvhs[a].get();
  const Bvh* const second = impl_->bvhs[b].get();
  return first != nullptr && second != nullptr && touches(*first, X_HA, *second, X_HB);
}

std::vector<std::pair<int, int>> LinkModels::apart(const std::vector<std::pair<int, int>>& pairs,
                                                   const std::vector<Eigen::Isometry3d>& X_HL) const {
  std::vector<std::pair<int, int>> result;
  std::copy_if(pairs.begin(), pairs.end(), std::back_inserter(result),
               [&](const auto& pair) { return !touch(pair.first, X_HL[pair.first], pair.second, X_HL[pair.second]); });
  return result;
}

struct CollisionModels::Impl {
  struct LinkModel {
    const Bvh* bvh = nullptr;  // null without geometry
    Eigen::AlignedBox3d box;
    std::unique_ptr<RayScene> enclosing;  // only when the object is small enough to lie inside the link
  };

  const Hand& hand;
  const ObjectModel& object;
  LinkModels linkModels;
  std::unique_ptr<Bvh> objectBvh;
  RayScene objectScene;
  Eigen::AlignedBox3d objectBox;
  std::vector<LinkModel> links;
};

CollisionModels::CollisionModels(const Hand& hand, const ObjectModel& object)
    : impl_(new Impl{
          hand, object, LinkModels(hand), makeBvh(object.mesh), RayScene(object.mesh), boundingBox(object.mesh), {}}) {
  for (const Link& link : hand.links) {
    Impl::LinkModel& model = impl_->links.emplace_back();
    if (link.mesh.triangles.empty()) continue;
    model.bvh = impl_->linkModels.impl_->bvhs[impl_->links.size() - 1].get();
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

const LinkModels& CollisionModels::links() const { return impl_->linkModels; }

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

std::vector<Eigen::Vector3d> partPoints(const Hand& hand, const std::vector<Eigen::Isometry3d>& X_HL) {
  struct Piece {
    std::unique_ptr<Bvh> bvh;
    Eigen::Isometry3d X_HL;
    Eigen::Vector3d point;  // in H
    std::size_t part;
  };
  std::vector<Piece> pieces;
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    for (const TriangleMesh& mesh : splitPieces(hand.links[i].mesh)) {
      pieces.push_back({makeBvh(mesh), X_HL[i], X_HL[i] * mesh.vertices[0], pieces.size()});
    }
  }
  for (std::size_t a = 0; a < pieces.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      const std::size_t from = pieces[b].part, to = pieces[a].part;
      if (from == to || !touches(*pieces[a].bvh, pieces[a].X_HL, *pieces[b].bvh, pieces[b].X_HL)) continue;
      for (Piece& piece : pieces) {
        if (piece.part == from) piece.part = to;
      }
    }
  }
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].part == i) points.push_back(pieces[i].point);
  }
  return points;
}

}  // namespace handhold
