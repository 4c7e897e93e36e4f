#pragma once

#include <limits>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Nearest point of a cloud (a balanced k-d tree in one array: the middle element of a range divides it along one
/// axis).
/// @note Immutable; safe from many threads.
class PointTree {
 public:
  explicit PointTree(std::vector<Eigen::Vector3d> points);

  /// m; `limit` where no point is nearer than that.
  double distance(const Eigen::Vector3d& point, double limit = std::numeric_limits<double>::infinity()) const;

 private:
  void build(std::size_t begin, std::size_t end);
  struct Search;

  Eigen::AlignedBox3d box_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<unsigned char> axes_;  // along which the element of the same index divides
};

}  // namespace handhold
