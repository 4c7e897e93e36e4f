#include "physics/solid.h"

#include "core/random.h"
#include "mesh/primitives.h"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

TriangleMesh movedBox(const Vector3d& size, const Vector3d& center) {
  TriangleMesh mesh;
  append(mesh, boxMesh(size), Isometry3d(Eigen::Translation3d(center)));
  return mesh;
}

Vector3d randomPoint(const RandomStream& random, std::uint64_t i, double half) {
  const auto coordinate = [&](std::uint64_t k) { return half * (2 * random.uniform(3 * i + k) - 1); };
  return {coordinate(0), coordinate(1), coordinate(2)};
}

// The distance to a box in closed form: near a flat face interpolation is exact, across an edge off by half a cell.
TEST(DistanceField, OfABox) {
  const Vector3d half(0.02, 0.03, 0.01);
  const DistanceField field(boxMesh(2 * half), 1e-3);
  EXPECT_NEAR(field({0, 0, 0.0103}), 3e-4, 1e-7);
  EXPECT_NEAR(field({0.005, 0, 0.0097}), -3e-4, 1e-7);
  const RandomStream random(1);
  for (std::uint64_t i = 0; i < 5000; ++i) {
    const Vector3d p = randomPoint(random, i, 0.035);
    const Vector3d q = p.cwiseAbs() - half;
    const double exact = q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
    if (std::abs(exact) < 2e-3) {
      EXPECT_NEAR(field(p), exact, 5e-4) << p.transpose();
    } else {
      EXPECT_EQ(field(p) > 0, exact > 0) << p.transpose();
      EXPECT_LE(std::abs(field(p)), std::abs(exact) + 5e-4) << p.transpose();
    }
  }
}

// Two boxes that overlap are one solid: nothing of the faces inside is a surface.
TEST(Solid, PiecesThatOverlapAreOne) {
  TriangleMesh mesh = movedBox({0.04, 0.02, 0.02}, {0, 0, 0});
  append(mesh, movedBox({0.02, 0.02, 0.04}, {0, 0, 0.01}), Isometry3d::Identity());
  const Solid solid(mesh, 1e-3, 2e-3);
  EXPECT_LT(solid.field({0, 0, 0.009}), -3e-3);  // 1 mm below the first box's upper face
  for (const SurfacePoints::Point& point : solid.points.points()) {
    EXPECT_GT(solid.field(point.position), -6e-4) << point.position.transpose();
  }
}

// A cube with a cubic hole: the hole's wall is turned inside out.
TEST(Solid, AHoleIsOutside) {
  TriangleMesh mesh = boxMesh({0.04, 0.04, 0.04});
  TriangleMesh hole = boxMesh({0.02, 0.02, 0.02});
  for (auto& t : hole.triangles) std::swap(t[1], t[2]);
  append(mesh, hole, Isometry3d::Identity());
  const Solid solid(mesh, 1e-3, 2e-3);
  EXPECT_NEAR(solid.field({0, 0, 0.008}), 2e-3, 1e-6);
  EXPECT_NEAR(solid.field({0, 0, 0.012}), -2e-3, 1e-6);
}

TEST(Solid, TheSurfaceErrorIsThatOfTheGrid) {
  const SurfaceError error = surfaceError(Solid(sphereMesh(0.03), 1e-3, 2e-3));
  EXPECT_GT(error.largest, 0);
  EXPECT_LT(error.p95, 1e-4);
  EXPECT_LT(error.largest, 2e-4);
}

// What was remembered from other poses changes nothing.
TEST(TouchFinder, FindsTheSameFromWhereverItComes) {
  const Solid a(boxMesh({0.05, 0.04, 0.03}), 1e-3, 2e-3), b(sphereMesh(0.01), 7.5e-4, 2.5e-3);
  const RandomStream random(2);
  TouchFinder walker;
  std::vector<Touch> walked, fresh;
  Vector3d position(0.02, 0.01, 0.0246);
  std::size_t touches = 0;
  for (std::uint64_t i = 0; i < 500; ++i) {
    position += randomPoint(random, 2 * i, i % 50 == 0 ? 5e-3 : 2e-4);
    position.z() = std::clamp(position.z(), 0.024, 0.026);
    const Vector3d turn = randomPoint(random, 2 * i + 1, 0.02);
    const Isometry3d X = Eigen::Translation3d(position) * Eigen::AngleAxisd(turn.norm(), turn.normalized());
    walker.find(a, b, X, 1e-4, walked);
    TouchFinder().find(a, b, X, 1e-4, fresh);
    ASSERT_EQ(walked.size(), fresh.size()) << i;
    for (std::size_t k = 0; k < fresh.size(); ++k) {
      EXPECT_EQ(walked[k].position, fresh[k].position);
      EXPECT_EQ(walked[k].normal, fresh[k].normal);
      EXPECT_EQ(walked[k].distance, fresh[k].distance);
    }
    touches += fresh.size();
  }
  EXPECT_GT(touches, 100u);
}

// A pad over the edge of a box, 0.1 mm in it: every normal is that of the face on which it lies. An edge point must not
// push along the other face.
TEST(TouchFinder, APadOverAnEdgeIsPushedByTheFaceBelow) {
  const Solid box(boxMesh({0.04, 0.04, 0.04}), 1e-3, 2e-3), pad(boxMesh({0.02, 0.02, 0.01}), 7.5e-4, 2.5e-3);
  const Isometry3d X(Eigen::Translation3d(0.02, 0, 0.02 + 0.005 - 1e-4));
  std::vector<Touch> touches;
  TouchFinder().find(box, pad, X, 0, touches);
  keepSpread(touches, 4);
  ASSERT_EQ(touches.size(), 4u);
  for (const Touch& touch : touches) {
    EXPECT_GT(touch.normal.z(), 0.7) << touch.position.transpose();
    EXPECT_NEAR(touch.position.z(), 0.02, 2e-4);
  }
}

TEST(KeepSpread, TheDeepestIsFirstAndTheRestAreApart) {
  std::vector<Touch> touches;
  for (int i = 0; i < 20; ++i) {
    touches.push_back({Vector3d(0.001 * i, 0, 0), Vector3d::UnitZ(), i == 7 ? -2e-4 : -1.5e-4});
  }
  keepSpread(touches, 3);
  ASSERT_EQ(touches.size(), 3u);
  EXPECT_DOUBLE_EQ(touches[0].position.x(), 0.007);
  EXPECT_DOUBLE_EQ(touches[1].position.x(), 0.019);
  EXPECT_DOUBLE_EQ(touches[2].position.x(), 0.0);
}

// Two contacts at nearly one place are one.
TEST(KeepSpread, LeavesOutWhatIsTooClose) {
  std::vector<Touch> touches(5, {Vector3d::Zero(), Vector3d::UnitZ(), -1e-4});
  touches[3].position.x() = 0.001;
  keepSpread(touches, 4);
  EXPECT_EQ(touches.size(), 1u);
}

}  // namespace
}  // namespace handhold
