#include "robot/inverse_kinematics.h"

#include "core/random.h"
#include "robot/robot.h"
#include "robot/robot_files.h"
#include "support/random_contacts.h"
#include "support/sanitized.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Solutions = std::vector<VectorXd>;
using testing::kRobots;
using testing::randomPosture;

constexpr double kPi = std::numbers::pi;
constexpr double kDistinct = 1e-4;  // as the header says
constexpr int kPoses = testing::kSanitized ? 300 : 10000;

ArmChain chainOf(const std::string& name, int arm = 0) { return makeChain(loadRobot(kRobots + name), arm); }

double distance(const VectorXd& a, const VectorXd& b) { return (a - b).lpNorm<Eigen::Infinity>(); }

bool contains(const Solutions& solutions, const VectorXd& q) {
  return std::any_of(solutions.begin(), solutions.end(), [&](const VectorXd& s) { return distance(s, q) < kDistinct; });
}

/// What every answer must be: within limits, at the pose, distinct, nearest first.
void expectGood(const ArmChain& chain, const Isometry3d& X, const VectorXd& near, const Solutions& solutions) {
  const IkSettings settings;
  for (std::size_t k = 0; k < solutions.size(); ++k) {
    const VectorXd& q = solutions[k];
    for (Eigen::Index i = 0; i < chain.size(); ++i) {
      EXPECT_GE(q[i], chain.steps[i].lower);
      EXPECT_LE(q[i], chain.steps[i].upper);
    }
    const Isometry3d Y = tipPose(chain, q);
    EXPECT_LE((Y.translation() - X.translation()).norm(), settings.linearTolerance);
    EXPECT_LE(Eigen::AngleAxisd(Y.linear().transpose() * X.linear()).angle(), 1.1 * settings.angularTolerance);
    EXPECT_GE(distance(q, near), distance(solutions[k == 0 ? 0 : k - 1], near));
    for (std::size_t other = 0; other < k; ++other) EXPECT_GE(distance(q, solutions[other]), kDistinct);
  }
}

/// Answers random reachable poses; returns the shares answered, and answered with the posture asked from among them.
std::pair<double, double> roundTrips(const ArmChain& chain, const InverseKinematics& ik, int poses,
                                     Eigen::Index sameLeading = 0) {
  int found = 0, among = 0;
  Solutions solutions;
  for (int seed = 0; seed < poses; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const VectorXd q = randomPosture(chain, seed);
    VectorXd near = randomPosture(chain, seed, 1);
    near.head(sameLeading) = q.head(sameLeading);
    const Isometry3d X = tipPose(chain, q);
    ik.solve(X, near, solutions);
    expectGood(chain, X, near, solutions);
    found += solutions.empty() ? 0 : 1;
    among += contains(solutions, q) ? 1 : 0;
    if (::testing::Test::HasFailure()) break;
  }
  return {static_cast<double>(found) / poses, static_cast<double>(among) / poses};
}

TEST(ClosedForm, PumaFindsEveryPosture) {
  const ArmChain chain = chainOf("puma560");
  const auto ik = makeInverseKinematics(chain);
  EXPECT_TRUE(ik->isClosedForm());
  const auto [found, among] = roundTrips(chain, *ik, kPoses);
  EXPECT_EQ(found, 1);
  EXPECT_EQ(among, 1);
}

// Where the elbow is almost straight or the shoulder almost singular, the other joints of the posture asked from are
// lost in rounding: a few in a hundred thousand.
TEST(ClosedForm, Hrp2FindsEveryPosture) {
  for (int arm = 0; arm < 2; ++arm) {
    const ArmChain chain = chainOf("hrp2", arm);
    const auto ik = makeInverseKinematics(chain);
    EXPECT_TRUE(ik->isClosedForm());
    const auto [found, among] = roundTrips(chain, *ik, kPoses);
    EXPECT_EQ(found, 1);
    EXPECT_GE(among, 0.999);
  }
}

// The chest joints are sampled, but those of the present posture come first.
TEST(ClosedForm, LeadingJointsOfThePresentPostureAreTried) {
  for (int arm = 0; arm < 2; ++arm) {
    const ArmChain chain = chainOf("hrp2/chest.yaml", arm);
    const auto ik = makeInverseKinematics(chain);
    EXPECT_TRUE(ik->isClosedForm());
    const auto [found, among] = roundTrips(chain, *ik, kPoses / 10, 2);
    EXPECT_EQ(found, 1);
    EXPECT_GE(among, 0.999);
  }
}

TEST(ClosedForm, LeadingJointsAreSampled) {
  constexpr int kSampledPoses = 300;
  const ArmChain chain = chainOf("hrp2/chest.yaml");
  const double coarse = roundTrips(chain, *makeInverseKinematics(chain, {.leadingSteps = 3}), kSampledPoses).first;
  const double fine = roundTrips(chain, *makeInverseKinematics(chain), kSampledPoses).first;
  EXPECT_GT(fine, coarse);
  EXPECT_GT(fine, 0.9);
}

TEST(Numeric, AnswersPumaAndPanda) {
  for (const std::string name : {"puma560", "panda"}) {
    SCOPED_TRACE(name);
    const ArmChain chain = chainOf(name);
    const auto ik = makeNumericInverseKinematics(chain);
    EXPECT_FALSE(ik->isClosedForm());
    EXPECT_GE(roundTrips(chain, *ik, kPoses).first, 0.995);
  }
  EXPECT_FALSE(makeInverseKinematics(chainOf("panda"))->isClosedForm());
}

TEST(Numeric, AgreesWithTheClosedForm) {
  const ArmChain chain = chainOf("hrp2");
  const auto closed = makeInverseKinematics(chain), numeric = makeNumericInverseKinematics(chain);
  Solutions all, some;
  int compared = 0;
  for (int seed = 0; seed < kPoses / 20; ++seed) {
    const VectorXd near = randomPosture(chain, seed, 1), q = randomPosture(chain, seed);
    // Near a singularity a small residual leaves the joints wide room.
    if (std::abs(q[3]) < 0.2 || std::abs(std::abs(q[1]) - kPi / 2) < 0.2) continue;
    ++compared;
    const Isometry3d X = tipPose(chain, q);
    closed->solve(X, near, all);
    numeric->solve(X, near, some);
    for (const VectorXd& s : some) EXPECT_TRUE(contains(all, s)) << "seed " << seed << ": " << s.transpose();
  }
  EXPECT_GT(compared, kPoses / 40);
}

// Chains of every kind that README.md lists, with random axes.

ArmChain::Step step(const Vector3d& origin, const Vector3d& axis, double limit = 2.5) {
  return {JointType::revolute, Isometry3d(Eigen::Translation3d(origin)), axis.normalized(), -limit, limit};
}

Vector3d unit(const RandomStream& stream, std::uint64_t item) { return testing::randomUnitVector(stream, 2 * item); }

Vector3d offset(const RandomStream& stream, std::uint64_t item) {
  return (0.2 + 0.3 * stream.uniform(500 + item)) * unit(stream, 20 + item);
}

/// Six joints whose last three axes meet; `shape` 0: 2 and 3 parallel, 1: 1 and 2, 2: 1 and 2 meet, 3: 2 and 3 meet.
ArmChain sphericalWrist(int shape, std::uint64_t seed) {
  const RandomStream stream(seed);
  const Vector3d a = unit(stream, 0), b = unit(stream, 1), c = unit(stream, 2);
  ArmChain chain;
  chain.steps.push_back(step(offset(stream, 0), a));
  chain.steps.push_back(step(shape == 2 ? Vector3d::Zero() : offset(stream, 1), shape == 1 ? a : b));
  chain.steps.push_back(step(shape == 3 ? Vector3d::Zero() : offset(stream, 2), shape == 0 ? b : c));
  chain.steps.push_back(step(offset(stream, 3), unit(stream, 3)));
  chain.steps.push_back(step(Vector3d::Zero(), unit(stream, 4)));
  chain.steps.push_back(step(Vector3d::Zero(), unit(stream, 5)));
  chain.X_tip.translation() = offset(stream, 4);
  chain.X_tip.rotate(Eigen::AngleAxisd(0.7, unit(stream, 6)));
  return chain;
}

/// The same joints from tip to base: three axes meet at the shoulder.
ArmChain reversed(const ArmChain& chain) {
  ArmChain result;
  for (std::size_t i = 0; i < 6; ++i) {
    ArmChain::Step back = chain.steps[5 - i];
    back.X = (i == 0 ? chain.X_tip : chain.steps[6 - i].X).inverse();
    back.axis = -back.axis;
    result.steps.push_back(back);
  }
  result.X_tip = chain.steps[0].X.inverse();
  return result;
}

TEST(ClosedForm, EveryShapeWithRandomAxes) {
  const int robots = testing::kSanitized ? 3 : 20;
  for (int shape = 0; shape < 4; ++shape) {
    double asked = 0;
    for (int seed = 0; seed < robots; ++seed) {
      for (const bool back : {false, true}) {
        SCOPED_TRACE(fmt::format("shape {}, robot {}{}", shape, seed, back ? ", reversed" : ""));
        const ArmChain wrist = sphericalWrist(shape, seed);
        const ArmChain chain = back ? reversed(wrist) : wrist;
        const auto ik = makeInverseKinematics(chain);
        ASSERT_TRUE(ik->isClosedForm());
        const auto [found, among] = roundTrips(chain, *ik, 200);
        EXPECT_EQ(found, 1);
        asked += among / (2 * robots);
      }
    }
    EXPECT_GE(asked, 0.999) << "shape " << shape;
  }
}

TEST(ClosedForm, SixAxesThatMeetNowhereHaveNone) {
  ArmChain chain = sphericalWrist(0, 1);
  chain.steps[5].X.translation() = Vector3d(0.05, 0.03, 0.02);
  EXPECT_FALSE(makeInverseKinematics(chain)->isClosedForm());
  chain = sphericalWrist(0, 1);
  chain.steps[1].type = JointType::prismatic;
  EXPECT_FALSE(makeInverseKinematics(chain)->isClosedForm());
  chain.steps.pop_back();
  EXPECT_FALSE(makeInverseKinematics(chain)->isClosedForm());
}

// A URDF with rounded numbers: axes that meet and are parallel only to five decimals.
TEST(ClosedForm, RoundedNumbersArePolished) {
  ArmChain chain = chainOf("puma560");
  for (std::size_t i = 0; i < chain.steps.size(); ++i) {
    const RandomStream stream(i);
    chain.steps[i].axis = (chain.steps[i].axis + 1e-5 * unit(stream, 0)).normalized();
    chain.steps[i].X.translation() += 1e-5 * unit(stream, 1);
  }
  const auto ik = makeInverseKinematics(chain);
  ASSERT_TRUE(ik->isClosedForm());
  EXPECT_EQ(roundTrips(chain, *ik, kPoses / 10).first, 1);
}

TEST(ClosedForm, ARailInFrontOfTheArm) {
  ArmChain chain = chainOf("puma560");
  chain.steps.insert(chain.steps.begin(), {JointType::prismatic, Isometry3d::Identity(), Vector3d::UnitY(), -1, 1});
  const auto ik = makeInverseKinematics(chain);
  EXPECT_TRUE(ik->isClosedForm());
  EXPECT_EQ(roundTrips(chain, *ik, kPoses / 20, 1), std::pair(1.0, 1.0));
  EXPECT_GE(roundTrips(chain, *ik, kPoses / 20).first, 0.95);
}

// Joints without limits answer once for each angle, as near as they can.
TEST(ClosedForm, ContinuousJointsStayNear) {
  ArmChain chain = chainOf("puma560");
  for (const int i : {3, 5}) {
    chain.steps[i].lower = -std::numeric_limits<double>::infinity();
    chain.steps[i].upper = std::numeric_limits<double>::infinity();
  }
  const auto ik = makeInverseKinematics(chain);
  for (int seed = 0; seed < 100; ++seed) {
    VectorXd near = randomPosture(chain, seed);
    near[3] += 8 * kPi;
    near[5] -= 6 * kPi;
    const Isometry3d X = tipPose(chain, near);
    Solutions solutions;
    ik->solve(X, near, solutions);
    expectGood(chain, X, near, solutions);
    ASSERT_FALSE(solutions.empty());
    EXPECT_LT(distance(solutions[0], near), kDistinct);
    for (const VectorXd& q : solutions) EXPECT_LE(std::abs(q[3] - near[3]), kPi + kDistinct);
  }
}

// Joints with more than a turn answer with each position that stands for an angle.
TEST(ClosedForm, EveryTurnWithinTheLimits) {
  const ArmChain chain = chainOf("puma560");
  VectorXd q(6);
  q << 0.3, 0.8, -2.5, 2.5, 0.6, -2.4;  // joints 4 and 6 reach 4.64 rad either way
  Solutions solutions;
  makeInverseKinematics(chain)->solve(tipPose(chain, q), q, solutions);
  for (const double turn4 : {0.0, -2 * kPi}) {
    for (const double turn6 : {0.0, 2 * kPi}) {
      VectorXd other = q;
      other[3] += turn4;
      other[5] += turn6;
      EXPECT_TRUE(contains(solutions, other)) << other.transpose();
    }
  }
}

// With all limits open a Puma has eight ways to a pose inside its reach.
TEST(ClosedForm, PumaHasEightWays) {
  ArmChain chain = chainOf("puma560");
  for (ArmChain::Step& s : chain.steps) {
    s.lower = -kPi;
    s.upper = kPi - 1e-6;
  }
  VectorXd q(6);
  q << 0.3, 0.8, -2.5, 0.4, 0.6, -0.4;
  Solutions solutions;
  makeInverseKinematics(chain)->solve(tipPose(chain, q), q, solutions);
  EXPECT_EQ(solutions.size(), 8u);
  EXPECT_LT(distance(solutions[0], q), kDistinct);
}

struct Singular {
  std::string robot, name;
  std::vector<double> q;
};

class SingularTest : public ::testing::TestWithParam<Singular> {};

// At a singular pose the present posture is an answer, and it comes first; another one answers as well, though the pose
// be rounded.
TEST_P(SingularTest, ThePresentPostureIsFirst) {
  const ArmChain chain = chainOf(GetParam().robot);
  const VectorXd q = Eigen::Map<const VectorXd>(GetParam().q.data(), 6);
  const Isometry3d X = tipPose(chain, q);
  const auto ik = makeInverseKinematics(chain);
  Solutions solutions;
  ik->solve(X, q, solutions);
  ASSERT_FALSE(solutions.empty());
  EXPECT_LT(distance(solutions[0], q), kDistinct);
  expectGood(chain, X, q, solutions);
  for (int seed = 0; seed < 100; ++seed) {
    const VectorXd near = randomPosture(chain, seed, 1);
    for (const double rounding : {0.0, 1e-8, 1e-7}) {
      SCOPED_TRACE(fmt::format("seed {}, rounding {}", seed, rounding));
      Isometry3d Y = X;
      Y.translation() += rounding * testing::randomUnitVector(RandomStream(seed), 0);
      Y.rotate(Eigen::AngleAxisd(rounding, testing::randomUnitVector(RandomStream(seed), 2)));
      ik->solve(Y, near, solutions);
      EXPECT_FALSE(solutions.empty());
      expectGood(chain, Y, near, solutions);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Robots, SingularTest,
    ::testing::Values(Singular{"puma560", "wrist_straight", {0.4, 0.7, -2.2, 1.1, 0, -0.6}},
                      Singular{"puma560", "elbow_straight", {0.4, 0.7, -1.5707963267948966 + 0.046978, 0.3, 0.8, -0.6}},
                      Singular{
                          "puma560", "wrist_above_shoulder", {0.4, 1.5707963267948966, -1.5707963267948966, 0, 0, 0}},
                      Singular{"puma560", "all_zero", {0, 0, 0, 0, 0, 0}},
                      Singular{"hrp2", "hanging_straight", {0, 0, 0, 0, 0, 0}},
                      Singular{"hrp2", "hanging_yawed", {0, 0, 0.5, 0, -0.3, 0.4}},
                      Singular{"hrp2", "raised_sideways", {0.2, -1.5707963267948966, 0.4, -0.8, 0.3, 0.2}},
                      Singular{"hrp2", "wrist_quarter", {0.3, -0.3, 0.2, -1, 0.3, -1.5707963267948966}}),
    [](const auto& test) { return test.param.robot + "_" + test.param.name; });

// The Puma's shoulder is singular where the wrist lies as near to the first axis as it can.
TEST(ClosedForm, PumaShoulderSingular) {
  const ArmChain chain = chainOf("puma560");
  // The wrist's distance in the plane of the arm, 0.4318 (cos q2 + ...), vanishes at this q3 for the q2 chosen.
  VectorXd q(6);
  q << 0.5, 1.2, 0, 0.4, 0.7, -0.9;
  const auto radial = [&](double q3) {
    return 0.4318 * std::cos(q[1]) + 0.0203 * std::cos(q[1] + q3) - 0.4318 * std::sin(q[1] + q3);
  };
  double low = -2, high = 0;  // the sign changes once
  ASSERT_LT(radial(low) * radial(high), 0);
  for (int i = 0; i < 200; ++i) (radial((low + high) / 2) * radial(low) > 0 ? low : high) = (low + high) / 2;
  q[2] = low;
  ASSERT_NEAR(radial(q[2]), 0, 1e-9);
  const Isometry3d X = tipPose(chain, q);
  Solutions solutions;
  makeInverseKinematics(chain)->solve(X, q, solutions);
  ASSERT_FALSE(solutions.empty());
  EXPECT_LT(distance(solutions[0], q), kDistinct);
  expectGood(chain, X, q, solutions);
}

TEST(InverseKinematics, UnreachablePosesHaveNoAnswer) {
  for (const std::string name : {"puma560", "hrp2", "hrp2/chest.yaml", "panda"}) {
    const ArmChain chain = chainOf(name);
    Isometry3d X = Isometry3d::Identity();
    X.translation() = Vector3d(3, 0, 0.5);
    for (const auto& ik : {makeInverseKinematics(chain).release(), makeNumericInverseKinematics(chain).release()}) {
      const std::unique_ptr<InverseKinematics> owner(ik);
      Solutions solutions(1, VectorXd::Zero(chain.size()));  // what was there is gone
      ik->solve(X, VectorXd::Zero(chain.size()), solutions);
      EXPECT_TRUE(solutions.empty()) << name;
    }
  }
}

// A pose a hair out of reach, but within the tolerances, still is answered; one beyond them is not.
TEST(ClosedForm, TheEdgeOfReach) {
  const ArmChain chain = chainOf("hrp2");
  const VectorXd hanging = VectorXd::Zero(6);
  const auto ik = makeInverseKinematics(chain);
  Solutions solutions;
  Isometry3d X = tipPose(chain, hanging);
  X.translation().z() -= 5e-7;
  ik->solve(X, hanging, solutions);
  EXPECT_FALSE(solutions.empty());
  expectGood(chain, X, hanging, solutions);
  X.translation().z() -= 1e-5;
  ik->solve(X, hanging, solutions);
  EXPECT_TRUE(solutions.empty());
}

TEST(InverseKinematics, EqualQuestionsGiveEqualAnswers) {
  for (const std::string name : {"puma560", "panda"}) {
    const ArmChain chain = chainOf(name);
    const auto first = makeInverseKinematics(chain), second = makeInverseKinematics(chain);
    Solutions a, b;
    for (int seed = 0; seed < 50; ++seed) {
      const Isometry3d X = tipPose(chain, randomPosture(chain, seed));
      const VectorXd near = randomPosture(chain, seed, 1);
      first->solve(X, near, a);
      second->solve(tipPose(chain, near), near, b);  // another question in between
      second->solve(X, near, b);
      EXPECT_EQ(a, b);
    }
  }
}

TEST(Numeric, APrismaticChain) {
  ArmChain chain;
  for (int i = 0; i < 3; ++i) {
    chain.steps.push_back({JointType::prismatic, Isometry3d::Identity(), Vector3d::Unit(i), -0.5, 0.5});
  }
  for (int i = 0; i < 3; ++i) chain.steps.push_back(step(Vector3d::Zero(), Vector3d::Unit(i), 1.2));
  const auto ik = makeInverseKinematics(chain);
  EXPECT_FALSE(ik->isClosedForm());
  EXPECT_EQ(roundTrips(chain, *ik, kPoses / 20), std::pair(1.0, 1.0));
}

TEST(FollowTip, StaysNear) {
  for (const std::string name : {"puma560", "panda", "hrp2/chest.yaml"}) {
    SCOPED_TRACE(name);
    const ArmChain chain = chainOf(name);
    int followed = 0;
    for (int seed = 0; seed < 1000; ++seed) {
      const VectorXd from = 0.9 * randomPosture(chain, seed);  // off the limits
      VectorXd to = from;
      for (Eigen::Index i = 0; i < to.size(); ++i) {
        to[i] += 0.02 * (RandomStream(seed).child(2).uniform(static_cast<std::uint64_t>(i)) - 0.5);
        to[i] = std::clamp(to[i], chain.steps[i].lower, chain.steps[i].upper);
      }
      const Isometry3d X = tipPose(chain, to);
      VectorXd q = from;
      if (!followTip(chain, X, 0.1, {}, q)) {
        EXPECT_EQ(q, from) << "left alone";
        continue;
      }
      ++followed;
      EXPECT_LE(distance(q, from), 0.1);
      expectGood(chain, X, q, {q});
    }
    EXPECT_GE(followed, 950) << "the rest is close to singular";
  }
}

TEST(FollowTip, RefusesALeap) {
  const ArmChain chain = chainOf("puma560");
  VectorXd from(6), q(6);
  from << 0.3, 0.8, -2.5, 0.4, 0.6, -0.4;
  q = from;
  VectorXd to = from;
  to[0] += 0.3;
  EXPECT_FALSE(followTip(chain, tipPose(chain, to), 0.1, {}, q));
  EXPECT_EQ(q, from);
  EXPECT_TRUE(followTip(chain, tipPose(chain, to), 0.4, {}, q));
  EXPECT_LT(distance(q, to), kDistinct);
  // A limit stands in the way.
  q = from;
  q[0] = chain.steps[0].upper;
  to = q;
  to[0] += 0.01;
  EXPECT_FALSE(followTip(chain, tipPose(chain, to), 0.1, {}, q));
}

}  // namespace
}  // namespace handhold
