#include "build/keep.h"

#include "core/farthest_poses.h"

#include <algorithm>

namespace handhold {

void sortGrasps(std::vector<KeptGrasp>& grasps) {
  std::sort(grasps.begin(), grasps.end(), [](const auto& a, const auto& b) {
    return a.epsilon != b.epsilon ? a.epsilon > b.epsilon : a.trial < b.trial;
  });
}

void keepGrasps(std::vector<KeptGrasp>& grasps, std::size_t top, bool diverse, double radius) {
  if (top == 0 || grasps.size() <= top) return;
  if (!diverse) {
    grasps.resize(top);
    return;
  }
  std::vector<Eigen::Isometry3d> poses;
  poses.reserve(grasps.size());
  for (const KeptGrasp& grasp : grasps) poses.push_back(grasp.X_OH);
  std::vector<KeptGrasp> result;
  for (const std::size_t i : farthestPoses(poses, top, radius).chosen) result.push_back(std::move(grasps[i]));
  grasps = std::move(result);
}

}  // namespace handhold
