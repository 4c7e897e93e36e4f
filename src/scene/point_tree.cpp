#include "scene/point_tree.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

constexpr std::size_t kLeaf = 8;  // so many points are tried one by one

}  // namespace

PointTree::PointTree(std::vector<Eigen::Vector3d> points) : points_(std::move(points)), axes_(points_.size(), 0) {
  for (const Eigen::Vector3d& point : points_) box_.extend(point);
  build(0, points_.size());
}

void PointTree::build(std::size_t begin, std::size_t end) {
  if (end - begin <= kLeaf) return;
  Eigen::AlignedBox3d box;
  for (std::size_t i = begin; i < end; ++i) box.extend(points_[i]);
  Eigen::Index axis = 0;
  box.sizes().maxCoeff(&axis);
  const std::size_t middle = begin + (end - begin) / 2;
  const auto at = [&](std::size_t i) { return points_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(begin), at(middle), at(end), [axis](const auto& a, const auto& b) { return a[axis] < b[axis]; });
  axes_[middle] = static_cast<unsigned char>(axis);
  build(begin, middle);
  build(middle + 1, end);
}

/// Branches whose box is not nearer than the best so far are left out; the box's distance is kept axis by axis on the
/// way down (Arya, Mount 1993).
struct PointTree::Search {
  const PointTree& tree;
  const Eigen::Vector3d& point;
  double squared;          // of the nearest so far
  Eigen::Vector3d offset;  // from the point to the box of the range at hand

  void visit(std::size_t begin, std::size_t end, double squaredOffset) {
    if (squaredOffset >= squared) return;
    if (end - begin <= kLeaf) {
      for (std::size_t i = begin; i < end; ++i) squared = std::min(squared, (tree.points_[i] - point).squaredNorm());
      return;
    }
    const std::size_t middle = begin + (end - begin) / 2;
    const int axis = tree.axes_[middle];
    const double beyond = point[axis] - tree.points_[middle][axis];
    squared = std::min(squared, (tree.points_[middle] - point).squaredNorm());
    beyond < 0 ? visit(begin, middle, squaredOffset) : visit(middle + 1, end, squaredOffset);
    const double old = offset[axis];
    offset[axis] = beyond;
    const double farther = squaredOffset - old * old + beyond * beyond;
    beyond < 0 ? visit(middle + 1, end, farther) : visit(begin, middle, farther);
    offset[axis] = old;
  }
};

double PointTree::distance(const Eigen::Vector3d& point, double limit) const {
  if (points_.empty()) return limit;
  const Eigen::Vector3d offset = point - point.cwiseMax(box_.min()).cwiseMin(box_.max());
  Search search{*this, point, limit * limit, offset};
  search.visit(0, points_.size(), offset.squaredNorm());
  return std::sqrt(search.squared);
}

}  // namespace handhold
