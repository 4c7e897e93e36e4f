#include "build/robustness.h"

#include "mesh/primitives.h"
#include "simulate/fast_policy.h"
#include "support/brute_force.h"
#include "support/random_contacts.h"
#include "support/sanitized.h"
#include "support/toy_hands.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using namespace handhold::testing;

TEST(Proportion, IsWilsonsInterval) {
  const Proportion half(5, 10), none(0, 10), all(10, 10);
  EXPECT_DOUBLE_EQ(half.share, 0.5);
  EXPECT_NEAR(half.lower, 0.2366, 5e-5);  // Wilson's formula by hand
  EXPECT_NEAR(half.upper, 0.7634, 5e-5);
  EXPECT_EQ(none.lower, 0);
  EXPECT_NEAR(none.upper, 0.2775, 5e-5);
  EXPECT_NEAR(all.lower, 0.7225, 5e-5);
  EXPECT_EQ(all.upper, 1);
  const Proportion unknown(0, 0);
  EXPECT_TRUE(std::isnan(unknown.share) && std::isnan(unknown.lower) && std::isnan(unknown.upper));
}

/// Remembers where it was put.
class RecordingPolicy final : public GraspPolicy {
 public:
  void run(const GraspCandidate&, GraspTrial&) override {}
  bool closeAt(const Isometry3d& X_OH, int, GraspTrial& trial) override {
    poses.push_back(X_OH);
    trial.outcome = GraspOutcome::tooFewContacts;
    return true;
  }
  void touchAt(const Isometry3d&, const Eigen::VectorXd&, GraspTrial&) override { FAIL() << "nothing else closes"; }
  bool approachIsClear(const GraspCandidate&, const GraspTrial&) override { return true; }
  bool selfCollides(const GraspCandidate&, const GraspTrial&) override { return false; }
  std::unique_ptr<GraspPolicy> clone() const override { return std::make_unique<RecordingPolicy>(*this); }

  std::vector<Isometry3d> poses;
};

TEST(ForceClosureUnderNoise, TurnsAboutTheCenterOfMassAndShifts) {
  constexpr int kTrials = 4000;
  const Vector3d center(0.3, -0.2, 0.1);
  const Isometry3d X_OH(Eigen::Translation3d(0.1, 0.2, 0.3) * Eigen::AngleAxisd(0.7, Vector3d::UnitY()));
  FrictionCones cones({center, 0.1, 0.4, 8});
  RecordingPolicy policy;
  forceClosureUnderNoise(policy, cones, X_OH, 0, center, {0.004, 0.03, kTrials}, RandomStream(3));
  ASSERT_EQ(policy.poses.size(), static_cast<std::size_t>(kTrials));
  Vector3d shifts = Vector3d::Zero(), turns = Vector3d::Zero();  // sums of squares
  for (const Isometry3d& pose : policy.poses) {
    const Isometry3d X = pose * X_OH.inverse();
    const Eigen::AngleAxisd turn(X.linear());
    shifts += (X * center - center).cwiseAbs2();  // the centre moves by the shift alone
    turns += (turn.angle() * turn.axis()).cwiseAbs2();
  }
  const double error = 5 * std::sqrt(0.5 / kTrials);  // of a standard deviation, relative
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(std::sqrt(shifts[k] / kTrials), 0.004, 0.004 * error);
    EXPECT_NEAR(std::sqrt(turns[k] / kTrials), 0.03, 0.03 * error);
  }
}

// A jaw around a small box: no noise, some, and more than the jaw is wide.
TEST(ForceClosureUnderNoise, FallsAsTheNoiseGrows) {
  const Hand hand = makeJaw(true);
  const ObjectModel box = boxObject({0.03, 0.03, 0.03});
  const auto policy = makeFastPolicy(makeHandFields(hand), hand, box, PolicyKind::surfaceNormal);
  GraspTrial trial;
  policy->run({Vector3d(0, 0, 0.015), -Vector3d::UnitZ(), 0, 0}, trial);
  ASSERT_EQ(trial.outcome, GraspOutcome::notForceClosed);
  const Isometry3d X_OH = Eigen::Translation3d(-trial.centering) * trial.X_OH;
  FrictionCones cones({box.mass.centerOfMass, box.mass.radius, 0.5, 8});
  const int trials = kSanitized ? 20 : 200;
  const auto at = [&](double position, double rotation, std::uint64_t key = 1) {
    return forceClosureUnderNoise(*policy, cones, X_OH, 0, box.mass.centerOfMass, {position, rotation, trials},
                                  RandomStream(key));
  };
  EXPECT_EQ(at(0, 0).share, 1);
  // Shifted a little the box still lies flat between the pads; turned, it would not.
  const Proportion small = at(2e-3, 0), large = at(3e-2, 0.5);
  EXPECT_GT(small.lower, large.upper);
  EXPECT_LT(large.share, 0.5);
  EXPECT_EQ(at(3e-2, 0.5).share, large.share);  // whoever asks, and whatever was asked before

  // The reference, on the same poses, says nearly the same.
  const auto reference = makeReferencePolicy(hand, box, PolicyKind::surfaceNormal);
  const Proportion again =
      forceClosureUnderNoise(*reference, cones, X_OH, 0, box.mass.centerOfMass, {1e-2, 0.1, trials}, RandomStream(1));
  EXPECT_NEAR(again.share, at(1e-2, 0.1).share, 0.05);
}

}  // namespace
}  // namespace handhold
