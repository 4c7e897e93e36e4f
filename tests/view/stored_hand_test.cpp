#include "hand/stored_hand.h"

#include "core/error.h"
#include "hand/hand.h"

#include <numbers>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

// Closed forms, a few products of rotations: rounding and no more. The URDF's own angles are written exactly enough.
constexpr double kRounding = 1e-9;

// arm -> base (root H) -> turner -(revolute z)-> slider -(prismatic x)-> follower -(mimic, y)-> tip (fixed)
const std::string kUrdf = R"(<robot name="made_up">
  <link name="arm"/><link name="base"/><link name="turner"/><link name="slider"/><link name="follower"/><link name="tip"/>
  <joint name="wrist" type="revolute"><parent link="arm"/><child link="base"/><origin xyz="9 9 9"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="turn" type="revolute"><parent link="base"/><child link="turner"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 0 2"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="turner"/><child link="slider"/><origin xyz="0.2 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="follow" type="continuous"><parent link="slider"/><child link="follower"/>
    <axis xyz="0 1 0"/><mimic joint="turn" multiplier="2"/></joint>
  <joint name="end" type="fixed"><parent link="follower"/><child link="tip"/>
    <origin xyz="0 0 0.05" rpy="1.5707963267948966 0 0"/></joint>
</robot>)";

const std::vector<std::string> kLinks = {"base", "turner", "slider", "follower", "tip"};

Isometry3d turned(double angle, const Vector3d& axis, const Vector3d& position) {
  return Eigen::Translation3d(position) * Eigen::AngleAxisd(angle, axis);
}

// turn = 90 degrees, slide = 0.3, follow = -90 degrees (taken as it is, not 2 * turn). From the base: up 0.1, then what
// was x is y: the slider is at (0, 0.2 + 0.3, 0.1). Turning -90 degrees about the slider's y takes its z to its -x,
// which is the base's -y.
TEST(LinkPosesFromUrdf, HandComputedPoses) {
  constexpr double kQuarter = std::numbers::pi / 2;
  const auto X = linkPosesFromUrdf(kUrdf, kLinks, {"turn", "slide", "follow"}, Vector3d(kQuarter, 0.3, -kQuarter));
  ASSERT_EQ(X.size(), 5U);
  const Isometry3d turner = turned(kQuarter, Vector3d::UnitZ(), {0, 0, 0.1});
  EXPECT_TRUE(X[0].isApprox(Isometry3d::Identity(), kRounding));
  EXPECT_TRUE(X[1].isApprox(turner, kRounding));
  EXPECT_TRUE(X[2].isApprox(turned(kQuarter, Vector3d::UnitZ(), {0, 0.5, 0.1}), kRounding));
  EXPECT_LT((X[3].translation() - Vector3d(0, 0.5, 0.1)).norm(), kRounding);
  EXPECT_LT((X[3].linear() * Vector3d::UnitZ() - Vector3d(0, -1, 0)).norm(), kRounding);
  EXPECT_LT((X[4].translation() - Vector3d(0, 0.45, 0.1)).norm(), kRounding);
  // The tip is turned by 90 degrees about x: its y is the follower's z, its z the follower's -y = the base's x.
  EXPECT_LT((X[4].linear() * Vector3d::UnitY() - Vector3d(0, -1, 0)).norm(), kRounding);
  EXPECT_LT((X[4].linear() * Vector3d::UnitZ() - Vector3d(1, 0, 0)).norm(), kRounding);
}

// A moving joint without a name in the record stands at zero; links may come in any order after the root.
TEST(LinkPosesFromUrdf, UnnamedJointsStandAtZero) {
  const auto X = linkPosesFromUrdf(kUrdf, {"base", "tip", "slider"}, {"slide"}, Eigen::VectorXd::Constant(1, 0.3));
  EXPECT_LT((X[1].translation() - Vector3d(0.5, 0, 0.15)).norm(), kRounding);
  EXPECT_LT((X[2].translation() - Vector3d(0.5, 0, 0.1)).norm(), kRounding);
}

TEST(LinkPosesFromUrdf, AgreesWithForwardKinematics) {
  for (const std::string name : {"barrett", "hrp2", "jaw"}) {
    const Hand hand = loadHand(HANDHOLD_SOURCE_DIR "/hands/" + name);
    std::vector<std::string> links, joints;
    for (const Link& link : hand.links) links.push_back(link.name);
    for (const Joint& joint : hand.joints) joints.push_back(joint.name);
    for (const Preshape& preshape : hand.preshapes) {
      const auto expected = forwardKinematics(hand, preshape.jointPosition);
      const auto found = linkPosesFromUrdf(hand.urdfText, links, joints, preshape.jointPosition);
      ASSERT_EQ(found.size(), expected.size());
      for (std::size_t i = 0; i < links.size(); ++i) {
        EXPECT_LT((found[i].matrix() - expected[i].matrix()).norm(), kRounding)
            << name << " " << preshape.name << " " << links[i];
      }
    }
  }
}

struct Refusal {
  std::string urdf;
  std::vector<std::string> links, joints;
  std::string message;
};

TEST(LinkPosesFromUrdf, Refusals) {
  const std::vector<Refusal> refusals = {
      {"<robot", {"base"}, {}, "the stored URDF: is no valid URDF: "},
      {kUrdf, {"base", "thumb"}, {}, "the stored URDF: has no link thumb"},
      {kUrdf, {"base", "arm"}, {}, "the stored URDF: link arm is not below base, the root link"},
      {kUrdf, {"base"}, {"thumb"}, "the stored URDF: has no moving joint thumb"},
      {kUrdf, {"base"}, {"end"}, "the stored URDF: has no moving joint end"},
      {kUrdf, {"base"}, {"turn", "slide"}, "the stored URDF: 2 joint names with 1 positions, want as many"},
  };
  for (const Refusal& refusal : refusals) {
    SCOPED_TRACE(refusal.message);
    const Eigen::VectorXd position = Eigen::VectorXd::Zero(refusal.joints.empty() ? 0 : 1);
    try {
      linkPosesFromUrdf(refusal.urdf, refusal.links, refusal.joints, position);
      ADD_FAILURE() << "accepted";
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).substr(0, refusal.message.size()), refusal.message);
    }
  }
}

}  // namespace
}  // namespace handhold
