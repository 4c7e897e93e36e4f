#include "simulate/centering.h"

#include <algorithm>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kFirstStep = 0.001;  // m, doubled until the other side touches first
constexpr double kFarthest = 0.2;     // m
constexpr double kTogether = 5e-6;    // m, of the hand's place: far below the distance of a contact

class CenteringPolicy : public GraspPolicy {
 public:
  CenteringPolicy(const Hand& hand, std::vector<int> sides, std::unique_ptr<GraspPolicy> policy)
      : hand_(hand), sides_(std::move(sides)), policy_(std::move(policy)) {}

  std::unique_ptr<GraspPolicy> clone() const override {
    return std::make_unique<CenteringPolicy>(hand_, sides_, policy_->clone());
  }

  void run(const GraspCandidate& candidate, GraspTrial& trial) override {
    policy_->run(candidate, trial);
    center(candidate.preshape, trial);
  }

  bool closeAt(const Eigen::Isometry3d& X_OH, int preshape, GraspTrial& trial) override {
    if (!policy_->closeAt(X_OH, preshape, trial)) return false;
    center(preshape, trial);
    return true;
  }

  void touchAt(const Eigen::Isometry3d& X_OH, const Eigen::VectorXd& jointPosition, GraspTrial& trial) override {
    policy_->touchAt(X_OH, jointPosition, trial);
  }
  bool approachIsClear(const GraspCandidate& candidate, const GraspTrial& trial) override {
    return policy_->approachIsClear(candidate, trial);
  }
  bool selfCollides(const GraspCandidate& candidate, const GraspTrial& trial) override {
    return policy_->selfCollides(candidate, trial);
  }

 private:
  /// The side of the links that stopped the closing; 0: none or both.
  int stoppedSide(const GraspTrial& trial) const {
    if (trial.stops.empty() || trial.stops[0].links.empty()) return 0;
    const auto sideOf = [&](int link) { return sides_[static_cast<std::size_t>(link)]; };
    const std::vector<int>& links = trial.stops[0].links;
    const int side = sideOf(links[0]);
    return std::all_of(links.begin(), links.end(), [&](int link) { return sideOf(link) == side; }) ? side : 0;
  }

  /// What stops the closing with the hand moved.
  enum class Found { sameSide, both, otherSide, nothing, blocked };
  Found look(const Eigen::Isometry3d& X_OH, int preshape, int side) {
    const bool isFree = policy_->closeAt(X_OH, preshape, attempt_);
    byReference_ = byReference_ || attempt_.byReference;
    queries_ += attempt_.collisionQueries;
    if (!isFree) return Found::blocked;
    if (attempt_.stops[0].links.empty()) return Found::nothing;
    const int found = stoppedSide(attempt_);
    return found == 0 ? Found::both : found == side ? Found::sameSide : Found::otherSide;
  }

  /// Moves the hand towards the side that touches first, in growing steps until it does not, then halves the last one.
  void center(int preshape, GraspTrial& trial) {
    const int side = stoppedSide(trial);
    if (side == 0) return;
    byReference_ = trial.byReference;
    queries_ = trial.collisionQueries;
    const std::vector<Eigen::Isometry3d> X_HL =
        forwardKinematics(hand_, hand_.preshapes[static_cast<std::size_t>(preshape)].jointPosition);
    const Eigen::Isometry3d X_HG = X_HL[static_cast<std::size_t>(hand_.palmLink)] * hand_.X_LG;
    const Vector3d axis = side * (trial.X_OH.linear() * X_HG.linear().col(0));
    const auto lookAt = [&](double way) { return look(Eigen::Translation3d(way * axis) * trial.X_OH, preshape, side); };
    double near = 0, far = kFirstStep;
    Found beyond = lookAt(far);
    while (beyond == Found::sameSide && far < kFarthest) {
      near = far;
      far *= 2;
      beyond = lookAt(far);
    }
    while (beyond != Found::sameSide && beyond != Found::both && far - near > kTogether) {
      const double middle = (near + far) / 2;
      const Found found = lookAt(middle);
      if (found == Found::sameSide) {
        near = middle;
      } else {
        far = middle;
        beyond = found;
      }
    }
    if (beyond == Found::otherSide) {  // within kTogether of it the other side touches as well
      far = near;
      beyond = lookAt(far) == Found::blocked ? Found::blocked : Found::both;
    }
    if (beyond == Found::both) {
      attempt_.backoff = trial.backoff;
      attempt_.centering = trial.centering + far * axis;
      trial = attempt_;
    } else if (beyond == Found::blocked) {
      trial.outcome = GraspOutcome::blockedCentering;
    }
    trial.byReference = byReference_;
    trial.collisionQueries = queries_;
  }

  const Hand& hand_;
  std::vector<int> sides_;  // by link
  std::unique_ptr<GraspPolicy> policy_;

  // scratch of one worker
  GraspTrial attempt_;
  bool byReference_ = false;
  int queries_ = 0;
};

}  // namespace

std::unique_ptr<GraspPolicy> centerCoupledJaws(const Hand& hand, std::unique_ptr<GraspPolicy> policy) {
  const ClosingJoint& closing = hand.closing[0];
  if (!closing.selfCentering || followersOf(hand, closing.joint).empty() || isSlidingPair(hand, closing.joint))
    return policy;
  return std::make_unique<CenteringPolicy>(hand, jawSides(hand, closing), std::move(policy));
}

}  // namespace handhold
