#include "build/keep.h"

#include <algorithm>
#include <limits>

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
  std::vector<Eigen::Quaterniond> orientation;
  orientation.reserve(grasps.size());
  for (const KeptGrasp& grasp : grasps) orientation.emplace_back(grasp.X_OH.linear());
  std::vector<double> distance(grasps.size(), std::numeric_limits<double>::infinity());
  std::vector<bool> kept(grasps.size(), false);
  std::size_t next = 0;
  for (std::size_t taken = 0; taken < top; ++taken) {
    kept[next] = true;
    for (std::size_t i = 0; i < grasps.size(); ++i) {
      const double apart = (grasps[i].X_OH.translation() - grasps[next].X_OH.translation()).norm() +
                           radius * orientation[i].angularDistance(orientation[next]);
      distance[i] = kept[i] ? -1 : std::min(distance[i], apart);
    }
    next = std::max_element(distance.begin(), distance.end()) - distance.begin();
  }
  std::vector<KeptGrasp> result;
  for (std::size_t i = 0; i < grasps.size(); ++i) {
    if (kept[i]) result.push_back(std::move(grasps[i]));
  }
  grasps = std::move(result);
}

}  // namespace handhold
