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

/// The definition, every distance measured.
std::vector<std::size_t> chosenByDefinition(const std::vector<Isometry3d>& poses, std::size_t count) {
  std::vector<std::size_t> chosen;
  std::vector<double> distance(poses.size(), std::numeric_limits<double>::infinity());
  for (std::size_t next = 0; chosen.size() < count;) {
    chosen.push_back(next);
    for (std::size_t i = 0; i < poses.size(); ++i)
      distance[i] = std::min(distance[i], distanceOf(poses[i], poses[next]));
    for (const std::size_t i : chosen) distance[i] = -1;
    const double farthest = *std::max_element(distance.begin(), distance.end());
    const auto isFarthest = [&](double d) { return d >= farthest - 1e-9; };
    next = static_cast<std::size_t>(std::find_if(distance.begin(), distance.end(), isFarthest) - distance.begin());
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

// Most distances are never measured: the choice is as if all were. Poses in clusters, far from the origin, some twice.
TEST(FarthestPosesProperty, ChoosesByTheDefinition) {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const std::vector<Isometry3d> cluster = randomPoses(seed, 20);
    const double width = seed % 3 == 0 ? 1 : seed % 3 == 1 ? 0.05 : 1e-4;
    std::vector<Isometry3d> poses;
    for (const Isometry3d& around : cluster) {
      for (const Isometry3d& pose : randomPoses(100 * seed + poses.size(), 30)) {
        const Eigen::AngleAxisd turn(pose.linear());
        poses.push_back(Eigen::Translation3d(3, -2, 1) * around * Eigen::Translation3d(width * pose.translation()) *
                        Eigen::AngleAxisd(width * turn.angle(), turn.axis()));
      }
      poses.push_back(around);
      poses.push_back(poses.back());
    }
    for (const std::size_t count : {1, 7, 70, 400}) {
      EXPECT_EQ(farthestPoses(poses, count, kScale).chosen, chosenByDefinition(poses, count)) << count;
    }
  }
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
