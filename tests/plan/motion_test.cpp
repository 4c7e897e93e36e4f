// RRT-Connect around walls of a plane: found where there is a way, the same each time, and no claim where there is
// none.
#include "plan/motion.h"

#include <limits>
#include <numbers>

#include <gtest/gtest.h>

namespace handhold {
namespace {

/// A wall at x = 0.5 with a gap from `low` to `high`.
MotionSpace wallWithGap(double low, double high) {
  MotionSpace space;
  space.lower = Eigen::Vector2d(0, 0);
  space.upper = Eigen::Vector2d(1, 1);
  space.reach = Eigen::Vector2d(1, 1);
  space.isFree = [=](const Eigen::VectorXd& q) {
    return q.minCoeff() >= 0 && q.maxCoeff() <= 1 && (std::abs(q[0] - 0.5) > 0.02 || (q[1] > low && q[1] < high));
  };
  return space;
}

TEST(Motion, GoesThroughTheGap) {
  const MotionSpace space = wallWithGap(0.85, 0.95);
  const Eigen::Vector2d start(0.1, 0.1), goal(0.9, 0.1);
  const auto path = planMotion(space, start, goal, {});
  ASSERT_TRUE(path);
  EXPECT_TRUE(path->front().isApprox(start));
  EXPECT_TRUE(path->back().isApprox(goal));
  double length = 0;
  for (std::size_t i = 1; i < path->size(); ++i) {
    EXPECT_TRUE(space.isFree((*path)[i]));
    EXPECT_TRUE(lineIsFree(space, (*path)[i - 1], (*path)[i], 0.001));
    length += ((*path)[i] - (*path)[i - 1]).norm();
  }
  EXPECT_LT(length, 2.2);  // the shortest has 1.70
  const auto again = planMotion(space, start, goal, {});
  ASSERT_TRUE(again);
  EXPECT_EQ(*path, *again);
}

// Without limits the search goes as far as once around from start and goal, and no farther.
TEST(Motion, JointsWithoutLimitsGoOnceAround) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  MotionSpace space;
  space.lower = Eigen::Vector2d::Constant(-kInfinity);
  space.upper = Eigen::Vector2d::Constant(kInfinity);
  space.reach = Eigen::Vector2d(1, 1);
  double farthest = 0;
  space.isFree = [&](const Eigen::VectorXd& q) {
    farthest = std::max(farthest, q.cwiseAbs().maxCoeff());
    return std::abs(q[0] - 0.5) > 0.02 || q[1] > 2.5;
  };
  EXPECT_TRUE(planMotion(space, Eigen::Vector2d(0.1, 0), Eigen::Vector2d(0.9, 0), {}));
  EXPECT_GT(farthest, 2.5);
  EXPECT_LE(farthest, 0.9 + std::numbers::pi + 1e-6);
}

TEST(Motion, AFreeLineIsTaken) {
  const auto path = planMotion(wallWithGap(0, 1), Eigen::Vector2d(0.1, 0.2), Eigen::Vector2d(0.9, 0.3), {});
  ASSERT_TRUE(path);
  EXPECT_EQ(path->size(), 2u);
}

TEST(Motion, AClosedWallEndsByTheNumberOfChecks) {
  MotionSpace space = wallWithGap(2, 3);
  int checks = 0;
  space.isFree = [&checks, inner = space.isFree](const Eigen::VectorXd& q) { return ++checks, inner(q); };
  MotionSettings settings;
  settings.maxChecks = 3000;
  EXPECT_FALSE(planMotion(space, Eigen::Vector2d(0.1, 0.1), Eigen::Vector2d(0.9, 0.1), settings));
  EXPECT_GT(checks, 2000);
  EXPECT_LT(checks, 3500);
}

TEST(Motion, ABrakeEndsIt) {
  MotionSettings settings;
  int asked = 0;
  settings.stop = [&] { return ++asked > 3; };
  EXPECT_FALSE(planMotion(wallWithGap(2, 3), Eigen::Vector2d(0.1, 0.1), Eigen::Vector2d(0.9, 0.1), settings));
  EXPECT_EQ(asked, 4);
}

TEST(Motion, StartAndGoalMustBeFree) {
  const MotionSpace space = wallWithGap(0.4, 0.6);
  EXPECT_FALSE(planMotion(space, Eigen::Vector2d(0.5, 0.1), Eigen::Vector2d(0.9, 0.1), {}));
  EXPECT_FALSE(planMotion(space, Eigen::Vector2d(0.1, 0.1), Eigen::Vector2d(0.5, 0.9), {}));
}

}  // namespace
}  // namespace handhold
