// The hands in hands/, and those of tests/data/hands where HANDHOLD_DATA names the collection that holds their URDFs.

#include "core/error.h"
#include "hand/hand.h"
#include "mesh/ray_scene.h"

#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = 3.14159265358979323846 / 180;
constexpr double kLimitTol = 2e-6;       // rad, m: files have six decimals
constexpr double kPieceTol = 1e-7;       // m: a vertex against its rounding to a 32-bit float
constexpr double kPalmTol = 5e-5;        // m: four decimals in hand.yaml
constexpr double kOthersPalmTol = 1e-3;  // m: palms measured on other people's curved meshes

const std::string kRoot = HANDHOLD_SOURCE_DIR;

int jointNamed(const Hand& hand, const std::string& name) {
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    if (hand.joints[i].name == name) return static_cast<int>(i);
  }
  ADD_FAILURE() << "no joint " << name;
  return 0;
}

void expectLimits(const Hand& hand, const std::string& name, double lower, double upper) {
  const Joint& joint = hand.joints[jointNamed(hand, name)];
  EXPECT_NEAR(joint.lower, lower, kLimitTol) << name;
  EXPECT_NEAR(joint.upper, upper, kLimitTol) << name;
  EXPECT_GT(joint.effort, 0) << name;
}

double distanceToMesh(const Vector3d& p, const TriangleMesh& mesh) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    // Nearest point of a triangle: its plane when the foot lies inside, else the nearest edge.
    const auto corners = mesh.corners(i);
    const Vector3d n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    bool inside = n.squaredNorm() > 0;
    for (int k = 0; k < 3; ++k) {
      const Vector3d &a = corners[k], &b = corners[(k + 1) % 3];
      inside = inside && (b - a).cross(p - a).dot(n) >= 0;
      const double t = std::clamp((p - a).dot(b - a) / std::max((b - a).squaredNorm(), 1e-30), 0.0, 1.0);
      nearest = std::min(nearest, (p - a - t * (b - a)).norm());
    }
    if (inside) nearest = std::min(nearest, std::abs((p - corners[0]).dot(n.normalized())));
  }
  return nearest;
}

/// What holds for every hand that can be used.
void expectUsable(const Hand& hand, double palmTol) {
  EXPECT_LE(distanceToMesh(hand.X_LG.translation(), hand.links[hand.palmLink].mesh), palmTol) << "palm point";
  EXPECT_NEAR(hand.X_LG.linear().determinant(), 1, 1e-9);
  ASSERT_FALSE(hand.preshapes.empty());
  ASSERT_FALSE(hand.closing.empty());
  for (const Preshape& preshape : hand.preshapes) {
    SCOPED_TRACE(preshape.name);
    EXPECT_EQ(followMimics(hand, preshape.jointPosition), preshape.jointPosition);
    for (std::size_t i = 0; i < hand.joints.size(); ++i) {
      const double q = preshape.jointPosition[static_cast<Eigen::Index>(i)];
      EXPECT_GE(q, hand.joints[i].lower - kLimitTol) << hand.joints[i].name;
      EXPECT_LE(q, hand.joints[i].upper + kLimitTol) << hand.joints[i].name;
    }
    for (const Eigen::Isometry3d& X_HL : forwardKinematics(hand, preshape.jointPosition)) {
      EXPECT_TRUE(X_HL.matrix().allFinite());
      EXPECT_LT(X_HL.translation().norm(), 0.5);  // a hand, in metres
      EXPECT_TRUE((X_HL.linear().transpose() * X_HL.linear()).isIdentity(1e-9));
    }
  }
  for (const Link& link : hand.links) {
    SCOPED_TRACE(link.name);
    EXPECT_EQ(link.piecePoints.empty(), link.mesh.triangles.empty());
    for (const Vector3d& p : link.piecePoints) EXPECT_LE(distanceToMesh(p, link.mesh), kPieceTol);
    for (const Vector3d& v : link.mesh.vertices) {
      for (const double x : v) ASSERT_EQ(static_cast<double>(static_cast<float>(x)), x);
    }
  }
}

/// The palm looks outwards: from just above its point, against the approach, a ray meets the palm at once.
void expectPalmOutwards(const Hand& hand) {
  const Vector3d approach = hand.X_LG.linear().col(2);
  const RayHit hit =
      RayScene(hand.links[hand.palmLink].mesh).cast(hand.X_LG.translation() + 0.01 * approach, -approach);
  EXPECT_NEAR(hit.distance, 0.01, kPalmTol);
}

std::vector<std::string> preshapeNames(const Hand& hand) {
  std::vector<std::string> names;
  for (const Preshape& preshape : hand.preshapes) names.push_back(preshape.name);
  return names;
}

TEST(ShippedHands, Barrett) {
  const Hand hand = loadHand(kRoot + "/hands/barrett");
  expectUsable(hand, kPalmTol);
  expectPalmOutwards(hand);
  EXPECT_EQ(hand.name, "barrett");
  EXPECT_EQ(hand.joints.size(), 8U);
  expectLimits(hand, "spread", 0, 180 * kDegree);
  expectLimits(hand, "spread_2", 0, 180 * kDegree);
  for (const std::string finger : {"finger_1", "finger_2", "finger_3"}) {
    expectLimits(hand, finger, 0, 140 * kDegree);
    expectLimits(hand, finger + "_distal", 0, 48 * kDegree);
    const Joint& distal = hand.joints[jointNamed(hand, finger + "_distal")];
    EXPECT_EQ(distal.mimicOf, jointNamed(hand, finger));
    EXPECT_NEAR(distal.mimicMultiplier, 45.0 / 140, 1e-6);
  }
  EXPECT_EQ(preshapeNames(hand),
            (std::vector<std::string>{"spread_0", "spread_30", "spread_60", "spread_90", "spread_180"}));
  EXPECT_EQ(hand.closing.size(), 3U);
  for (const ClosingJoint& closing : hand.closing) EXPECT_GE(closing.breakawayJoint, 0);
}

// At spread 180 all three fingertips stand on the side of finger 3; at spread 0 it stands alone.
TEST(ShippedHands, BarrettSpreads) {
  const Hand hand = loadHand(kRoot + "/hands/barrett");
  const auto tipX = [&](int preshape, const std::string& finger) {
    const auto X_HL = forwardKinematics(hand, hand.preshapes[preshape].jointPosition);
    return X_HL[hand.joints[jointNamed(hand, finger + "_distal")].childLink].translation().x();
  };
  EXPECT_GT(tipX(0, "finger_1"), 0.05);
  EXPECT_NEAR(tipX(0, "finger_1"), -tipX(0, "finger_3"), 1e-6);
  EXPECT_LT(tipX(4, "finger_1"), -0.05);
  EXPECT_NEAR(tipX(4, "finger_1"), tipX(4, "finger_2"), 1e-6);
}

TEST(ShippedHands, Hrp2) {
  const Hand hand = loadHand(kRoot + "/hands/hrp2");
  expectUsable(hand, kPalmTol);
  expectPalmOutwards(hand);
  EXPECT_EQ(hand.joints.size(), 1U);
  expectLimits(hand, "jaw", -60 * kDegree, 0.187);
  EXPECT_EQ(preshapeNames(hand), (std::vector<std::string>{"open_60", "open_40", "open_40_tip"}));
  EXPECT_EQ(hand.preshapes[2].standoff, 0.03);
}

TEST(ShippedHands, Jaw) {
  const Hand hand = loadHand(kRoot + "/hands/jaw");
  expectUsable(hand, kPalmTol);
  expectPalmOutwards(hand);
  EXPECT_EQ(hand.joints.size(), 2U);
  expectLimits(hand, "finger_1", 0, 0.04);
  expectLimits(hand, "finger_2", 0, 0.04);
  EXPECT_EQ(preshapeNames(hand), (std::vector<std::string>{"open_80", "open_50"}));
  EXPECT_TRUE(hand.closing[0].selfCentering);
  // The name gives the opening: the pads' faces are the origins of the finger links.
  const auto X_HL = forwardKinematics(hand, hand.preshapes[0].jointPosition);
  const double opening =
      X_HL[hand.joints[0].childLink].translation().x() - X_HL[hand.joints[1].childLink].translation().x();
  EXPECT_NEAR(opening, 0.08, kLimitTol);
}

struct OtherHand {
  const char* name;
  std::size_t nJoints, nPreshapes, nClosing;
};

class OtherHands : public testing::TestWithParam<OtherHand> {};

TEST_P(OtherHands, AreUsable) {
  if (std::getenv("HANDHOLD_DATA") == nullptr) GTEST_SKIP() << "HANDHOLD_DATA does not name the collection of URDFs";
  const Hand hand = loadHand(kRoot + "/tests/data/hands/" + GetParam().name);
  expectUsable(hand, kOthersPalmTol);
  EXPECT_EQ(hand.joints.size(), GetParam().nJoints);
  EXPECT_EQ(hand.preshapes.size(), GetParam().nPreshapes);
  EXPECT_EQ(hand.closing.size(), GetParam().nClosing);
}

INSTANTIATE_TEST_SUITE_P(Data, OtherHands,
                         testing::Values(OtherHand{"allegro_right", 16, 2, 12}, OtherHand{"barrett_bh280", 8, 4, 3},
                                         OtherHand{"franka_hand", 2, 2, 1}, OtherHand{"panda_hand", 2, 2, 1},
                                         OtherHand{"robotiq_2f85", 6, 2, 1}),
                         [](const auto& item) { return std::string(item.param.name); });

// A hand that comes back from its texts and meshes is the hand that was loaded.
TEST(RestoreHand, EqualsTheLoadedHand) {
  for (const std::string name : {"barrett", "hrp2", "jaw"}) {
    SCOPED_TRACE(name);
    const Hand hand = loadHand(kRoot + "/hands/" + name);
    std::vector<std::string> names;
    std::vector<TriangleMesh> meshes;
    for (const Link& link : hand.links) {
      names.push_back(link.name);
      meshes.push_back(link.mesh);
    }
    const Hand restored = restoreHand(hand.name, hand.urdfText, hand.configText, names, meshes);
    EXPECT_EQ(restored.name, hand.name);
    EXPECT_EQ(restored.contentHash, hand.contentHash);
    ASSERT_EQ(restored.links.size(), hand.links.size());
    for (std::size_t i = 0; i < hand.links.size(); ++i) {
      EXPECT_EQ(restored.links[i].name, hand.links[i].name);
      EXPECT_EQ(restored.links[i].piecePoints, hand.links[i].piecePoints);
      EXPECT_EQ(restored.links[i].contactAllowed, hand.links[i].contactAllowed);
    }
    ASSERT_EQ(restored.preshapes.size(), hand.preshapes.size());
    EXPECT_EQ(restored.preshapes[0].jointPosition, hand.preshapes[0].jointPosition);
    ASSERT_EQ(restored.closing.size(), hand.closing.size());
    EXPECT_EQ(restored.X_LG.matrix(), hand.X_LG.matrix());
    names.pop_back();
    EXPECT_THROW(restoreHand(hand.name, hand.urdfText, hand.configText, names, meshes), InputError);
  }
}

TEST(ChoosePreshapes, TakesThoseOfTheHandInTheGivenOrder) {
  Hand hand = loadHand(kRoot + "/hands/jaw");
  ASSERT_GE(hand.preshapes.size(), 2U);
  const std::string first = hand.preshapes[0].name, second = hand.preshapes[1].name;
  choosePreshapes(hand, {second, "nobody's", first});
  ASSERT_EQ(hand.preshapes.size(), 2U);
  EXPECT_EQ(hand.preshapes[0].name, second);
  EXPECT_EQ(hand.preshapes[1].name, first);
}

}  // namespace
}  // namespace handhold
