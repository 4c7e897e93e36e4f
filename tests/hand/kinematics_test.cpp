#include "core/random.h"
#include "hand/hand.h"
#include "hand/hand_files.h"
#include "hand/stored_hand.h"

#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using std::numbers::pi;
using test::goodUrdf;
using test::indexOf;
using test::kGoodConfig;
using test::with;
using testing::ElementsAre;

constexpr double kPoseTol = 1e-12;  // m and rad: a few products of doubles

/// Joints and links of the test hand by name.
class Kinematics : public test::HandFiles {
 protected:
  static int joint(const Hand& hand, const std::string& name) { return indexOf(hand.joints, name); }
  static int link(const Hand& hand, const std::string& name) { return indexOf(hand.links, name); }

  static Eigen::VectorXd positions(const Hand& hand, const std::map<std::string, double>& values) {
    Eigen::VectorXd q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(hand.joints.size()));
    for (const auto& [name, value] : values) q[joint(hand, name)] = value;
    return q;
  }
  static std::vector<std::string> linksMoved(const Hand& hand, const std::string& name, bool withFollowers) {
    const std::vector<bool> moves = linksMovedBy(hand, joint(hand, name), withFollowers);
    std::vector<std::string> result;
    for (std::size_t i = 0; i < moves.size(); ++i) {
      if (moves[i]) result.push_back(hand.links[i].name);
    }
    return result;
  }

  /// A chain of mimics against the order of the alphabet: a_last follows m_middle follows z_first.
  Hand loadMimicChain() const {
    const auto slide = [](const std::string& name, const std::string& child, const std::string& mimic) {
      return fmt::format(
          "<link name=\"{1}\"/><joint name=\"{0}\" type=\"prismatic\"><parent link=\"base\"/><child link=\"{1}\"/>"
          "<axis xyz=\"1 0 0\"/><limit lower=\"-9\" upper=\"9\" effort=\"1\" velocity=\"1\"/>{2}</joint>\n",
          name, child, mimic);
    };
    return load(with(goodUrdf(), "</robot>",
                     slide("a_last", "a", "<mimic joint=\"m_middle\" multiplier=\"-2\" offset=\"0.5\"/>") +
                         slide("m_middle", "m", "<mimic joint=\"z_first\" multiplier=\"3\" offset=\"0.25\"/>") +
                         slide("z_first", "z", "") + "</robot>"));
  }
};

TEST_F(Kinematics, PosesByHand) {
  const Hand hand = load(goodUrdf());
  // The finger bends down about +y by 90 degrees: its x axis points along -z.
  auto X_HL = forwardKinematics(hand, positions(hand, {{"bend", pi / 2}, {"slide", 0.03}}));
  EXPECT_TRUE(X_HL[0].isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_TRUE(X_HL[link(hand, "slider")].translation().isApprox(Vector3d(0, 0, 0.03), kPoseTol));
  EXPECT_TRUE(X_HL[link(hand, "proximal")].translation().isApprox(Vector3d(0.05, 0, 0.01), kPoseTol));
  EXPECT_TRUE((X_HL[link(hand, "proximal")].linear() * Vector3d::UnitX()).isApprox(-Vector3d::UnitZ(), kPoseTol));
  EXPECT_TRUE(X_HL[link(hand, "distal")].translation().isApprox(Vector3d(0.05, 0, -0.03), kPoseTol));
  // The distal joint alone: positions are taken as they are, a mimic joint does not follow.
  X_HL = forwardKinematics(hand, positions(hand, {{"bend_2", pi / 2}}));
  EXPECT_TRUE(X_HL[link(hand, "proximal")].linear().isIdentity(kPoseTol));
  EXPECT_TRUE(X_HL[link(hand, "distal")].translation().isApprox(Vector3d(0.09, 0, 0.01), kPoseTol));
  EXPECT_TRUE((X_HL[link(hand, "distal")].linear() * Vector3d::UnitX()).isApprox(-Vector3d::UnitZ(), kPoseTol));
}

// URDF's rpy turns about the fixed axes x, y, z in this order; the joint's axis is in the joint's frame.
TEST_F(Kinematics, RollPitchYawOfAJoint) {
  const Hand hand =
      load(with(goodUrdf(), "<origin xyz=\"0.05 0 0.01\"/>", "<origin xyz=\"0 0 1\" rpy=\"0.3 -0.5 0.7\"/>"));
  const auto X_HL = forwardKinematics(hand, positions(hand, {{"bend", 0.2}}));
  const Eigen::Matrix3d expected =
      (Eigen::AngleAxisd(0.7, Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.5, Vector3d::UnitY()) *
       Eigen::AngleAxisd(0.3, Vector3d::UnitX()) * Eigen::AngleAxisd(0.2, Vector3d::UnitY()))
          .toRotationMatrix();
  EXPECT_TRUE(X_HL[link(hand, "proximal")].linear().isApprox(expected, kPoseTol));
}

TEST_F(Kinematics, AxisIsNormalised) {
  const Hand hand = load(with(goodUrdf(), "<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 3 4\"/>"));
  const auto X_HL = forwardKinematics(hand, positions(hand, {{"slide", 0.01}}));
  EXPECT_TRUE(X_HL[link(hand, "slider")].translation().isApprox(Vector3d(0, 0.006, 0.008), kPoseTol));
}

// Chain rule: a small step of a joint moves a link's origin along axis x lever, or along the axis.
TEST_F(Kinematics, DerivativeOfARandomPosture) {
  const Hand hand = load(goodUrdf());
  constexpr double kStep = 1e-6;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    Eigen::VectorXd q(3);
    for (int i = 0; i < 3; ++i) q[i] = random.uniform(i);
    const auto before = forwardKinematics(hand, q);
    Eigen::VectorXd moved = q;
    moved[joint(hand, "bend")] += kStep;
    const auto after = forwardKinematics(hand, moved);
    const Vector3d lever = before[link(hand, "distal")].translation() - before[link(hand, "proximal")].translation();
    const Vector3d velocity =
        (after[link(hand, "distal")].translation() - before[link(hand, "distal")].translation()) / kStep;
    EXPECT_TRUE(velocity.isApprox(Vector3d::UnitY().cross(lever), 1e-4));
  }
}

TEST_F(Kinematics, MimicChainsOfTwoLevels) {
  const Hand hand = loadMimicChain();
  const Eigen::VectorXd q = followMimics(hand, positions(hand, {{"z_first", 0.1}, {"a_last", 7}, {"m_middle", 8}}));
  EXPECT_DOUBLE_EQ(q[joint(hand, "z_first")], 0.1);
  EXPECT_DOUBLE_EQ(q[joint(hand, "m_middle")], 3 * 0.1 + 0.25);
  EXPECT_DOUBLE_EQ(q[joint(hand, "a_last")], -2 * (3 * 0.1 + 0.25) + 0.5);
  EXPECT_EQ(followMimics(hand, q), q);
}

// After loading, a joint at the end of a chain names the independent joint itself, so that who moves that joint moves
// all.
TEST_F(Kinematics, ChainsAreShortenedOnLoading) {
  const Hand hand = loadMimicChain();
  const Joint& last = hand.joints[joint(hand, "a_last")];
  EXPECT_EQ(last.mimicOf, joint(hand, "z_first"));
  EXPECT_DOUBLE_EQ(last.mimicMultiplier, -2 * 3);
  EXPECT_DOUBLE_EQ(last.mimicOffset, 0.5 - 2 * 0.25);
}

TEST_F(Kinematics, FollowersAreDirectAndIndirect) {
  const Hand hand = loadMimicChain();
  const auto names = [&](const std::string& of) {
    std::vector<std::string> result;
    for (const int follower : followersOf(hand, joint(hand, of))) result.push_back(hand.joints[follower].name);
    return result;
  };
  EXPECT_THAT(names("z_first"), ElementsAre("a_last", "m_middle"));
  EXPECT_THAT(names("m_middle"), ElementsAre());  // chains are shortened on loading
  EXPECT_THAT(names("a_last"), ElementsAre());
  EXPECT_THAT(names("bend"), ElementsAre("bend_2"));
}

TEST_F(Kinematics, LinksMoved) {
  const Hand hand = loadMimicChain();
  EXPECT_THAT(linksMoved(hand, "bend", false), ElementsAre("proximal", "distal"));
  EXPECT_THAT(linksMoved(hand, "bend_2", true), ElementsAre("distal"));
  EXPECT_THAT(linksMoved(hand, "slide", true), ElementsAre("slider"));
  EXPECT_THAT(linksMoved(hand, "z_first", false), ElementsAre("z"));
  EXPECT_THAT(linksMoved(hand, "z_first", true), ElementsAre("a", "m", "z"));
  const std::vector<bool> moved = linksMovedBy(hand, {joint(hand, "slide"), joint(hand, "z_first")});
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    const std::string& name = hand.links[i].name;
    EXPECT_EQ(moved[i], name == "slider" || name == "a" || name == "m" || name == "z") << name;
  }
}

// A link moves if and only if forward kinematics says so.
TEST_F(Kinematics, LinksMovedAgreeWithForwardKinematics) {
  const Hand hand = loadMimicChain();
  const Eigen::VectorXd zero = followMimics(hand, positions(hand, {}));
  const auto before = forwardKinematics(hand, zero);
  for (std::size_t j = 0; j < hand.joints.size(); ++j) {
    if (hand.joints[j].mimicOf >= 0) continue;
    Eigen::VectorXd q = zero;
    q[static_cast<Eigen::Index>(j)] += 0.1;
    const auto after = forwardKinematics(hand, followMimics(hand, q));
    const std::vector<bool> moves = linksMovedBy(hand, static_cast<int>(j), true);
    for (std::size_t l = 0; l < hand.links.size(); ++l) {
      EXPECT_EQ(moves[l], !after[l].isApprox(before[l])) << hand.joints[j].name << " " << hand.links[l].name;
    }
  }
}

TEST_F(Kinematics, FixedLinksFollowTheirParents) {
  const Hand hand = load(with(goodUrdf(), "</robot>",
                              "<link name=\"tip\"/><joint name=\"weld\" type=\"fixed\"><parent link=\"distal\"/>"
                              "<child link=\"tip\"/><origin xyz=\"0.03 0 0\"/></joint></robot>"));
  EXPECT_EQ(hand.joints.size(), 3U);
  EXPECT_EQ(hand.links[link(hand, "tip")].joint, -1);
  const auto X_HL = forwardKinematics(hand, positions(hand, {{"bend", pi / 2}}));
  EXPECT_TRUE(X_HL[link(hand, "tip")].translation().isApprox(Vector3d(0.05, 0, -0.06), kPoseTol));
  EXPECT_THAT(linksMoved(hand, "bend_2", false), ElementsAre("distal", "tip"));
}

// A set knows its hand by the stored URDF alone: the same poses.
TEST_F(Kinematics, StoredHandAgrees) {
  const Hand hand = loadMimicChain();
  std::vector<std::string> linkNames, jointNames;
  for (const Link& l : hand.links) linkNames.push_back(l.name);
  for (const Joint& j : hand.joints) jointNames.push_back(j.name);
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    Eigen::VectorXd q(static_cast<Eigen::Index>(jointNames.size()));
    for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = random.uniform(static_cast<std::uint64_t>(i)) - 0.3;
    const auto expected = forwardKinematics(hand, q);
    const auto found = linkPosesFromUrdf(hand.urdfText, linkNames, jointNames, q);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i)
      EXPECT_TRUE(found[i].isApprox(expected[i], kPoseTol)) << linkNames[i];
  }
}

}  // namespace
}  // namespace handhold
