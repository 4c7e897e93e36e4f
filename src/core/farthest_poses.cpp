#include "core/farthest_poses.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <numeric>

namespace handhold {
namespace {

constexpr double kTie = 1e-9;  // m

}  // namespace

PoseCover farthestPoses(const std::vector<Eigen::Isometry3d>& poses, std::size_t count, double s) {
  PoseCover cover;
  if (poses.size() <= count) {
    cover.chosen.resize(poses.size());
    std::iota(cover.chosen.begin(), cover.chosen.end(), std::size_t{0});
    return cover;
  }
  assert(count > 0);
  std::vector<Eigen::Vector3d> position;
  std::vector<Eigen::Quaterniond> orientation;
  for (const Eigen::Isometry3d& pose : poses) {
    position.push_back(pose.translation());
    orientation.emplace_back(pose.linear());
  }
  std::vector<double> distance(poses.size(), std::numeric_limits<double>::infinity());  // to the nearest chosen pose
  std::size_t next = 0;
  while (true) {
    cover.chosen.push_back(next);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const double moved = (position[i] - position[next]).norm();
      if (moved >= distance[i]) continue;  // a turn would only add to it
      distance[i] = std::min(distance[i], moved + s * orientation[i].angularDistance(orientation[next]));
    }
    for (const std::size_t i : cover.chosen) distance[i] = -1;  // below any tie, also with a pose that equals it
    cover.radius = *std::max_element(distance.begin(), distance.end());
    if (cover.chosen.size() == count) break;
    const auto isFarthest = [&](double d) { return d >= cover.radius - kTie; };
    next = static_cast<std::size_t>(std::find_if(distance.begin(), distance.end(), isFarthest) - distance.begin());
  }
  std::sort(cover.chosen.begin(), cover.chosen.end());
  return cover;
}

}  // namespace handhold
