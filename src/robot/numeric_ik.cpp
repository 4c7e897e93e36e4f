#include "core/random.h"
#include "robot/closed_form_ik.h"
#include "robot/inverse_kinematics.h"
#include "robot/newton.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace handhold {
namespace {

constexpr std::uint64_t kSeedStream = 0x696b;  // key of the restarts
constexpr std::size_t kEnough = 8;             // solutions: as many as an arm of six joints mostly has at most

class Numeric : public InverseKinematics {
 public:
  Numeric(const ArmChain& chain, const IkSettings& settings) : chain_(chain), settings_(settings) {}

  bool isClosedForm() const override { return false; }

  void solve(const Eigen::Isometry3d& X_AT, const Eigen::VectorXd& near,
             std::vector<Eigen::VectorXd>& solutions) const override {
    solutions.clear();
    Eigen::VectorXd q(chain_.size());
    for (int seed = 0; seed <= settings_.restarts && solutions.size() < kEnough; ++seed) {
      start(seed, near, q);
      if (!convergeTip(chain_, X_AT, settings_, settings_.iterations, q)) continue;
      for (Eigen::Index i = 0; i < chain_.size(); ++i) q[i] = nearestTurn(chain_.steps[i], q[i], near[i]);
      const bool isNew = std::none_of(solutions.begin(), solutions.end(), [&](const Eigen::VectorXd& other) {
        return (other - q).lpNorm<Eigen::Infinity>() < kDistinct;
      });
      if (isNew) solutions.push_back(q);
    }
    sortNearestFirst(near, solutions);
  }

 private:
  /// Seed 0 is `near`; the others are uniform within the limits.
  void start(int seed, const Eigen::VectorXd& near, Eigen::VectorXd& q) const {
    const RandomStream stream = RandomStream(kSeedStream).child(static_cast<std::uint64_t>(seed));
    for (Eigen::Index i = 0; i < chain_.size(); ++i) {
      const ArmChain::Step& step = chain_.steps[i];
      double lower = step.lower, upper = step.upper;
      if (!std::isfinite(upper - lower)) {
        lower = near[i] - std::numbers::pi;
        upper = near[i] + std::numbers::pi;
      }
      const double share = stream.uniform(static_cast<std::uint64_t>(i));
      q[i] = seed == 0 ? std::clamp(near[i], step.lower, step.upper) : lower + (upper - lower) * share;
    }
  }

  /// A joint that may turn by whole turns does so, within its limits, to come near.
  static double nearestTurn(const ArmChain::Step& step, double q, double near) {
    constexpr double kTurn = 2 * std::numbers::pi;
    if (step.type != JointType::revolute) return q;
    double turns = std::round((near - q) / kTurn);
    while (turns != 0 && !(q + turns * kTurn >= step.lower && q + turns * kTurn <= step.upper)) {
      turns -= std::copysign(1.0, turns);
    }
    return q + turns * kTurn;
  }

  ArmChain chain_;
  IkSettings settings_;
};

}  // namespace

std::unique_ptr<InverseKinematics> makeNumericInverseKinematics(const ArmChain& chain, const IkSettings& settings) {
  return std::make_unique<Numeric>(chain, settings);
}

std::unique_ptr<InverseKinematics> makeInverseKinematics(const ArmChain& chain, const IkSettings& settings) {
  if (auto closedForm = makeClosedFormInverseKinematics(chain, settings)) return closedForm;
  return makeNumericInverseKinematics(chain, settings);
}

}  // namespace handhold
