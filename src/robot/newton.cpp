#include "robot/newton.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace handhold {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// What is missing to the wanted pose: translation [m], then the rotation vector [rad], both in A.
Vector6d missing(const Eigen::Isometry3d& wanted, const Eigen::Isometry3d& X) {
  Vector6d e;
  e.head<3>() = wanted.translation() - X.translation();
  const Eigen::Quaterniond turn(wanted.linear() * X.linear().transpose());
  const double sine = turn.vec().norm();
  const double angle = 2 * std::atan2(turn.w() < 0 ? -sine : sine, std::abs(turn.w()));
  e.tail<3>() = sine > 0 ? Eigen::Vector3d(turn.vec() * (angle / sine)) : Eigen::Vector3d::Zero();
  return e;
}

bool isWithin(const Vector6d& e, const IkSettings& settings, double share) {
  return e.head<3>().norm() <= share * settings.linearTolerance &&
         e.tail<3>().norm() <= share * settings.angularTolerance;
}

/// One step: joints that would leave their limits are held there, and the others step without them.
void dampedStep(const ArmChain& chain, const Vector6d& e, Eigen::Matrix<double, 6, Eigen::Dynamic>& J,
                Eigen::VectorXd& q, Eigen::VectorXd& dq) {
  constexpr double kDamping = 0.02;   // of the squared residual
  constexpr double kLeast = 1e-12;    // keeps (8) solvable where the arm is singular
  constexpr double kLargestStep = 1;  // rad or m
  for (Eigen::Index round = 0; round <= chain.size(); ++round) {
    Matrix6d A = J * J.transpose();
    A.diagonal().array() += kDamping * e.squaredNorm() + kLeast;
    dq.noalias() = J.transpose() * A.ldlt().solve(e);
    bool held = false;
    for (Eigen::Index i = 0; i < chain.size(); ++i) {
      const ArmChain::Step& step = chain.steps[i];
      const bool outward = (q[i] >= step.upper && dq[i] > 0) || (q[i] <= step.lower && dq[i] < 0);
      if (!outward) continue;
      J.col(i).setZero();
      held = true;
    }
    if (!held) break;
  }
  dq *= std::min(1.0, kLargestStep / std::max(dq.cwiseAbs().maxCoeff(), 1e-300));
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    q[i] = std::clamp(q[i] + dq[i], chain.steps[i].lower, chain.steps[i].upper);
  }
}

}  // namespace

bool convergeTip(const ArmChain& chain, const Eigen::Isometry3d& X_AT, const IkSettings& settings, int iterations,
                 Eigen::VectorXd& q) {
  constexpr double kGoal = 1e-3;   // of the tolerance: the last step, which converges fast, is worth its time
  constexpr int kPatience = 8;     // steps that a seed may take
  constexpr double kEnough = 0.7;  // to bring the residual down to this share
  Eigen::Matrix<double, 6, Eigen::Dynamic> J(6, chain.size());
  Eigen::VectorXd dq(chain.size()), accepted(chain.size());
  double acceptedSize = std::numeric_limits<double>::infinity(), mark = acceptedSize;
  int sinceMark = 0;
  for (int k = 0;; ++k) {
    const Vector6d e = missing(X_AT, tipPose(chain, q, J));
    if (isWithin(e, settings, kGoal)) return true;
    const double size = e.norm();
    // Where the arm is singular a step may lead away from what was good enough.
    const bool better = size < acceptedSize && isWithin(e, settings, 1);
    if (better) {
      acceptedSize = size;
      accepted = q;
    }
    sinceMark = size < kEnough * mark ? 0 : sinceMark + 1;
    if (sinceMark == 0) mark = size;
    const bool isAccepted = std::isfinite(acceptedSize);
    if (k >= iterations || sinceMark > kPatience || (isAccepted && !better)) {
      if (isAccepted) q = accepted;
      return isAccepted;
    }
    dampedStep(chain, e, J, q, dq);
  }
}

void sortNearestFirst(const Eigen::VectorXd& near, std::vector<Eigen::VectorXd>& solutions) {
  std::vector<std::pair<double, std::size_t>> order;  // equally near ones keep theirs
  order.reserve(solutions.size());
  for (std::size_t i = 0; i < solutions.size(); ++i) {
    order.emplace_back((solutions[i] - near).lpNorm<Eigen::Infinity>(), i);
  }
  std::sort(order.begin(), order.end());
  std::vector<Eigen::VectorXd> sorted;
  sorted.reserve(solutions.size());
  for (const auto& [distance, i] : order) sorted.push_back(std::move(solutions[i]));
  solutions = std::move(sorted);
}

bool followTip(const ArmChain& chain, const Eigen::Isometry3d& X_AT, double maxStep, const IkSettings& settings,
               Eigen::VectorXd& q) {
  constexpr int kSteps = 20;  // a small motion takes three
  Eigen::VectorXd followed = q;
  if (!convergeTip(chain, X_AT, settings, std::min(kSteps, settings.iterations), followed)) return false;
  if ((followed - q).lpNorm<Eigen::Infinity>() > maxStep) return false;
  q = followed;
  return true;
}

}  // namespace handhold
