#pragma once

#include "hand/hand.h"
#include "mesh/object.h"

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

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

  /// Do the surfaces of two links of the hand intersect?
  bool linksTouch(int a, const Eigen::Isometry3d& X_HA, int b, const Eigen::Isometry3d& X_HB) const;

  /// The object's triangles that reach into the link's bounding box grown by `margin` [m], ascending.
  void trianglesNear(int link, const Eigen::Isometry3d& X_OL, double margin,
                     std::vector<std::uint32_t>& triangles) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The pairs of links, lower index first, whose surfaces do not intersect at X_HL.
std::vector<std::pair<int, int>> linkPairsApart(const Hand& hand, const std::vector<Eigen::Isometry3d>& X_HL);

}  // namespace handhold
