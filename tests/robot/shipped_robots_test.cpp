// The robots in robots/: the numbers that their READMEs state, and that they stand free of themselves.

#include "robot/chain.h"
#include "robot/robot.h"
#include "robot/robot_files.h"
#include "robot/touching_links.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::indexOf;
using testing::kRobots;

constexpr double kDegree = 3.14159265358979323846 / 180;
constexpr double kLimitTol = 2e-6;  // rad: files have six decimals
constexpr double kFileTol = 1e-9;   // m

void expectLimits(const Robot& robot, const std::string& name, double lower, double upper) {
  const Joint& joint = robot.body.joints.at(indexOf(robot.body.joints, name));
  EXPECT_NEAR(joint.lower, lower * kDegree, kLimitTol) << name;
  EXPECT_NEAR(joint.upper, upper * kDegree, kLimitTol) << name;
}

using LinkPairs = std::vector<std::pair<int, int>>;

/// Links that touch and may not, lower index first.
LinkPairs touchingAt(const Robot& robot, const VectorXd& q) {
  const TouchingLinks models(robot.body);
  const auto X_BL = forwardKinematics(robot.body, q);
  LinkPairs result;
  for (int b = 0; b < static_cast<int>(robot.body.links.size()); ++b) {
    for (int a = 0; a < b; ++a) {
      const bool allowed =
          std::binary_search(robot.allowedCollisions.begin(), robot.allowedCollisions.end(), std::pair(a, b));
      if (!allowed && models.touch(a, b, X_BL)) {
        result.emplace_back(a, b);
      }
    }
  }
  return result;
}

class ShippedRobotTest : public ::testing::TestWithParam<std::string> {
 protected:
  const Robot robot_ = loadRobot(kRobots + GetParam());
};

TEST_P(ShippedRobotTest, StandsFreeOfItselfWithEveryPreshape) {
  EXPECT_EQ(touchingAt(robot_, robot_.home), LinkPairs{});
  for (const Arm& arm : robot_.arms) {
    for (const Preshape& preshape : arm.hand.preshapes) {
      VectorXd q = robot_.home;
      for (std::size_t i = 0; i < arm.handJoints.size(); ++i) q[arm.handJoints[i]] = preshape.jointPosition[i];
      EXPECT_EQ(touchingAt(robot_, q), LinkPairs{}) << arm.name << " " << preshape.name;
    }
  }
}

// Every joint of an arm reaches both its limits: what it moves stays clear of the link before its parent.
TEST_P(ShippedRobotTest, ShapesLeaveTheJointsFree) {
  for (const Arm& arm : robot_.arms) {
    for (const int index : arm.joints) {
      const Joint& joint = robot_.body.joints[index];
      const std::pair<int, int> pair(robot_.body.links[joint.parentLink].parentLink, joint.childLink);
      for (const double limit : {joint.lower, joint.upper}) {
        VectorXd q = robot_.home;
        q[index] = limit;
        const LinkPairs touching = touchingAt(robot_, q);
        EXPECT_EQ(std::count(touching.begin(), touching.end(), pair), 0) << joint.name << " at " << limit;
      }
    }
  }
}

TEST_P(ShippedRobotTest, EveryLinkThatMovesOnAnArmHasAShape) {
  for (const Arm& arm : robot_.arms) {
    for (const int joint : arm.joints) {
      EXPECT_FALSE(robot_.body.links[robot_.body.joints[joint].childLink].mesh.triangles.empty());
      EXPECT_GT(robot_.maxVelocity[joint], 0);
      EXPECT_GT(robot_.maxAcceleration[joint], 0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, ShippedRobotTest, ::testing::Values("puma560", "hrp2", "hrp2/chest.yaml", "panda"),
                         [](const auto& test) {
                           return test.param.find('/') == std::string::npos ? test.param : std::string("hrp2_chest");
                         });

VectorXd posture(const std::vector<double>& degrees) {
  VectorXd q(static_cast<Eigen::Index>(degrees.size()));
  for (std::size_t i = 0; i < degrees.size(); ++i) q[i] = degrees[i] * kDegree;
  return q;
}

void expectTip(const ArmChain& chain, const VectorXd& q, const Vector3d& position, const Vector3d& z) {
  const Eigen::Isometry3d X = tipPose(chain, q);
  EXPECT_LT((X.translation() - position).norm(), kFileTol) << X.translation().transpose();
  EXPECT_LT((X.linear().col(2) - z).norm(), kFileTol) << X.linear().col(2).transpose();
}

// The postures that the source of the DH table names, by its lengths.
TEST(Puma560, StandsWhereItsTableSays) {
  const Robot robot = loadRobot(kRobots + "puma560");
  const ArmChain chain = makeChain(robot, 0);
  const double d1 = 0.67183, a2 = 0.4318, d3 = 0.15005, a3 = 0.0203, d4 = 0.4318, flange = 0.0558;
  expectTip(chain, posture({0, 0, 0, 0, 0, 0}), {a2 + a3, -d3, d1 + d4 + flange}, Vector3d::UnitZ());
  expectTip(chain, posture({0, 90, -90, 0, 0, 0}), {a3, -d3, d1 + a2 + d4 + flange}, Vector3d::UnitZ());  // ready
  expectTip(chain, posture({0, 0, -90, 0, 0, 0}), {a2 + d4 + flange, -d3, d1 - a3}, Vector3d::UnitX());   // stretched
  expectTip(chain, posture({90, 0, -90, 0, 0, 0}), {d3, a2 + d4 + flange, d1 - a3}, Vector3d::UnitY());
  expectLimits(robot, "joint_1", -160, 160);
  expectLimits(robot, "joint_2", -45, 225);
  expectLimits(robot, "joint_3", -225, 45);
  expectLimits(robot, "joint_4", -266, 266);
  expectLimits(robot, "joint_5", -100, 100);
  expectLimits(robot, "joint_6", -266, 266);
}

TEST(Hrp2, StandsWhereItsTableSays) {
  const Robot robot = loadRobot(kRobots + "hrp2/chest.yaml");
  for (int arm = 0; arm < 2; ++arm) {
    const double side = robot.arms[arm].name == "right" ? -1 : 1;
    const ArmChain chain = makeChain(robot, arm);
    const Vector3d shoulder(0.032 + 0.008, side * 0.25, 0.3477 + 0.181);
    expectTip(chain, posture({0, 0, 0, 0, 0, 0, 0, 0}), shoulder - Vector3d(0, 0, 0.5), Vector3d::UnitZ());
    // Elbow at a right angle: the forearm points forward.
    expectTip(chain, posture({0, 0, 0, 0, 0, -90, 0, 0}), shoulder + Vector3d(0.25, 0, -0.25), -Vector3d::UnitX());
    // The palm leaves the wrist down the hanging arm, the jaw in front.
    EXPECT_LT((robot.arms[arm].X_TH.linear() * Vector3d::UnitZ() + Vector3d::UnitZ()).norm(), kFileTol);
    EXPECT_LT((robot.arms[arm].X_TH.linear() * Vector3d::UnitX() + Vector3d::UnitX()).norm(), kFileTol);
  }
  expectLimits(robot, "CHEST_JOINT1", -5, 60);
  expectLimits(robot, "RARM_JOINT1", -95, 10);
  expectLimits(robot, "LARM_JOINT1", -10, 95);
  expectLimits(robot, "RARM_JOINT3", -137, 2);
  // Both files stand in the same posture.
  EXPECT_EQ(loadRobot(kRobots + "hrp2").home, robot.home);
}

// Against the lengths that Franka states: shoulder 0.333 m, arm 0.316 and 0.384 m, offsets 0.0825 and 0.088 m, flange
// 0.107 m.
TEST(Panda, StandsWhereItsTableSays) {
  const Robot robot = loadRobot(kRobots + "panda");
  const ArmChain chain = makeChain(robot, 0);
  expectTip(chain, posture({0, 0, 0, 0, 0, 0, 0}), {0.088, 0, 0.333 + 0.316 + 0.384 - 0.107}, -Vector3d::UnitZ());
  expectTip(chain, posture({0, 0, 0, -90, 0, 90, 0}), {0.0825 + 0.384 + 0.088, 0, 0.333 + 0.316 + 0.0825 - 0.107},
            -Vector3d::UnitZ());
  // The fingers of the Franka hand slide at 45 degrees to the flange's x.
  const Vector3d slide = robot.arms[0].X_TH.linear() * Vector3d::UnitX();
  EXPECT_LT((slide - Vector3d(std::sqrt(0.5), std::sqrt(0.5), 0)).norm(), 1e-7);
  // Its home, where it grasps from: the hand points down, its fingers slide along y.
  const Eigen::Isometry3d X_BH = forwardKinematics(robot.body, robot.home)[robot.arms[0].handLinks[0]];
  EXPECT_LT((X_BH.linear().col(2) + Vector3d::UnitZ()).norm(), 1e-5);
  EXPECT_NEAR(std::abs(X_BH.linear()(1, 0)), 1, 1e-5);
}

}  // namespace
}  // namespace handhold
