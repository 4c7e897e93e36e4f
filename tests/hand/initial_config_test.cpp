// What `handhold hand FILE.urdf --init` guesses: of toy hands whose answer is plain, and of other people's URDFs.
#include "core/yaml.h"
#include "hand_files.h"

#include <cstdlib>

#include <gmock/gmock.h>

namespace handhold {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

constexpr double kGuessTol = 2e-5;  // m, of points written with five digits

std::string fixedJoint(const std::string& parent, const std::string& child, const std::string& origin) {
  return fmt::format(
      "<joint name=\"{0}_{1}\" type=\"fixed\"><parent link=\"{0}\"/><child link=\"{1}\"/><origin {2}/></joint>\n",
      parent, child, origin);
}

std::string joint(const std::string& name, const std::string& type, const std::string& parent, const std::string& child,
                  const std::string& origin, const std::string& axis, const std::string& limits,
                  const std::string& mimic = "") {
  return fmt::format(
      "<joint name=\"{}\" type=\"{}\"><parent link=\"{}\"/><child link=\"{}\"/><origin {}/><axis xyz=\"{}\"/>"
      "<limit {} effort=\"1\" velocity=\"1\"/>{}</joint>\n",
      name, type, parent, child, origin, axis, limits, mimic);
}

std::string boxAt(const std::string& name, const std::string& size, const std::string& origin) {
  return fmt::format(
      "<link name=\"{0}\"><visual><origin {2}/><geometry><box size=\"{1}\"/></geometry></visual>"
      "<collision><origin {2}/><geometry><box size=\"{1}\"/></geometry></collision></link>\n",
      name, size, origin);
}

/// Two jaws that slide along y on a palm of 20 mm; the palm's front is +z.
std::string jaws() {
  const std::string range = "lower=\"0\" upper=\"0.04\"";
  return boxAt("palm", "0.06 0.2 0.02", "xyz=\"0 0 0\"") + boxAt("left", "0.02 0.01 0.06", "xyz=\"0 0.005 0.03\"") +
         boxAt("right", "0.02 0.01 0.06", "xyz=\"0 -0.005 0.03\"") +
         joint("open_left", "prismatic", "palm", "left", "xyz=\"0 0 0.01\"", "0 1 0", range) +
         joint("open_right", "prismatic", "palm", "right", "xyz=\"0 0 0.01\"", "0 -1 0", range,
               "<mimic joint=\"open_left\"/>");
}

/// A finger of one link that leans out from where it stands on the palm and turns in about the axis.
std::string finger(const std::string& name, const std::string& origin, const std::string& axis,
                   const std::string& limits = "lower=\"-0.5\" upper=\"0.8\"") {
  return boxAt(name, "0.01 0.01 0.08", "xyz=\"0 0 0.04\"") +
         joint("bend_" + name, "revolute", "palm", name, origin, axis, limits);
}

class InitialConfig : public test::HandFiles {
 protected:
  std::string guess(const std::string& links, const std::string& root = "") const {
    write("test.urdf", "<robot name=\"test\">\n" + links + "</robot>\n");
    return initialHandConfig((folder_ / "test.urdf").string(), root);
  }
  Hand guessed(const std::string& links, const std::string& root = "") const {
    const std::string config = guess(links, root);
    SCOPED_TRACE(config);
    write("hand.yaml", config);
    return loadHand(folder_.string());
  }

  static void expectPalm(const Hand& hand, const Eigen::Vector3d& position, const Eigen::Vector3d& approach,
                         const Eigen::Vector3d& closing) {
    EXPECT_TRUE(hand.X_LG.translation().isApprox(position, kGuessTol)) << hand.X_LG.translation().transpose();
    EXPECT_TRUE(hand.X_LG.linear().col(2).isApprox(approach, kGuessTol)) << hand.X_LG.linear().col(2).transpose();
    EXPECT_TRUE(hand.X_LG.linear().col(0).isApprox(closing, kGuessTol)) << hand.X_LG.linear().col(0).transpose();
  }
};

TEST_F(InitialConfig, ParallelJaws) {
  const Hand hand = guessed(jaws());
  expectPalm(hand, {0, 0, 0.01}, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY());
  ASSERT_EQ(hand.closing.size(), 1U);
  EXPECT_EQ(hand.joints[hand.closing[0].joint].name, "open_left");
  EXPECT_EQ(hand.closing[0].direction, -1);
  EXPECT_TRUE(hand.closing[0].selfCentering);
  ASSERT_EQ(hand.preshapes.size(), 2U);
  EXPECT_EQ(hand.preshapes[0].jointPosition, Eigen::Vector2d(0.04, 0.04));
  EXPECT_TRUE(hand.preshapes[1].jointPosition.isApprox(Eigen::Vector2d(0.02, 0.02), kGuessTol));
}

// The palm may face any axis of its link, and sit on links that only carry it.
TEST_F(InitialConfig, AWorldAndATurnedPalm) {
  const Hand hand = guessed("<link name=\"world\"/>\n" + boxAt("foot", "0.1 0.1 0.02", "xyz=\"0 0 0\"") +
                            fixedJoint("world", "foot", "xyz=\"0 0 0\"") + jaws() +
                            fixedJoint("foot", "palm", "xyz=\"-0.1 0 0\" rpy=\"0 -1.57079632679 0\""));
  EXPECT_EQ(hand.links[0].name, "foot");
  EXPECT_EQ(hand.links[hand.palmLink].name, "palm");
  expectPalm(hand, {0, 0, 0.01}, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY());
}

// A hand at the end of an arm begins where its fingers branch off, or where it is told to.
TEST_F(InitialConfig, AHandOnAnArm) {
  const std::string turns = "lower=\"-3\" upper=\"3\"";
  const std::string robot = boxAt("ground", "0.2 0.2 0.2", "xyz=\"0 0 0\"") +
                            boxAt("upper", "0.1 0.1 0.5", "xyz=\"0 0 0\"") +
                            boxAt("flange", "0.1 0.1 0.1", "xyz=\"0 0 0\"") + jaws() +
                            joint("arm_1", "revolute", "ground", "upper", "xyz=\"0 0 0.3\"", "0 1 0", turns) +
                            joint("arm_2", "revolute", "upper", "flange", "xyz=\"0 0 0.5\"", "0 1 0", turns) +
                            fixedJoint("flange", "palm", "xyz=\"0 0 0.1\"");
  EXPECT_EQ(guessed(robot).links[0].name, "palm");
  EXPECT_THAT(guess(robot), HasSubstr("root_link: palm   # where the fingers branch off (--root LINK: another)\n"));
  EXPECT_EQ(guessed(robot, "flange").links[0].name, "flange");
  EXPECT_THAT([&] { guess(robot, "elbow"); }, ThrowsMessage<InputError>(HasSubstr("has no link elbow")));
}

// Three fingers about z; one pair can be spread about the approach, all lean sideways by a joint that closes nothing.
TEST_F(InitialConfig, FingersThatSpread) {
  const std::string side = "lower=\"-0.4\" upper=\"0.4\"", spread = "lower=\"0\" upper=\"1.5708\"";
  const Hand hand = guessed(
      boxAt("palm", "0.12 0.12 0.02", "xyz=\"0 0 0\"") + finger("back", "xyz=\"-0.05 0 0.01\"", "0 1 0") +
      "<link name=\"turret\"/>\n" +
      joint("spread", "revolute", "palm", "turret", "xyz=\"0.05 0 0.01\"", "0 0 1", spread) +
      boxAt("front", "0.01 0.01 0.08", "xyz=\"0 0 0.04\"") +
      joint("bend_front", "revolute", "turret", "front", "xyz=\"0 0 0\"", "0 -1 0", "lower=\"-0.5\" upper=\"0.8\"") +
      boxAt("tip", "0.01 0.01 0.02", "xyz=\"0 0 0.01\"") +
      joint("sideways", "revolute", "front", "tip", "xyz=\"0 0 0.08\"", "0 1 0", side));
  std::vector<std::string> closing;
  for (const ClosingJoint& c : hand.closing) {
    closing.push_back(hand.joints[c.joint].name);
    EXPECT_EQ(c.direction, 1);
    EXPECT_FALSE(c.selfCentering);
  }
  EXPECT_THAT(closing, ElementsAre("bend_back", "bend_front"));
  expectPalm(hand, {0, 0, 0.01}, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitX());
  std::vector<std::string> names;
  for (const Preshape& preshape : hand.preshapes) {
    names.push_back(preshape.name);
    EXPECT_EQ(preshape.jointPosition[test::indexOf(hand.joints, "sideways")], 0);
  }
  ASSERT_THAT(names, ElementsAre("shape_0_open", "shape_0_half", "shape_50_open", "shape_50_half", "shape_100_open",
                                 "shape_100_half"));
  EXPECT_NEAR(hand.preshapes[4].jointPosition[test::indexOf(hand.joints, "spread")], 1.5708, kGuessTol);
}

// Two fingers that one drive turns: the object comes to the middle between them. Such a joint closes alone.
TEST_F(InitialConfig, CoupledFingersCentreThemselves) {
  const std::string limits = "lower=\"-0.5\" upper=\"0.8\"";
  const std::string fingers = boxAt("palm", "0.12 0.04 0.02", "xyz=\"0 0 0\"") +
                              finger("left", "xyz=\"-0.05 0 0.01\"", "0 1 0", limits) +
                              boxAt("right", "0.01 0.01 0.08", "xyz=\"0 0 0.04\"") +
                              joint("bend_right", "revolute", "palm", "right", "xyz=\"0.05 0 0.01\"", "0 -1 0", limits,
                                    "<mimic joint=\"bend_left\"/>");
  const Hand hand = guessed(fingers);
  ASSERT_EQ(hand.closing.size(), 1U);
  EXPECT_TRUE(hand.closing[0].selfCentering);
  EXPECT_EQ(jawSides(hand, hand.closing[0])[test::indexOf(hand.links, "left")], -1);
  EXPECT_EQ(jawSides(hand, hand.closing[0])[test::indexOf(hand.links, "right")], 1);
  EXPECT_EQ(jawSides(hand, hand.closing[0])[test::indexOf(hand.links, "palm")], 0);
  const std::string more = fingers + finger("thumb", "xyz=\"0 0.05 0.01\"", "1 0 0", limits);
  const std::string config =
      test::with(guess(fingers), "contact_links", "  - {joint: bend_thumb, direction: 1}\ncontact_links");
  EXPECT_THAT(refusal("<robot name=\"test\">\n" + more + "</robot>\n", config),
              HasSubstr("closing has a self_centering joint with coupled jaws beside others, want it alone"));
}

// One jaw against a part of the palm: the closing axis points from the jaw to it.
TEST_F(InitialConfig, OneJawAgainstAFixedPart) {
  const Hand hand =
      guessed(boxAt("palm", "0.1 0.04 0.02", "xyz=\"0 0 0\"") + boxAt("post", "0.01 0.02 0.08", "xyz=\"0 0 0.04\"") +
              fixedJoint("palm", "post", "xyz=\"0.03 0 0.01\"") +
              finger("jaw", "xyz=\"-0.03 0 0.01\"", "0 1 0", "lower=\"-0.6\" upper=\"0.6\""));
  EXPECT_TRUE(hand.X_LG.linear().col(2).isApprox(Eigen::Vector3d::UnitZ()));
  EXPECT_TRUE(hand.X_LG.linear().col(0).isApprox(Eigen::Vector3d::UnitX()));
  ASSERT_EQ(hand.closing.size(), 1U);
  EXPECT_EQ(hand.closing[0].direction, 1);
  EXPECT_TRUE(hand.closing[0].selfCentering);
}

// What has a collision shape alone is padding, where other links are to be seen.
TEST_F(InitialConfig, PaddingIsLeftOut) {
  const std::string padded =
      jaws() + test::boxLink("padding", "0.4 0.4 0.4") + fixedJoint("palm", "padding", "xyz=\"0 0 0\"");
  EXPECT_THAT(guess(padded), HasSubstr("ignore_links: [padding]"));
  expectPalm(guessed(padded), {0, 0, 0.01}, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY());
  EXPECT_THAT(guess(jaws()), Not(HasSubstr("ignore_links")));
}

// Nothing comes together: said, and still a hand.yaml that loads.
TEST_F(InitialConfig, SaysWhatWasNotFound) {
  const std::string drawer =
      boxAt("palm", "0.1 0.1 0.1", "xyz=\"0 0 0\"") + boxAt("drawer", "0.1 0.1 0.1", "xyz=\"0 0 0\"") +
      joint("pull", "prismatic", "palm", "drawer", "xyz=\"0.2 0 0\"", "1 0 0", "lower=\"-0.01\" upper=\"0\"");
  EXPECT_THAT(guess(drawer), HasSubstr("# NOT FOUND: in front of no side do the fingertips come together."));
  EXPECT_EQ(guessed(drawer).closing[0].direction, -1);
}

// A URDF may call things what YAML takes for its own.
TEST_F(InitialConfig, NamesAreQuoted) {
  std::string odd = jaws();
  for (std::size_t at = odd.find("open_left"); at != std::string::npos; at = odd.find("open_left", at))
    odd.replace(at, 9, "l, {e}: #1");
  const Hand hand = guessed(odd);
  EXPECT_EQ(hand.joints[hand.closing[0].joint].name, "l, {e}: #1");
}

TEST_F(InitialConfig, WhatDoesNotMoveIsNoHand) {
  EXPECT_THAT([&] { guess(boxAt("palm", "0.1 0.1 0.1", "xyz=\"0 0 0\"")); },
              ThrowsMessage<InputError>(
                  HasSubstr("test.urdf: has no moving joint below the link palm, want a hand with fingers")));
}

/// URDFs of other people, where HANDHOLD_DATA names the collection that holds them.
struct Known {
  const char *folder, *urdf, *root, *palmLink;
  Eigen::Vector3d approach, closing;
  std::size_t closes, preshapes;
};

TEST_F(InitialConfig, OtherPeoplesHands) {
  const char* data = std::getenv("HANDHOLD_DATA");
  if (data == nullptr) GTEST_SKIP() << "HANDHOLD_DATA does not name the collection of URDFs";
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  for (const Known& known : {
           Known{"robotiq_2f85", "robotiq_2f85", "robotiq_85_base_link", "robotiq_85_base_link", z, x, 1, 2},
           Known{"franka_hand", "franka_hand", "panda_hand", "panda_hand", z, y, 1, 2},
           Known{"allegro_right", "allegro_hand_right", "base_link", "base_link", x, z, 13, 2},
           Known{"barrett_bh280", "barrett_bh280", "hand_base", "hand_base", z, y, 3, 6},
           Known{"barrett_dexurdf", "bhand_model", "base_link", "base_link", z, y, 6, 6},
           Known{"hrp2_gripper", "hrp2_gripper_right", "RARM_LINK5", "RARM_LINK5", -z, -x, 1, 2},
       }) {
    SCOPED_TRACE(known.folder);
    const auto folder = std::filesystem::path(data) / "hands" / known.folder;
    const std::string urdf = (folder / (std::string(known.urdf) + ".urdf")).string();
    std::string config = initialHandConfig(urdf);
    EXPECT_THAT(config, Not(HasSubstr("NOT FOUND")));
    write("hand.yaml", test::with(config, fmt::format("urdf: {}.urdf", known.urdf), "urdf: " + urdf));
    const Hand hand = loadHand(folder_.string());
    EXPECT_EQ(hand.links[0].name, known.root);
    EXPECT_EQ(hand.links[hand.palmLink].name, known.palmLink);
    EXPECT_TRUE(hand.X_LG.linear().col(2).isApprox(known.approach, kGuessTol)) << config;
    EXPECT_TRUE(hand.X_LG.linear().col(0).isApprox(known.closing, kGuessTol)) << config;
    EXPECT_EQ(hand.closing.size(), known.closes) << config;
    EXPECT_EQ(hand.closing[0].selfCentering, known.closes == 1) << config;
    EXPECT_EQ(hand.preshapes.size(), known.preshapes) << config;
  }
}

}  // namespace
}  // namespace handhold
