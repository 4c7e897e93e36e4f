#include "robot/chain.h"

#include "robot/robot.h"
#include "robot/robot_files.h"

#include <string>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::kRobots;
using testing::randomPosture;

constexpr double kChainTol = 1e-12;  // m: rounding of a dozen transforms

class ChainTest : public ::testing::TestWithParam<std::string> {
 protected:
  const Robot robot_ = loadRobot(kRobots + GetParam());
};

TEST_P(ChainTest, TipIsWhereTheMechanismHasIt) {
  for (std::size_t a = 0; a < robot_.arms.size(); ++a) {
    const Arm& arm = robot_.arms[a];
    const ArmChain chain = makeChain(robot_, static_cast<int>(a));
    ASSERT_EQ(chain.steps.size(), arm.joints.size());
    for (int seed = 0; seed < 100; ++seed) {
      const Eigen::VectorXd q = randomPosture(chain, seed);
      Eigen::VectorXd all = robot_.home;
      for (std::size_t i = 0; i < arm.joints.size(); ++i) all[arm.joints[i]] = q[i];
      const auto X_BL = forwardKinematics(robot_.body, all);
      const Eigen::Isometry3d expected = X_BL[arm.baseLink].inverse() * X_BL[arm.tipLink];
      EXPECT_LT((tipPose(chain, q).matrix() - expected.matrix()).cwiseAbs().maxCoeff(), kChainTol) << "seed " << seed;
    }
  }
}

TEST_P(ChainTest, JacobianIsTheDerivative) {
  constexpr double kStep = 1e-6, kDerivativeTol = 1e-8;  // central differences of motions of about a metre
  const ArmChain chain = makeChain(robot_, 0);
  for (int seed = 0; seed < 20; ++seed) {
    const Eigen::VectorXd q = randomPosture(chain, seed);
    Eigen::Matrix<double, 6, Eigen::Dynamic> J;
    const Eigen::Isometry3d X = tipPose(chain, q, J);
    EXPECT_LT((X.matrix() - tipPose(chain, q).matrix()).norm(), kChainTol);
    for (Eigen::Index i = 0; i < chain.size(); ++i) {
      Eigen::VectorXd before = q, after = q;
      before[i] -= kStep;
      after[i] += kStep;
      const Eigen::Matrix4d d = (tipPose(chain, after).matrix() - tipPose(chain, before).matrix()) / (2 * kStep);
      const Eigen::Matrix3d spin = d.topLeftCorner<3, 3>() * X.linear().transpose();
      EXPECT_LT((J.col(i).head<3>() - d.topRightCorner<3, 1>()).norm(), kDerivativeTol);
      EXPECT_LT((J.col(i).tail<3>() - Eigen::Vector3d(spin(2, 1), spin(0, 2), spin(1, 0))).norm(), kDerivativeTol);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Shipped, ChainTest, ::testing::Values("puma560", "hrp2", "hrp2/chest.yaml", "panda"),
                         [](const auto& test) {
                           return test.param.substr(0, test.param.find('/')) +
                                  (test.param.find('/') == std::string::npos ? "" : "_chest");
                         });

ArmChain::Step step(JointType type, const Eigen::Vector3d& origin, const Eigen::Vector3d& axis) {
  return {type, Eigen::Isometry3d(Eigen::Translation3d(origin)), axis, -1, 1};
}

TEST(Chain, APrismaticJointSlides) {
  ArmChain chain;
  chain.steps = {step(JointType::revolute, {0, 0, 1}, Eigen::Vector3d::UnitZ()),
                 step(JointType::prismatic, {0.5, 0, 0}, Eigen::Vector3d::UnitX())};
  Eigen::VectorXd q(2);
  q << std::acos(0.0), 0.25;  // a quarter turn: x points to y
  Eigen::Matrix<double, 6, Eigen::Dynamic> J;
  EXPECT_LT((tipPose(chain, q, J).translation() - Eigen::Vector3d(0, 0.75, 1)).norm(), kChainTol);
  Eigen::Matrix<double, 6, 2> expected;
  expected << -0.75, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0;
  EXPECT_LT((J - expected).norm(), kChainTol);
}

// Three axes that meet have their meeting point as shoulder.
TEST(Chain, TheShoulderIsWhereTheFirstAxesMeet) {
  const Robot robot = loadRobot(kRobots + "hrp2");
  for (int arm = 0; arm < 2; ++arm) {
    const double side = robot.arms[arm].name == "right" ? -1 : 1;
    EXPECT_LT((shoulderPoint(makeChain(robot, arm)) - Eigen::Vector3d(0.008, side * 0.25, 0.181)).norm(), kChainTol);
  }
}

TEST(Chain, AChestCarriesTheShoulder) {
  const Robot robot = loadRobot(kRobots + "hrp2/chest.yaml");
  const Eigen::Vector3d chest(0.032, 0, 0.3477);
  EXPECT_LT(
      (shoulderPoint(makeChain(robot, findArm(robot, "right"))) - chest - Eigen::Vector3d(0.008, -0.25, 0.181)).norm(),
      kChainTol);
}

TEST(Chain, TheShoulderOfThePumaIsOnItsColumn) {
  const Eigen::Vector3d p = shoulderPoint(makeChain(loadRobot(kRobots + "puma560"), 0));
  EXPECT_LT(p.head<2>().norm(), kChainTol);
  EXPECT_GT(p.z(), 0.6);
}

// Parallel axes leave the point free along them: it stays in the middle of the joints.
TEST(Chain, TheShoulderOfParallelAxes) {
  ArmChain chain;
  for (const double x : {0.1, 0.2, 0.3})
    chain.steps.push_back(step(JointType::revolute, {x, 0, 0.1}, Eigen::Vector3d::UnitZ()));
  // At x = 0.1, 0.3 and z = 0.1, 0.2.
  EXPECT_LT((shoulderPoint(chain) - Eigen::Vector3d(0.2, 0, 0.15)).norm(), kChainTol);
  chain.steps.resize(1);
  EXPECT_LT((shoulderPoint(chain) - Eigen::Vector3d(0.1, 0, 0.1)).norm(), kChainTol);
}

}  // namespace
}  // namespace handhold
