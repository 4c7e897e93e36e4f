#include "robot/chain.h"
#include "robot/robot_files.h"

#include <algorithm>

#include <gmock/gmock.h>

namespace handhold {
namespace {

using ::testing::HasSubstr;
using testing::indexOf;
using testing::joint;
using testing::kConfig;
using testing::kHandConfig;
using testing::urdf;
using testing::with;

constexpr double kTol = 1e-12;

class RobotTest : public testing::RobotFiles {};

bool isAllowed(const Robot& robot, const std::string& a, const std::string& b) {
  const int i = indexOf(robot.body.links, a), j = indexOf(robot.body.links, b);
  return std::count(robot.allowedCollisions.begin(), robot.allowedCollisions.end(),
                    std::pair(std::min(i, j), std::max(i, j))) == 1;
}

TEST_F(RobotTest, PutsTheHandOnTheTip) {
  const Robot robot = load(kConfig);
  EXPECT_EQ(robot.name, "toy");
  ASSERT_EQ(robot.arms.size(), 1u);
  const Arm& arm = robot.arms[0];
  EXPECT_EQ(findArm(robot, "arm"), 0);
  EXPECT_EQ(findArm(robot, "leg"), -1);
  ASSERT_EQ(arm.joints.size(), 3u);
  EXPECT_EQ(robot.body.joints[arm.joints[0]].name, "shoulder");
  EXPECT_EQ(robot.body.joints[arm.joints[1]].name, "elbow");
  EXPECT_EQ(robot.body.joints[arm.joints[2]].name, "slide");
  ASSERT_EQ(arm.handLinks.size(), arm.hand.links.size());
  ASSERT_EQ(arm.handJoints.size(), arm.hand.joints.size());
  // Every link of the hand is where the hand says, from the flange on.
  const Eigen::VectorXd q = robot.home;
  Eigen::VectorXd qHand(arm.handJoints.size());
  for (std::size_t i = 0; i < arm.handJoints.size(); ++i) qHand[i] = q[arm.handJoints[i]];
  EXPECT_NEAR(qHand[0], 0.02, kTol);
  EXPECT_NEAR(qHand[1], 0.02, kTol) << "the mimic joint follows";
  const auto X_BL = forwardKinematics(robot.body, q);
  const auto X_HL = forwardKinematics(arm.hand, qHand);
  for (std::size_t i = 0; i < X_HL.size(); ++i) {
    const Eigen::Isometry3d expected = X_BL[arm.tipLink] * arm.X_TH * X_HL[i];
    EXPECT_TRUE(X_BL[arm.handLinks[i]].isApprox(expected, kTol)) << arm.hand.links[i].name;
    EXPECT_EQ(robot.body.links[arm.handLinks[i]].name, arm.hand.links[i].name);
    EXPECT_EQ(robot.body.links[arm.handLinks[i]].mesh.vertices, arm.hand.links[i].mesh.vertices);
  }
}

TEST_F(RobotTest, ReadsHomeSpeedsAndScore) {
  const Robot robot = load(kConfig);
  const auto at = [&](const std::string& name) { return indexOf(robot.body.joints, name); };
  EXPECT_EQ(robot.home[at("shoulder")], 0.5);
  EXPECT_EQ(robot.home[at("elbow")], 1.5) << "the middle of limits that do not hold 0";
  EXPECT_EQ(robot.home[at("slide")], 0);
  EXPECT_EQ(robot.home[at("nod")], 0);
  EXPECT_EQ(robot.maxVelocity[at("shoulder")], 0.7);
  EXPECT_EQ(robot.maxVelocity[at("elbow")], 1.5) << "the URDF's limit";
  EXPECT_EQ(robot.maxVelocity[at("slide")], 1) << "the default";
  EXPECT_EQ(robot.maxAcceleration, Eigen::VectorXd::Constant(robot.body.joints.size(), 3));
  EXPECT_EQ(robot.clearance, 0.01);
  EXPECT_EQ(robot.score.c1, 2);
  EXPECT_EQ(robot.score.c2, 1);
  EXPECT_EQ(robot.score.c3, 2);
  EXPECT_EQ(robot.score.far, 0.4);
}

TEST_F(RobotTest, NeighboursMayTouch) {
  const Robot robot = load(kConfig);
  EXPECT_TRUE(isAllowed(robot, "base", "upper"));
  EXPECT_TRUE(isAllowed(robot, "upper", "lower"));
  EXPECT_TRUE(isAllowed(robot, "slider", "palm")) << "the flange between them has no geometry";
  EXPECT_TRUE(isAllowed(robot, "palm", "left"));
  EXPECT_TRUE(isAllowed(robot, "base", "palm")) << "listed";
  EXPECT_TRUE(isAllowed(robot, "head", "upper")) << "listed";
  EXPECT_FALSE(isAllowed(robot, "base", "lower"));
  EXPECT_FALSE(isAllowed(robot, "left", "right"));
  EXPECT_TRUE(std::is_sorted(robot.allowedCollisions.begin(), robot.allowedCollisions.end()));
}

TEST_F(RobotTest, TwoHandsOfOneKindCarryTheirArmsNames) {
  const std::string second =
      "  - {name: other, base_link: base, tip_link: head, hand: ../jaw, mount: {position: [0, 0, 0.02]}}\nhome: ";
  const Robot robot = load(with(with(with(kConfig, "home: ", second), "open: 0.02", "other_open: 0.02"), "[palm, base]",
                                "[arm_palm, base]"));
  for (const Arm& arm : robot.arms) {
    EXPECT_EQ(robot.body.links[arm.handLinks[1]].name, arm.name + "_left");
    EXPECT_EQ(robot.body.joints[arm.handJoints[1]].name, arm.name + "_open_2");
    EXPECT_EQ(robot.body.joints[arm.handJoints[1]].mimicOf, arm.handJoints[0]);
    EXPECT_EQ(robot.body.joints[arm.handJoints[1]].childLink, arm.handLinks[2]);
    EXPECT_EQ(robot.body.links[arm.handLinks[0]].parentLink, arm.tipLink);
  }
}

TEST_F(RobotTest, ANameThatTheRobotHasIsAvoided) {
  write("toy/arm.urdf", with(with(urdf(testing::armLinks()), "link name=\"head\"", "link name=\"left\""),
                             "child link=\"head\"", "child link=\"left\""));
  const Robot robot = load(with(kConfig, "[head, upper]", "[arm_left, upper]"));
  EXPECT_EQ(robot.body.links[robot.arms[0].handLinks[1]].name, "arm_left");
  EXPECT_EQ(robot.body.links[robot.arms[0].handLinks[2]].name, "right");
}

TEST_F(RobotTest, AFileOfAnotherNameNamesTheRobot) {
  write("toy/chest.yaml", kConfig);
  EXPECT_EQ(loadRobot(top_ / "toy" / "chest.yaml").name, "toy_chest");
}

TEST_F(RobotTest, TheHashCoversEveryFile) {
  const std::string hash = load(kConfig).contentHash;
  EXPECT_EQ(load(kConfig).contentHash, hash);
  EXPECT_NE(load(with(kConfig, "clearance: 0.01", "clearance: 0.02")).contentHash, hash);
  write("jaw/hand.yaml", with(kHandConfig, "0.03", "0.02"));
  EXPECT_NE(load(kConfig).contentHash, hash);
  write("jaw/hand.yaml", kHandConfig);
  write("toy/arm.urdf", with(urdf(testing::armLinks()), "0.05 0.05 0.3", "0.05 0.06 0.3"));
  EXPECT_NE(load(kConfig).contentHash, hash);
}

/// A robot whose URDF has the hand below its flange, turned by a quarter.
class IncludedHandTest : public testing::RobotFiles {
 protected:
  IncludedHandTest() {
    write("toy/arm.urdf", urdf(testing::armLinks() + testing::handLinks() +
                               "<joint name=\"put_on\" type=\"fixed\"><parent link=\"flange\"/><child link=\"palm\"/>"
                               "<origin xyz=\"0 0 0.07\" rpy=\"0 0 1.570796326795\"/></joint>"));
  }
  const std::string config_ = with(kConfig, ", mount: {position: [0, 0, 0.02]}", "");
};

TEST_F(IncludedHandTest, IsUsedWhereItStands) {
  const Robot robot = load(config_);
  EXPECT_EQ(robot.body.links.size(), 9u);
  EXPECT_EQ(robot.body.joints.size(), 6u);
  const Arm& arm = robot.arms[0];
  EXPECT_NEAR(arm.X_TH.translation().z(), 0.07, kTol);
  EXPECT_NEAR(arm.X_TH.linear()(1, 0), 1, kTol);
  for (std::size_t i = 0; i < arm.handLinks.size(); ++i) {
    EXPECT_EQ(robot.body.links[arm.handLinks[i]].name, arm.hand.links[i].name);
  }
  for (std::size_t i = 0; i < arm.handJoints.size(); ++i) {
    EXPECT_EQ(robot.body.joints[arm.handJoints[i]].name, arm.hand.joints[i].name);
  }
}

TEST_F(IncludedHandTest, TheHandMayBeReadFromTheRobotsUrdf) {
  write("jaw/hand.yaml", with(kHandConfig, "hand.urdf", "../toy/arm.urdf"));
  EXPECT_EQ(load(config_).body.links.size(), 9u);
}

TEST_F(IncludedHandTest, AMountIsRefused) {
  EXPECT_EQ(
      refusalOf([&] { load(kConfig); }),
      "toy/robot.yaml:3: arms[0].mount is given, but the URDF has the hand's root link palm below flange, want no "
      "mount");
}

TEST_F(IncludedHandTest, AnotherHandIsRefused) {
  write("jaw/hand.urdf", with(urdf(testing::handLinks()), "0 0 0.03", "0 0 0.04"));
  EXPECT_EQ(refusalOf([&] { load(config_); }),
            "toy/robot.yaml:3: arms[0].hand has its link left in another place than the URDF, want the same hand");
  write("jaw/hand.urdf", urdf(testing::handLinks() + testing::boxLink("thumb", "0.01 0.01 0.01") +
                              joint("bend", "revolute", "palm", "thumb", "0 0.03 0", "1 0 0", 0, 1)));
  EXPECT_EQ(refusalOf([&] { load(config_); }),
            "toy/robot.yaml:3: arms[0].hand has a link thumb that the URDF does not have below palm");
}

TEST_F(IncludedHandTest, AJointBeyondTheTipIsRefused) {
  EXPECT_EQ(refusalOf([&] { load(with(config_, "tip_link: flange", "tip_link: lower")); }),
            "toy/robot.yaml:3: arms[0].hand hangs on the joint slide beyond tip_link, want a hand that is fixed to it");
}

TEST_F(RobotTest, RefusesWhatIsMissing) {
  EXPECT_EQ(refusalOf([&] { loadRobot(top_ / "nowhere"); }),
            "nowhere: does not exist, want a robot's folder with robot.yaml");
  EXPECT_EQ(
      refusal("urdf: arm.urdf", "urdf: leg.urdf"),
      "toy/robot.yaml:1: urdf is \"leg.urdf\", want the path of a URDF file, relative to the robot's file (looked for "
      "toy/leg.urdf)");
  EXPECT_EQ(
      refusal("../jaw", "../claw"),
      "toy/robot.yaml:3: arms[0].hand is \"../claw\", want the folder of a hand, relative to the robot's file (looked "
      "for claw)");
  EXPECT_EQ(refusal(", mount: {position: [0, 0, 0.02]}", ""),
            "toy/robot.yaml:3: arms[0] has no mount, and the URDF has no link palm at or below flange, want one of the "
            "two");
  EXPECT_THAT(refusal("urdf: arm.urdf", "clearance: 0.01"), HasSubstr("toy/robot.yaml:"));
  EXPECT_THAT(refusal("name: arm, ", ""), HasSubstr("toy/robot.yaml:3: arms[0]"));
}

TEST_F(RobotTest, RefusesUnknownKeysAndNames) {
  EXPECT_THAT(refusal("clearance", "clearence"),
              HasSubstr("toy/robot.yaml:7: clearence is not a known key, want one of: urdf, arms"));
  EXPECT_THAT(refusal("name: arm", "title: x, name: arm"), HasSubstr("arms[0].title is not a known key"));
  EXPECT_THAT(refusal("c1: 2", "c4: 2"), HasSubstr("toy/robot.yaml:9: score.c4 is not a known key"));
  EXPECT_EQ(
      refusal("base_link: base", "base_link: foot"),
      "toy/robot.yaml:3: arms[0].base_link is \"foot\", want a link of the robot: base, head, upper, lower, slider, "
      "flange");
  EXPECT_THAT(refusal("tip_link: flange", "tip_link: tool"), HasSubstr("arms[0].tip_link is \"tool\", want a link"));
  EXPECT_THAT(refusal("shoulder: 0.5", "hip: 0.5"),
              HasSubstr("toy/robot.yaml:4: home.hip names no joint of the robot, want one of: nod, shoulder"));
  EXPECT_THAT(refusal("shoulder: 0.7", "hip: 0.7"), HasSubstr("toy/robot.yaml:5: max_velocity.hip names no joint"));
  EXPECT_THAT(refusal("max_acceleration: 3", "max_acceleration: {hip: 3}"), HasSubstr("max_acceleration.hip names no"));
  EXPECT_THAT(refusal("[head, upper]", "[hat, upper]"),
              HasSubstr("toy/robot.yaml:8: allowed_collisions[1][0] is \"hat\", want a link of the robot"));
}

TEST_F(RobotTest, RefusesChainsThatAreNone) {
  EXPECT_EQ(refusal("base_link: base", "base_link: head"),
            "toy/robot.yaml:3: arms[0].tip_link is \"flange\", want a link that hangs on base_link head");
  EXPECT_EQ(refusal("base_link: base", "base_link: slider"),
            "toy/robot.yaml:3: arms[0].tip_link is \"flange\", want a link that joints move against base_link slider");
  EXPECT_EQ(refusal("base_link: base", "base_link: flange"),
            "toy/robot.yaml:3: arms[0].tip_link is \"flange\", want a link that joints move against base_link flange");
  write("toy/arm.urdf",
        with(urdf(testing::armLinks()), "xyz=\"0 0 0.4\"/>", "xyz=\"0 0 0.4\"/><mimic joint=\"shoulder\"/>"));
  EXPECT_EQ(refusal("clearance: 0.01", "clearance: 0.01"),
            "toy/robot.yaml:3: arms[0].tip_link hangs on the mimic joint elbow, want an arm of joints that move by "
            "themselves");
}

TEST_F(RobotTest, RefusesNumbersThatMeanNothing) {
  EXPECT_EQ(refusal("shoulder: 0.5", "shoulder: 2.5"),
            "toy/robot.yaml:4: home.shoulder is \"2.5\", want a position within the joint's limits -1.5 .. 2");
  EXPECT_EQ(refusal("open: 0.02", "open_2: 0.02"),
            "toy/robot.yaml:4: home.open_2 sets a mimic joint, want the joint that it follows: open");
  EXPECT_EQ(refusal("shoulder: 0.7", "shoulder: 0"),
            "toy/robot.yaml:5: max_velocity.shoulder is \"0\", want a number > 0");
  EXPECT_EQ(refusal("max_acceleration: 3", "max_acceleration: -3"),
            "toy/robot.yaml:6: max_acceleration is \"-3\", want a number > 0");
  EXPECT_THAT(refusal("clearance: 0.01", "clearance: -0.01"),
              HasSubstr("toy/robot.yaml:7: clearance is \"-0.01\", want"));
  EXPECT_THAT(refusal("far: 0.4", "far: 0"), HasSubstr("toy/robot.yaml:9: score.far is \"0\", want a number > 0"));
  EXPECT_THAT(refusal("c1: 2", "c1: -2"), HasSubstr("toy/robot.yaml:9: score.c1 is \"-2\", want"));
  EXPECT_THAT(refusal("[head, upper]", "[head]"), HasSubstr("allowed_collisions[1] is"));
  EXPECT_EQ(refusal("[head, upper]", "[head, head]"),
            "toy/robot.yaml:8: allowed_collisions[1] names one link twice, want two links");
}

TEST_F(RobotTest, RefusesArmsThatClash) {
  const auto second = [&](const std::string& arm) {
    return refusal("home: ", "  - {" + arm + ", base_link: base, hand: ../jaw, mount: {position: [0, 0, 0]}}\nhome: ");
  };
  EXPECT_EQ(second("name: arm, tip_link: head"),
            "toy/robot.yaml:4: arms[1].name is \"arm\", want a name that no other arm has");
  EXPECT_EQ(
      second("name: two, tip_link: flange"),
      "toy/robot.yaml:4: arms[1].tip_link is \"flange\", want a link that carries no other hand (arm arm has it)");
  EXPECT_THAT(second("name: a/b, tip_link: head"),
              HasSubstr("toy/robot.yaml:4: arms[1].name is \"a/b\", want 1 to 100"));
  EXPECT_THAT(refusalOf([&] { load("urdf: arm.urdf\narms: []\n"); }), HasSubstr("toy/robot.yaml:2: arms is"));
}

}  // namespace
}  // namespace handhold
