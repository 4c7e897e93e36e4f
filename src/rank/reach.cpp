#include "rank/reach.h"

#include <algorithm>
#include <numeric>

namespace handhold {
namespace {

constexpr double kSameBranch = 1.0;  // rad, how far a joint may turn between pre-grasp and grasp
constexpr int kSweepSteps = 3;       // between pre-grasp and grasp

/// The links that the arm's joints move, without its hand.
std::vector<bool> armLinks(const Robot& robot, const Arm& arm) {
  std::vector<bool> result = linksMovedBy(robot.body, arm.joints);
  for (const int link : arm.handLinks) result[link] = false;
  return result;
}

Eigen::VectorXd armPosture(const Arm& arm, const Eigen::VectorXd& posture) {
  Eigen::VectorXd q(static_cast<Eigen::Index>(arm.joints.size()));
  for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = posture[arm.joints[i]];
  return q;
}

}  // namespace

/// What inverse kinematics says of a grasp.
struct ReachScorer::Reached {
  float gb = 0;
  double clearance = 0;  // m, of the arm, cut at far
};

ReachScorer::ReachScorer(const Robot& robot, int arm, const ReachSettings& settings)
    : robot_(robot),
      armIndex_(arm),
      arm_(robot.arms[arm]),
      settings_(settings),
      hand_(arm_.hand, settings.spacing),
      links_(robot.body, 2 * settings.spacing, armLinks(robot, arm_)) {
  const std::vector<bool> moving = armLinks(robot, arm_);
  const auto& allowed = robot.allowedCollisions;
  for (int i = 0; i < static_cast<int>(moving.size()); ++i) {
    const Link& link = robot.body.links[i];
    const bool isOfHand = std::find(arm_.handLinks.begin(), arm_.handLinks.end(), i) != arm_.handLinks.end();
    if (moving[i] || isOfHand || link.mesh.triangles.empty()) continue;
    std::vector<bool> others = moving;
    for (int k = 0; k < static_cast<int>(others.size()); ++k) {
      const std::pair pair(std::min(i, k), std::max(i, k));
      if (std::find(allowed.begin(), allowed.end(), pair) != allowed.end()) others[k] = false;
    }
    own_.push_back({i, std::make_shared<SignedDistance>(makeMeshShape(link.mesh)),
                    LinkClearance(robot.body, settings.spacing, others)});
  }
}

double ReachScorer::armClearance(const ReachArm& arm, const Eigen::VectorXd& q,
                                 const std::vector<ObstacleDistance>& obstacles) const {
  Eigen::VectorXd posture = arm.posture;
  for (Eigen::Index i = 0; i < q.size(); ++i) posture[arm_.joints[i]] = q[i];
  const std::vector<Eigen::Isometry3d> X_BL = forwardKinematics(robot_.body, posture);
  double least = links_(arm.X_WB, X_BL, obstacles, settings_.far);
  for (const OwnObstacle& own : own_) {
    if (least <= 0) return 0;
    // Near to itself the arm always is: only what reaches in counts.
    if (own.links(arm.X_WB, X_BL, {{own.distance, arm.X_WB * X_BL[own.link]}}, settings_.far) <= 0) least = 0;
  }
  return std::max(least, 0.0);
}

double ReachScorer::sweptClearance(const StoredGrasp& grasp, const Eigen::Isometry3d& X_WO,
                                   const std::vector<ObstacleDistance>& obstacles) const {
  const Eigen::Isometry3d X_WH = X_WO * grasp.X_OH;
  const Eigen::Vector3d approach_W = X_WO.linear() * grasp.approach;
  double least = hand_(X_WH, forwardKinematics(arm_.hand, grasp.finalPosition), obstacles, settings_.far);
  const std::vector<Eigen::Isometry3d> preshape = forwardKinematics(arm_.hand, grasp.preshapePosition);
  for (int i = 0; i <= kSweepSteps && least > 0; ++i) {
    const double back = settings_.pregrasp * i / kSweepSteps;
    least = hand_(Eigen::Translation3d(-back * approach_W) * X_WH, preshape, obstacles, least);
  }
  return std::max(least, 0.0);
}

ReachScorer::Reached ReachScorer::reach(const StoredGrasp& grasp, const ReachArm& arm, const Eigen::Isometry3d& X_WO,
                                        const std::vector<ObstacleDistance>& obstacles) const {
  const Eigen::Isometry3d X_AO = arm.X_WA.inverse() * X_WO;
  const Eigen::Isometry3d X_OT = grasp.X_OH * arm_.X_TH.inverse();
  const Eigen::Isometry3d X_AT = X_AO * X_OT;
  const Eigen::Isometry3d before_AT = X_AO * Eigen::Translation3d(-settings_.pregrasp * grasp.approach) * X_OT;
  std::vector<Eigen::VectorXd> atGrasp, before;
  arm.ik->solve(X_AT, armPosture(arm_, arm.posture), atGrasp);
  Reached best;
  for (const Eigen::VectorXd& q : atGrasp) {
    arm.ik->solve(before_AT, q, before);
    const bool both = !before.empty() && (before.front() - q).cwiseAbs().maxCoeff() < kSameBranch;
    const float gb = both ? 1.0f : 0.5f;
    if (gb < best.gb) continue;
    const double clearance = armClearance(arm, q, obstacles);
    if (gb > best.gb || clearance > best.clearance) best = {gb, clearance};
    if (gb == 1 && clearance >= settings_.far) break;
  }
  return best;
}

void ReachScorer::score(const GraspTable& table, const std::vector<bool>& wayIsFree, const ReachArm& arm,
                        const Eigen::Isometry3d& X_WO, const std::vector<ObstacleDistance>& obstacles,
                        std::vector<GraspScore>& scores) const {
  if (table.grasps.empty()) return;
  const std::size_t first = scores.size();
  const bool exact = arm.ik->isClosedForm();
  for (std::size_t i = 0; i < table.grasps.size(); ++i) {
    const StoredGrasp& grasp = table.grasps[i];
    GraspScore score;
    score.arm = armIndex_;
    score.grasp = static_cast<std::uint32_t>(i);
    score.gq = static_cast<float>(grasp.quality);
    if (!wayIsFree[i]) {
      scores.push_back(score);
      continue;
    }
    const Reached reached = exact ? reach(grasp, arm, X_WO, obstacles) : Reached{0.5f, settings_.far};
    score.gb = reached.gb;
    if (score.gb > 0 && reached.clearance > 0) {
      score.ge =
          static_cast<float>(std::min(reached.clearance, sweptClearance(grasp, X_WO, obstacles)) / settings_.far);
    }
    scores.push_back(score);
  }
  const auto others = [](const GraspScore& s) { return (s.gq + 2.0 * s.ge) / 3; };
  if (!exact) {
    std::vector<std::size_t> order(table.grasps.size());
    std::iota(order.begin(), order.end(), first);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return (scores[a].ge > 0 ? others(scores[a]) : -1) > (scores[b].ge > 0 ? others(scores[b]) : -1);
    });
    for (std::size_t i = 0; i < std::min<std::size_t>(order.size(), settings_.numericChecks); ++i) {
      GraspScore& score = scores[order[i]];
      if (!(score.ge > 0)) continue;
      const Reached reached = reach(table.grasps[score.grasp], arm, X_WO, obstacles);
      score.gb = reached.gb;
      score.ge = std::min(score.ge, static_cast<float>(reached.clearance / settings_.far));
    }
  }
  for (std::size_t i = first; i < scores.size(); ++i) {
    GraspScore& score = scores[i];
    score.score = score.ge > 0 ? 4 * score.gb + others(score) : score.gq / 1000;
  }
}

}  // namespace handhold
