// Time along a path: limits hold between the points too, and the path is not left.
#include "plan/trajectory.h"

#include "core/random.h"

#include <gtest/gtest.h>

namespace handhold {
namespace {

JointPath randomPath(std::uint64_t seed, int points, Eigen::Index n) {
  const RandomStream stream(seed);
  JointPath path;
  std::uint64_t counter = 0;
  for (int i = 0; i < points; ++i) {
    Eigen::VectorXd q(n);
    for (Eigen::Index j = 0; j < n; ++j) q[j] = 4 * stream.uniform(counter++) - 2;
    path.push_back(q);
  }
  return path;
}

/// Velocities and accelerations by differences of sampled positions, within each cubic.
void expectWithinLimits(const Trajectory& trajectory, const JointLimits& limits) {
  constexpr int kSamples = 40;
  for (std::size_t i = 0; i + 1 < trajectory.points.size(); ++i) {
    const double a = trajectory.points[i].time, b = trajectory.points[i + 1].time, h = (b - a) / kSamples;
    ASSERT_GT(b, a);
    for (int s = 1; s < kSamples; ++s) {
      const Eigen::VectorXd before = positionAt(trajectory, i, a + (s - 1) * h),
                            here = positionAt(trajectory, i, a + s * h),
                            after = positionAt(trajectory, i, a + (s + 1) * h);
      const Eigen::VectorXd v = (after - before) / (2 * h), w = (after - 2 * here + before) / (h * h);
      EXPECT_LE((v.cwiseAbs().array() / limits.velocity.array()).maxCoeff(), 1 + 1e-6);
      EXPECT_LE((w.cwiseAbs().array() / limits.acceleration.array()).maxCoeff(), 1 + 1e-4);
    }
  }
}

TEST(Trajectory, CornersAreStops) {
  const JointLimits limits{Eigen::Vector3d(1, 2, 0.5), Eigen::Vector3d(3, 3, 3)};
  for (int seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Trajectory trajectory;
    const JointPath path = randomPath(static_cast<std::uint64_t>(seed), 4, 3);
    appendSegment("transit", path, true, limits, trajectory);
    expectWithinLimits(trajectory, limits);
    std::size_t corner = 0;
    for (const TrajectoryPoint& point : trajectory.points) {
      if (!point.velocity.isZero(1e-12)) continue;
      EXPECT_TRUE(point.position.isApprox(path[corner++]));
    }
    EXPECT_EQ(corner, path.size());
  }
}

TEST(Trajectory, ACurveIsPassedThroughAtSpeed) {
  JointPath path;
  for (int i = 0; i <= 30; ++i) path.push_back(Eigen::Vector2d(std::sin(0.05 * i), std::cos(0.05 * i)));
  const JointLimits limits{Eigen::Vector2d(1, 1), Eigen::Vector2d(5, 5)};
  Trajectory trajectory;
  appendSegment("approach", path, false, limits, trajectory);
  expectWithinLimits(trajectory, limits);
  ASSERT_EQ(trajectory.points.size(), path.size());
  for (std::size_t i = 1; i + 1 < path.size(); ++i) EXPECT_GT(trajectory.points[i].velocity.norm(), 0.01);
  EXPECT_TRUE(trajectory.points.back().velocity.isZero());
}

TEST(Trajectory, SegmentsShareTheirPoints) {
  const JointLimits limits{Eigen::VectorXd::Ones(1), Eigen::VectorXd::Ones(1)};
  const auto at = [](double x) { return Eigen::VectorXd::Constant(1, x); };
  Trajectory trajectory;
  appendSegment("transit", {at(0), at(1)}, true, limits, trajectory);
  appendSegment("approach", {at(1), at(1.1)}, false, limits, trajectory);
  appendSegment("close", {at(1.1), at(1.1)}, true, limits, trajectory);  // nothing moves
  ASSERT_EQ(trajectory.segments.size(), 3u);
  EXPECT_EQ(trajectory.segments[0].begin, 0u);
  EXPECT_EQ(trajectory.segments[1].begin, trajectory.segments[0].end);
  EXPECT_EQ(trajectory.segments[2].begin, trajectory.segments[2].end);
  // 1 rad at 1 rad/s^2 and at most 1 rad/s: a second up, a second down; 1.01 allows for the cubics.
  EXPECT_NEAR(trajectory.points[trajectory.segments[0].end].time, 2, 0.02);
}

TEST(Trajectory, PeaksOfACubicAreThoseOfItsSamples) {
  for (int seed = 0; seed < 50; ++seed) {
    const JointPath q = randomPath(static_cast<std::uint64_t>(100 + seed), 4, 2);
    const TrajectoryPoint a{0, q[0], q[1]}, b{0.7, q[2], q[3]};
    Trajectory trajectory{{a, b}, {}};
    Eigen::VectorXd velocity, acceleration, seen = Eigen::VectorXd::Zero(2);
    cubicPeaks(a, b, velocity, acceleration);
    constexpr double h = 1e-4;
    for (double t = h; t < 0.7 - h; t += h) {
      seen =
          seen.cwiseMax(((positionAt(trajectory, 0, t + h) - positionAt(trajectory, 0, t - h)) / (2 * h)).cwiseAbs());
    }
    for (int j = 0; j < 2; ++j) EXPECT_NEAR(velocity[j], seen[j], 0.01 * (1 + seen[j]));
  }
}

}  // namespace
}  // namespace handhold
