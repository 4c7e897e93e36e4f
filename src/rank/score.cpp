#include "rank/score.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

/// Equation (3) for one grasp.
double clearance(const GraspTable& table, std::size_t grasp, std::span<const float> D, double far) {
  const std::size_t k = static_cast<std::size_t>(table.neighbors);
  double sum = 0;
  for (std::size_t i = grasp * k; i < (grasp + 1) * k; ++i) sum += table.mapWeight[i] * D[table.mapNeighbor[i]];
  return sum / far;
}

}  // namespace

void scorePaper(const GraspTable& table, int arm, const Eigen::Isometry3d& X_WO, const Eigen::Vector3d& p_WS,
                std::span<const float> D, const ScoreCoefficients& coefficients, std::vector<GraspScore>& scores) {
  const Eigen::Vector3d towards_O = X_WO.linear().transpose() * (X_WO * table.centerOfMass - p_WS).normalized();
  for (std::size_t i = 0; i < table.grasps.size(); ++i) {
    GraspScore score;
    score.arm = arm;
    score.grasp = static_cast<std::uint32_t>(i);
    score.gq = static_cast<float>(table.grasps[i].quality);
    score.gb = static_cast<float>(table.grasps[i].approach.dot(towards_O));
    score.ge = static_cast<float>(clearance(table, i, D, coefficients.far));
    score.score = std::exp(coefficients.c1 * score.gq + coefficients.c2 * score.gb + coefficients.c3 * score.ge);
    scores.push_back(score);
  }
}

void sortScores(std::vector<GraspScore>& scores) {
  std::stable_sort(scores.begin(), scores.end(),
                   [](const GraspScore& a, const GraspScore& b) { return a.score > b.score; });
}

}  // namespace handhold
