#pragma once

#include "hand/hand.h"
#include "mesh/object.h"

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// The exact triangles of a hand's links, ready for collision tests (FCL).
/// @note Immutable; safe from many threads.
class LinkModels {
 public:
  explicit LinkModels(const Hand& hand);
  ~LinkModels();

  /// Do the surfaces of two links intersect? A link without geometry touches nothing.
  bool touch(int a, const Eigen::Isometry3d& X_HA, int b, const Eigen::Isometry3d& X_HB) const;

  /// Those of the pairs that do not touch at X_HL.
  std::vector<std::pair<int, int>> apart(const std::vector<std::pair<int, int>>& pairs,
                                         const std::vector<Eigen::Isometry3d>& X_HL) const;

 private:
  friend class CollisionModels;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The exact triangles of one hand and one object, ready for collision tests (FCL) and containment (Embree).
/// @note Immutable; safe from many threads.
class CollisionModels {
 public:
  /// `hand` and `object` must outlive it.
  CollisionModels(const Hand& hand, const ObjectModel& object);
  ~CollisionModels();

  /// Do the surfaces of the object and of `link` at X_OL intersect?
  bool surfacesTouch(int link, const Eigen::Isometry3d& X_OL) const;

  /// Is a piece of `link` wholly inside the object, or the object wholly inside the link? To be asked only where their
  /// surfaces do not touch.
  bool isContained(int link, const Eigen::Isometry3d& X_OL) const;

  const LinkModels& links() const;

  /// The object's triangles that reach into the link's bounding box grown by `margin` [m], ascending.
  void trianglesNear(int link, const Eigen::Isometry3d& X_OL, double margin,
                     std::vector<std::uint32_t>& triangles) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// One surface point in H of each part of the hand that hangs together at X_HL: pieces whose surfaces meet are one
/// part.
std::vector<Eigen::Vector3d> partPoints(const Hand& hand, const std::vector<Eigen::Isometry3d>& X_HL);

}  // namespace handhold
