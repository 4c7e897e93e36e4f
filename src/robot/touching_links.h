#pragma once

// Private to src/robot.

#include "hand/mechanism.h"

#include <memory>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// The exact triangles of a mechanism's links, ready for collision tests (FCL).
/// @note Immutable; safe from many threads.
class TouchingLinks {
 public:
  explicit TouchingLinks(const Mechanism& mechanism);
  ~TouchingLinks();

  /// Do two links overlap, or is a piece of one inside the other? A link without geometry touches nothing.
  bool touch(int a, int b, const std::vector<Eigen::Isometry3d>& X_BL) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace handhold
