#include "core/farthest_poses.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kTie = 1e-9;  // m

/// The distance of each pose from the nearest chosen one. Poses stand in blocks: most blocks hold none that a newly
/// chosen pose is nearer to, which a bound in single precision tells.
class NearestChosen {
 public:
  NearestChosen(const std::vector<Isometry3d>& poses, double s)
      : s_(s), distance_(poses.size(), kFar), farthest_((poses.size() + kBlock - 1) / kBlock, kFar) {
    for (const Isometry3d& pose : poses) {
      position_.push_back(pose.translation());
      orientation_.emplace_back(pose.linear());
    }
    for (auto& array : coordinate_) array.resize(farthest_.size() * kBlock);
    squared_.assign(farthest_.size() * kBlock, -1);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const auto coordinates = coordinatesOf(i);
      for (std::size_t k = 0; k < coordinates.size(); ++k) coordinate_[k][i] = coordinates[k];
      squared_[i] = std::numeric_limits<float>::infinity();
    }
  }

  void choose(std::size_t chosen) {
    for (std::size_t block = 0; block < farthest_.size(); ++block) {
      if (mayBeNearer(chosen, block)) update(chosen, block);
    }
    distance_[chosen] = -1;  // below any tie, also with a pose that equals it
    squared_[chosen] = -1;
    findFarthest(chosen / kBlock);
  }

  double radius() const { return *std::max_element(farthest_.begin(), farthest_.end()); }

  std::size_t firstFarthest() const {
    const auto isFarthest = [least = radius() - kTie](double d) { return d >= least; };
    const auto block = std::find_if(farthest_.begin(), farthest_.end(), isFarthest) - farthest_.begin();
    const auto begin = distance_.begin() + block * static_cast<std::ptrdiff_t>(kBlock);
    return static_cast<std::size_t>(std::find_if(begin, distance_.end(), isFarthest) - distance_.begin());
  }

 private:
  static constexpr std::size_t kBlock = 64;
  static constexpr double kFar = std::numeric_limits<double>::infinity();

  /// Position, from the first one, and orientation, in metres: (p, 2 sqrt(2) s q).
  std::array<float, 7> coordinatesOf(std::size_t i) const {
    const Vector3d p = position_[i] - position_[0];
    const Eigen::Vector4d q = 2 * std::sqrt(2.0) * s_ * orientation_[i].coeffs();
    return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), static_cast<float>(q[0]),
            static_cast<float>(q[1]),  static_cast<float>(q[2]),  static_cast<float>(q[3])};
  }

  /// By  d^2 >= |p - p'|^2 + s^2 angle^2  and  angle^2 >= 4 |q -+ q'|^2 = 8 (1 - |q.q'|).
  bool mayBeNearer(std::size_t chosen, std::size_t block) const {
    constexpr float kRounding = 1e-4F;  // relative
    const std::array<float, 7> c = coordinatesOf(chosen);
    const auto turn = static_cast<float>(8 * s_ * s_);
    const float slack = kRounding * turn;  // of 1 - |q.q'|, which is far less exact
    const std::size_t begin = block * kBlock;
    int any = 0;
    for (std::size_t i = begin; i < begin + kBlock; ++i) {
      const float x = coordinate_[0][i] - c[0], y = coordinate_[1][i] - c[1], z = coordinate_[2][i] - c[2];
      const float along =
          coordinate_[3][i] * c[3] + coordinate_[4][i] * c[4] + coordinate_[5][i] * c[5] + coordinate_[6][i] * c[6];
      const float least = x * x + y * y + z * z + (turn - std::abs(along) - slack);
      any |= least < squared_[i] ? 1 : 0;
    }
    return any != 0;
  }

  void update(std::size_t chosen, std::size_t block) {
    const std::size_t begin = block * kBlock, end = std::min(begin + kBlock, distance_.size());
    for (std::size_t i = begin; i < end; ++i) {
      const double moved = (position_[i] - position_[chosen]).norm();
      if (moved >= distance_[i]) continue;  // a turn would only add to it
      const double d = moved + s_ * orientation_[i].angularDistance(orientation_[chosen]);
      if (d >= distance_[i]) continue;
      distance_[i] = d;
      squared_[i] = static_cast<float>(d * d) * (1 + 1e-4F);
    }
    findFarthest(block);
  }

  void findFarthest(std::size_t block) {
    const auto begin = distance_.begin() + static_cast<std::ptrdiff_t>(block * kBlock);
    const auto end = distance_.begin() + static_cast<std::ptrdiff_t>(std::min((block + 1) * kBlock, distance_.size()));
    farthest_[block] = *std::max_element(begin, end);
  }

  double s_;
  std::vector<Vector3d> position_;
  std::vector<Quaterniond> orientation_;
  std::vector<double> distance_, farthest_;       // of each pose; of each block's farthest
  std::array<std::vector<float>, 7> coordinate_;  // of each pose, as arrays that blocks fill
  std::vector<float> squared_;                    // distance, rounded up; -1 where none can be nearer
};

}  // namespace

PoseCover farthestPoses(const std::vector<Isometry3d>& poses, std::size_t count, double s) {
  PoseCover cover;
  if (poses.size() <= count) {
    cover.chosen.resize(poses.size());
    std::iota(cover.chosen.begin(), cover.chosen.end(), std::size_t{0});
    return cover;
  }
  assert(count > 0);
  NearestChosen nearest(poses, s);
  for (std::size_t next = 0;; next = nearest.firstFarthest()) {
    nearest.choose(next);
    cover.chosen.push_back(next);
    if (cover.chosen.size() == count) break;
  }
  cover.radius = nearest.radius();
  std::sort(cover.chosen.begin(), cover.chosen.end());
  return cover;
}

}  // namespace handhold
