#include "rank/reach.h"

#include <algorithm>
#include <numeric>

namespace handhold {
namespace {

constexpr double kSameBranch = 1.0;  // rad, how far a joint may turn between pre-grasp and grasp
constexpr int kSweepSteps = 3;       // between pre-grasp and grasp

/// Poses of the tip for one grasp, in the arm's base.
struct TipPoses {
  Eigen::Isometry3d grasp, pregrasp;
};

TipPoses tipPoses(const StoredGrasp& grasp, const ReachArm& arm, const Eigen::Isometry3d& X_WO, double pregrasp) {
  const Eigen::Isometry3d X_AO = arm.X_WA.inverse() * X_WO;
  const Eigen::Isometry3d X_OT = grasp.X_OH * arm.X_TH.inverse();
  return {X_AO * X_OT, X_AO * Eigen::Translation3d(-pregrasp * grasp.approach) * X_OT};
}

bool isReached(const TipPoses& poses, const ReachArm& arm, std::vector<Eigen::VectorXd>& atGrasp,
               std::vector<Eigen::VectorXd>& before) {
  arm.ik->solve(poses.grasp, arm.posture, atGrasp);
  for (const Eigen::VectorXd& q : atGrasp) {
    arm.ik->solve(poses.pregrasp, q, before);
    if (!before.empty() && (before.front() - q).cwiseAbs().maxCoeff() < kSameBranch) return true;
  }
  return false;
}

}  // namespace

ReachScorer::ReachScorer(const Hand& hand, const ReachSettings& settings)
    : hand_(hand), settings_(settings), clearance_(hand, settings.spacing) {}

double ReachScorer::sweptClearance(const StoredGrasp& grasp, const Eigen::Isometry3d& X_WO,
                                   const std::vector<ObstacleDistance>& obstacles) const {
  const Eigen::Isometry3d X_WH = X_WO * grasp.X_OH;
  const Eigen::Vector3d approach_W = X_WO.linear() * grasp.approach;
  double least = clearance_(X_WH, forwardKinematics(hand_, grasp.finalPosition), obstacles, settings_.far);
  const std::vector<Eigen::Isometry3d> preshape = forwardKinematics(hand_, grasp.preshapePosition);
  for (int i = 0; i <= kSweepSteps && least > 0; ++i) {
    const double back = settings_.pregrasp * i / kSweepSteps;
    least = clearance_(Eigen::Translation3d(-back * approach_W) * X_WH, preshape, obstacles, least);
  }
  return std::max(least, 0.0);
}

void ReachScorer::score(const GraspTable& table, const ReachArm& arm, const Eigen::Isometry3d& X_WO,
                        const std::vector<ObstacleDistance>& obstacles, const ScoreCoefficients& coefficients,
                        std::vector<GraspScore>& scores) const {
  if (table.grasps.empty()) return;
  const double best = table.grasps.front().epsilon;
  const double sum = std::max(coefficients.c1 + coefficients.c3, 1e-9);
  const std::size_t first = scores.size();
  std::vector<Eigen::VectorXd> atGrasp, before;
  const auto reached = [&](const StoredGrasp& grasp) {
    return isReached(tipPoses(grasp, arm, X_WO, settings_.pregrasp), arm, atGrasp, before);
  };
  const bool exact = arm.ik->isClosedForm();
  for (std::size_t i = 0; i < table.grasps.size(); ++i) {
    const StoredGrasp& grasp = table.grasps[i];
    GraspScore score;
    score.arm = arm.arm;
    score.grasp = static_cast<std::uint32_t>(i);
    score.gq = static_cast<float>(grasp.epsilon / best);
    score.gb = exact ? (reached(grasp) ? 1.0f : 0.0f) : 0.5f;
    if (score.gb > 0) score.ge = static_cast<float>(sweptClearance(grasp, X_WO, obstacles) / settings_.far);
    scores.push_back(score);
  }
  const auto others = [&](const GraspScore& s) { return (coefficients.c1 * s.gq + coefficients.c3 * s.ge) / sum; };
  if (!exact) {
    std::vector<std::size_t> order(table.grasps.size());
    std::iota(order.begin(), order.end(), first);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return (scores[a].ge > 0 ? others(scores[a]) : -1) > (scores[b].ge > 0 ? others(scores[b]) : -1);
    });
    for (std::size_t i = 0; i < std::min<std::size_t>(order.size(), settings_.numericChecks); ++i) {
      GraspScore& score = scores[order[i]];
      if (score.ge > 0) score.gb = reached(table.grasps[score.grasp]) ? 1.0f : 0.0f;
    }
  }
  for (std::size_t i = first; i < scores.size(); ++i) {
    GraspScore& score = scores[i];
    score.score = score.ge > 0 ? 4 * score.gb + others(score) : score.gq / 1000;
  }
}

}  // namespace handhold
