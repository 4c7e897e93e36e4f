#include "robot/chain.h"
#include "robot/robot_files.h"

#include <cstdlib>

#include <gmock/gmock.h>

namespace handhold {
namespace {

using testing::boxLink;
using ::testing::HasSubstr;
using testing::indexOf;
using testing::joint;
using ::testing::Not;
using testing::urdf;
using testing::with;

class InitialConfigTest : public testing::RobotFiles {
 protected:
  std::string init(const std::string& srdf = "") const {
    if (!srdf.empty()) write("toy/arm.srdf", srdf);
    return initialRobotConfig(top_ / "toy/arm.urdf", srdf.empty() ? "" : (top_ / "toy/arm.srdf").string(), {});
  }
  std::string srdfRefusal(const std::string& srdf) const {
    return refusalOf([&] { init(srdf); });
  }
  Robot loadFilledIn(const std::string& config) const { return load(with(config, "FOLDER_OF_THE_HAND", "../jaw")); }
};

TEST_F(InitialConfigTest, LoadsOnceTheHandIsNamed) {
  const std::string config = init();
  EXPECT_THAT(config, HasSubstr("(shoulder, elbow, slide)"));
  EXPECT_THAT(refusalOf([&] { load(config); }),
              HasSubstr("arms[0].hand is \"FOLDER_OF_THE_HAND\", want the folder of a hand"));
  const Robot robot = loadFilledIn(config);
  ASSERT_EQ(robot.arms.size(), 1u);
  EXPECT_EQ(robot.arms[0].joints.size(), 3u);
  EXPECT_EQ(robot.body.links[robot.arms[0].tipLink].name, "flange");
  EXPECT_EQ(robot.home[indexOf(robot.body.joints, "elbow")], 1.5);
  EXPECT_EQ(robot.maxVelocity[indexOf(robot.body.joints, "elbow")], 1.5);
}

TEST_F(InitialConfigTest, FindsAHandInTheUrdf) {
  write("toy/arm.urdf", urdf(testing::armLinks() + testing::handLinks() +
                             "<joint name=\"put_on\" type=\"fixed\"><parent link=\"flange\"/><child link=\"palm\"/>"
                             "<origin xyz=\"0 0 0.07\"/></joint>"));
  const std::string config = init();
  EXPECT_THAT(config, HasSubstr("root_link: palm"));
  EXPECT_THAT(config, HasSubstr("(it moves open)"));
  EXPECT_THAT(config, Not(HasSubstr("mount:")));
  const Robot robot = loadFilledIn(config);
  EXPECT_EQ(robot.body.links.size(), 9u);
  EXPECT_EQ(robot.arms[0].joints.size(), 3u);
  EXPECT_EQ(robot.body.links[robot.arms[0].tipLink].name, "flange");
}

// Links that overlap in every posture are listed; those that never meet are only counted.
TEST_F(InitialConfigTest, ListsWhatAlwaysTouches) {
  // The hood is fixed to the upper link, around the shoulder: it reaches into the base however the shoulder turns.
  write("toy/arm.urdf",
        urdf(testing::armLinks() + boxLink("hood", "0.6 0.6 0.6") +
             "<joint name=\"fix\" type=\"fixed\"><parent link=\"upper\"/><child link=\"hood\"/></joint>"));
  const std::string config = init();
  EXPECT_THAT(config, HasSubstr("[base, hood]   # touch in every posture tried"));
  // The head and each of the arm's links, upper and slider, base and lower.
  EXPECT_THAT(config, HasSubstr("# In 1000 random postures 5 pairs of links never touched"));
  EXPECT_THAT(config, Not(HasSubstr("[base, upper]")));
  const Robot robot = loadFilledIn(config);
  const auto pair = std::pair(indexOf(robot.body.links, "base"), indexOf(robot.body.links, "hood"));
  EXPECT_EQ(std::count(robot.allowedCollisions.begin(), robot.allowedCollisions.end(), pair), 1);
  EXPECT_EQ(init(), config) << "the same at every call";
}

TEST_F(InitialConfigTest, TakesOverAnSrdf) {
  const std::string config = init(
      "<?xml version=\"1.0\"?>\n<robot name=\"test\">\n"
      "  <group name=\"arm\"><chain base_link=\"base\" tip_link=\"flange\"/></group>\n"
      "  <group_state name=\"ready\" group=\"arm\"><joint name=\"shoulder\" value=\"-0.25\"/>"
      "<joint name=\"elbow\" value=\"0.75\"/></group_state>\n"
      "  <group_state name=\"other\" group=\"arm\"><joint name=\"shoulder\" value=\"1\"/></group_state>\n"
      "  <disable_collisions link1=\"lower\" link2=\"base\" reason=\"Never\"/>\n"
      "  <disable_collisions link1=\"base\" link2=\"upper\" reason=\"Adjacent\"/>\n</robot>\n");
  EXPECT_THAT(config, HasSubstr("# group_state \"ready\" of arm.srdf"));
  EXPECT_THAT(config, HasSubstr("[base, lower]   # disabled in the SRDF"));
  EXPECT_THAT(config, Not(HasSubstr("[base, upper]")));
  const Robot robot = loadFilledIn(config);
  EXPECT_EQ(robot.home[indexOf(robot.body.joints, "shoulder")], -0.25);
  EXPECT_EQ(robot.home[indexOf(robot.body.joints, "elbow")], 0.75);
  const auto pair = std::pair(indexOf(robot.body.links, "base"), indexOf(robot.body.links, "lower"));
  EXPECT_EQ(std::count(robot.allowedCollisions.begin(), robot.allowedCollisions.end(), pair), 1);
}

TEST_F(InitialConfigTest, RefusesAnSrdfOfAnotherRobot) {
  EXPECT_EQ(srdfRefusal("<robot name=\"t\">\n<disable_collisions link1=\"base\" link2=\"leg\"/></robot>"),
            "toy/arm.srdf:2: disable_collisions names the link leg, want a link of the URDF");
  EXPECT_EQ(srdfRefusal("<robot name=\"t\">\n<disable_collisions link1=\"base\"/></robot>"),
            "toy/arm.srdf:2: <disable_collisions> has no attribute link2");
  EXPECT_EQ(srdfRefusal(
                "<robot name=\"t\">\n<group_state name=\"up\"><joint name=\"hip\" value=\"0\"/></group_state></robot>"),
            "toy/arm.srdf:2: group_state up names the joint hip, want a moving joint of the URDF");
  EXPECT_EQ(srdfRefusal(
                "<robot name=\"t\">\n<group_state name=\"up\"><joint name=\"nod\" value=\"2\"/></group_state></robot>"),
            "toy/arm.srdf:2: group_state up puts the joint nod at 2, want a number within -1 .. 1");
  EXPECT_EQ(
      srdfRefusal(
          "<robot name=\"t\">\n<group_state name=\"up\"><joint name=\"nod\" value=\"0 1\"/></group_state></robot>"),
      "toy/arm.srdf:2: group_state up puts the joint nod at 0 1, want a number within -1 .. 1");
  EXPECT_THAT(srdfRefusal("<robot name=\"t\"><group"), HasSubstr("toy/arm.srdf:1: is no valid SRDF: "));
  EXPECT_EQ(srdfRefusal("<hand/>"), "toy/arm.srdf: is no valid SRDF: has no <robot>");
  EXPECT_THAT(refusalOf([&] { initialRobotConfig(top_ / "toy/arm.urdf", top_ / "toy/none.srdf", {}); }),
              HasSubstr("toy/none.srdf: cannot be read"));
}

TEST_F(InitialConfigTest, RefusesARobotWithoutAnArm) {
  write("toy/arm.urdf", urdf(boxLink("base", "0.1 0.1 0.1")));
  EXPECT_EQ(refusalOf([&] { init(); }),
            "toy/arm.urdf: has no chain of moving joints that could be an arm, want a robot with an arm");
}

// Names that YAML would take for something else.
TEST_F(InitialConfigTest, QuotesNames) {
  std::string text = urdf(testing::armLinks());
  for (const std::string place : {"link name=\"base\"", "parent link=\"base\"", "parent link=\"base\""}) {
    text = with(text, place, with(place, "base", "base: {0}, #1"));
  }
  write("toy/arm.urdf", text);
  const Robot robot = loadFilledIn(init());
  EXPECT_EQ(robot.body.links[0].name, "base: {0}, #1");
}

/// URDFs of other people, where HANDHOLD_DATA names the collection that holds them.
class OthersRobotsTest : public testing::RobotFiles {
 protected:
  void SetUp() override {
    if (std::getenv("HANDHOLD_DATA") == nullptr) GTEST_SKIP() << "HANDHOLD_DATA does not name the collection of URDFs";
  }
  Robot loadWith(const std::string& file, const std::string& hand) const {
    const std::filesystem::path path = std::filesystem::path(std::getenv("HANDHOLD_DATA")) / "robots" / file;
    const std::string config = initialRobotConfig(path, "", {});
    return load(with(with(config, "FOLDER_OF_THE_HAND", std::string(HANDHOLD_SOURCE_DIR) + "/" + hand),
                     "urdf: " + path.filename().string(), "urdf: " + path.string()));
  }
};

TEST_F(OthersRobotsTest, Panda) {
  const Robot robot = loadWith("panda/panda.urdf", "tests/data/hands/panda_hand");
  EXPECT_EQ(robot.arms[0].joints.size(), 7u);
  EXPECT_EQ(robot.body.links[robot.arms[0].handLinks[0]].name, "panda_hand");
  EXPECT_EQ(robot.arms[0].handJoints.size(), 2u);
  // At 0 its fingers meet, and links 5 and 7.
  EXPECT_EQ(robot.home[indexOf(robot.body.joints, "panda_finger_joint1")], 0.02);
  EXPECT_GT(robot.home[indexOf(robot.body.joints, "panda_joint6")], 1.0);
  // Our Panda is this one.
  const Robot ours = loadRobot(std::string(HANDHOLD_SOURCE_DIR) + "/robots/panda");
  const ArmChain theirs = makeChain(robot, 0), chain = makeChain(ours, 0);
  const Eigen::VectorXd q = Eigen::VectorXd::LinSpaced(7, -1, 1);
  EXPECT_LT((tipPose(theirs, q).matrix() - tipPose(chain, q).matrix()).norm(), 1e-9);
}

TEST_F(OthersRobotsTest, Puma) {
  const Robot robot = loadWith("puma560/puma560.urdf", "hands/barrett");
  EXPECT_EQ(robot.arms[0].joints.size(), 6u);
  EXPECT_EQ(robot.body.links[robot.arms[0].tipLink].name, "link7");
}

TEST_F(OthersRobotsTest, Hrp2) {
  const Robot robot = loadWith("hrp2/hrp2_upper_body.urdf", "hands/hrp2");
  EXPECT_EQ(robot.arms[0].joints.size(), 9u) << "chest, arm, and the gripper's only joint, which looks like an arm's";
}

}  // namespace
}  // namespace handhold
