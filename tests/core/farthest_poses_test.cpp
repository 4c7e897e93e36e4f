#include "core/farthest_poses.h"

#include "core/random.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using testing::ElementsAre;

constexpr double kScale = 0.1;  // m/rad

double distanceOf(const Isometry3d& a, const Isometry3d& b) {
  return (a.translation() - b.translation()).norm() +
         kScale * Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

double coverRadius(const std::vector<Isometry3d>& poses, const std::vector<std::size_t>& chosen) {
  double radius = 0;
  for (const Isometry3d& pose : poses) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const std::size_t i : chosen) nearest = std::min(nearest, distanceOf(pose, poses[i]));
    radius = std::max(radius, nearest);
  }
  return radius;
}

std::vector<Isometry3d> randomPoses(std::uint64_t seed, std::size_t count) {
  const RandomStream stream(seed);
  std::uint64_t counter = 0;
  const auto next = [&] { return 2 * stream.uniform(counter++) - 1; };
  std::vector<Isometry3d> poses(count);
  for (Isometry3d& pose : poses) {
    const double x = next(), y = next(), z = next(), w = next();
    pose = Eigen::Translation3d(0.2 * next(), 0.2 * next(), 0.2 * next()) * Eigen::Quaterniond(w, x, y, z).normalized();
  }
  return poses;
}

TEST(FarthestPoses, TakesTheFirstThenTheFarthest) {
  std::vector<Isometry3d> poses;
  for (const double x : {0.0, 0.1, 0.7, 1.0, 0.4}) poses.emplace_back(Eigen::Translation3d(x, 0, 0));
  const PoseCover three = farthestPoses(poses, 3, kScale);
  EXPECT_THAT(three.chosen, ElementsAre(0, 3, 4));
  EXPECT_NEAR(three.radius, 0.3, 1e-12);
  EXPECT_THAT(farthestPoses(poses, 1, kScale).chosen, ElementsAre(0));
  EXPECT_NEAR(farthestPoses(poses, 1, kScale).radius, 1, 1e-12);
}

// A quarter turn counts as much as the same arc at the distance s.
TEST(FarthestPoses, WeighsTurnsByTheScale) {
  const Eigen::AngleAxisd quarter(std::numbers::pi / 2, Eigen::Vector3d::UnitZ());
  const std::vector<Isometry3d> poses{Isometry3d::Identity(), Isometry3d(Eigen::Translation3d(0.2, 0, 0)),
                                      Isometry3d(quarter)};
  EXPECT_THAT(farthestPoses(poses, 2, 0.1).chosen, ElementsAre(0, 1));
  EXPECT_NEAR(farthestPoses(poses, 2, 0.1).radius, 0.1 * std::numbers::pi / 2, 1e-12);
  EXPECT_THAT(farthestPoses(poses, 2, 0.2).chosen, ElementsAre(0, 2));
}

TEST(FarthestPoses, ChoosesAllWhenThereAreNoMore) {
  EXPECT_THAT(farthestPoses({}, 3, kScale).chosen, ElementsAre());
  const PoseCover all = farthestPoses(randomPoses(1, 3), 3, kScale);
  EXPECT_THAT(all.chosen, ElementsAre(0, 1, 2));
  EXPECT_EQ(all.radius, 0);
}

// Equal poses: none is chosen twice.
TEST(FarthestPoses, ChoosesEqualPosesInTheirOrder) {
  const std::vector<Isometry3d> poses(5, Isometry3d::Identity());
  EXPECT_THAT(farthestPoses(poses, 3, kScale).chosen, ElementsAre(0, 1, 2));
}

// Rounding does not decide between poses that are equally far.
TEST(FarthestPoses, TakesTheFirstOfATie) {
  std::vector<Isometry3d> poses{Isometry3d::Identity()};
  for (const double x : {1.0, -1.0 - 1e-12, 1.0 + 2e-12}) poses.emplace_back(Eigen::Translation3d(x, 0, 0));
  EXPECT_THAT(farthestPoses(poses, 2, kScale).chosen, ElementsAre(0, 1));
}

// The radius is that of the choice, and no other choice halves it.
TEST(FarthestPosesProperty, RadiusHoldsAndIsWithinTwiceTheLeast) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const std::vector<Isometry3d> poses = randomPoses(seed, 9);
    const PoseCover cover = farthestPoses(poses, 3, kScale);
    ASSERT_EQ(cover.chosen.size(), 3u);
    EXPECT_NEAR(cover.radius, coverRadius(poses, cover.chosen), 1e-9);
    double least = cover.radius;
    for (std::size_t a = 0; a < poses.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        for (std::size_t c = 0; c < b; ++c) least = std::min(least, coverRadius(poses, {a, b, c}));
      }
    }
    EXPECT_LE(cover.radius, 2 * least + 1e-9);
  }
}

// What the metric promises: no point within s of the origin moves farther than the distance.
TEST(FarthestPosesProperty, BoundsTheMotionOfPointsWithinTheScale) {
  const std::vector<Isometry3d> poses = randomPoses(7, 40);
  const RandomStream stream(8);
  for (std::uint64_t i = 1; i < poses.size(); ++i) {
    const Eigen::Vector3d point = kScale * Eigen::Vector3d(stream.uniform(3 * i) - 0.5, stream.uniform(3 * i + 1) - 0.5,
                                                           stream.uniform(3 * i + 2) - 0.5)
                                               .normalized();
    EXPECT_LE((poses[i] * point - poses[0] * point).norm(), distanceOf(poses[0], poses[i]) + 1e-12);
  }
}

}  // namespace
}  // namespace handhold
