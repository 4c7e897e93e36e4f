// Shapes enclose what they stand for, and clouds lose what belongs to the target.
#include "mesh/primitives.h"
#include "scene/random_scenes.h"
#include "scene/scene.h"
#include "support/brute_force.h"

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kFloatTol = 1e-6;  // m; vertices are 32-bit floats

/// No face of the convex polyhedron cuts the solid of that support function, and no vertex is `most` beyond it.
template <typename Support>
void expectEncloses(const TriangleMesh& mesh, const Support& support, double most) {
  double outermost = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Vector3d normal = mesh.normal(i);
    const double room = normal.dot(mesh.corners(i)[0]) - support(normal);
    EXPECT_GE(room, 0) << "a face cuts the solid";
  }
  for (const Vector3d& vertex : mesh.vertices) {
    outermost = std::max(outermost, vertex.norm() - support(vertex.normalized()));
  }
  EXPECT_LT(outermost, most);
}

TEST(Shapes, PolyhedraEncloseTheTrueSolids) {
  for (const double radius : {0.005, 0.03, 0.2, 1.0}) {
    SCOPED_TRACE(radius);
    expectEncloses(
        makeSphereShape(radius)->mesh, [&](const Vector3d&) { return radius; }, 1e-3 + 0.2 * radius);
    const double half = 0.1;
    const auto cylinder = makeCylinderShape(radius, 2 * half);
    expectEncloses(
        cylinder->mesh, [&](const Vector3d& n) { return radius * n.head<2>().norm() + half * std::abs(n.z()); },
        1e-3 + 0.04 * radius);
    EXPECT_LT(boundingBox(cylinder->mesh).sizes().x() / 2, std::max(radius + 2e-3, 1.04 * radius));
  }
  const auto ball = makePointsShape({{0, 0, 0}}, 0.01);
  EXPECT_EQ(ball->mesh.triangles.size(), 20U);
  expectEncloses(
      ball->mesh, [](const Vector3d&) { return 0.01; }, 0.003);
}

TEST(Shapes, AreClosedOutwardAndInFloats) {
  for (const auto& shape : {makeBoxShape({0.1, 0.2, 0.3}), makeCylinderShape(0.03, 0.2), makeSphereShape(0.05),
                            makePointsShape({{0, 0, 0}, {1, 0, 0}}, 0.02)}) {
    EXPECT_TRUE(shape->watertight);
    EXPECT_TRUE(isWatertight(shape->mesh));
    EXPECT_GT(test::volume(shape->mesh), 0);
    TriangleMesh rounded = shape->mesh;
    roundToFloat(rounded);
    EXPECT_EQ(rounded.vertices, shape->mesh.vertices);
  }
  TriangleMesh open = boxMesh({1, 1, 1});
  open.triangles.pop_back();
  EXPECT_FALSE(makeMeshShape(open)->watertight);
}

TEST(Shapes, EveryPieceHasAPoint) {
  EXPECT_EQ(makeBoxShape({1, 1, 1})->piecePoints.size(), 1U);
  const TriangleMesh two = test::joined(test::box({0, 0, 0}, {1, 1, 1}), test::box({2, 0, 0}, {3, 1, 1}));
  const auto shape = makeMeshShape(two);
  ASSERT_EQ(shape->piecePoints.size(), 2U);
  EXPECT_LE(shape->piecePoints[0].x(), 1);
  EXPECT_GE(shape->piecePoints[1].x(), 2);
  EXPECT_EQ(makePointsShape({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, 0.1)->piecePoints.size(), 3U);
}

TEST(Shapes, AThinnedCloudCoversTheDenseOne) {
  std::vector<Vector3d> points;
  const RandomStream random(5);
  for (std::uint64_t i = 0; i < 3000; ++i) points.push_back(test::randomVector(random.child(i), 0.05));
  constexpr double kRadius = 0.02;
  const auto shape = makePointsShape(points, kRadius);
  const auto& cloud = std::get<ObstacleShape::Points>(shape->kind);
  EXPECT_LT(cloud.points.size(), points.size() / 2);
  EXPECT_LE(cloud.radius, kRadius * (1 + std::sqrt(3.0) / 2));
  for (const Vector3d& p : points) {  // the ball about p lies in the ball about a kept point
    double nearest = 1;
    for (const Vector3d& kept : cloud.points) nearest = std::min(nearest, (p - kept).norm());
    EXPECT_LE(nearest + kRadius, cloud.radius + 1e-12);
  }
}

TEST(DropTargetPoints, DropsExactlyWhatReachesTheTarget) {
  const TriangleMesh target = test::hollowBall(0.05, 0.03);
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    std::vector<Vector3d> points;
    for (std::uint64_t i = 0; i < 300; ++i) points.push_back(test::randomVector(random.child(i), 0.08));
    const Eigen::Isometry3d X_WO = test::randomPose(random.child(1000), 0.3);
    const Eigen::Isometry3d X_WS = X_WO * Eigen::Translation3d(0.01, 0, 0);
    std::vector<Obstacle> obstacles = {{"cloud", makePointsShape(points, 0.002), X_WS},
                                       {"box", makeBoxShape({0.01, 0.01, 0.01}), X_WO}};
    const auto before = obstacles;
    const std::size_t dropped = dropTargetPoints(target, X_WO, obstacles);
    EXPECT_EQ(obstacles[1].shape, before[1].shape);
    const auto& all = std::get<ObstacleShape::Points>(before[0].shape->kind);
    const auto& kept = std::get<ObstacleShape::Points>(obstacles[0].shape->kind);
    EXPECT_EQ(dropped, all.points.size() - kept.points.size());
    EXPECT_GT(dropped, 10U);
    EXPECT_GT(kept.points.size(), 10U);
    EXPECT_EQ(kept.radius, all.radius);
    double reach = 0;
    const auto ball = makePointsShape({{0, 0, 0}}, all.radius);
    for (const Vector3d& vertex : ball->mesh.vertices) reach = std::max(reach, vertex.norm());
    std::size_t next = 0;
    for (const Vector3d& p_S : all.points) {
      const Vector3d p_O = X_WO.inverse() * X_WS * p_S;
      const double distance = testing::distanceTo(p_O, target);
      if (std::abs(distance - reach) < kFloatTol) continue;
      const bool isKept = next < kept.points.size() && kept.points[next] == p_S;
      EXPECT_EQ(isKept, distance > reach && testing::windingNumber(p_O, target) < 0.5);
      next += isKept;
    }
    EXPECT_EQ(next, kept.points.size());
  }
}

TEST(DropTargetPoints, AFarCloudKeepsItsShape) {
  std::vector<Obstacle> obstacles = {{"cloud", makePointsShape({{1, 0, 0}, {0, 2, 0}}, 0.01)}};
  const auto shape = obstacles[0].shape;
  EXPECT_EQ(dropTargetPoints(test::sphere(0.1, 2), Eigen::Isometry3d::Identity(), obstacles), 0U);
  EXPECT_EQ(obstacles[0].shape, shape);
}

TEST(DropTargetPoints, ACloudOfTheTargetAloneBecomesEmpty) {
  std::vector<Obstacle> obstacles = {{"cloud", makePointsShape({{0.1, 0, 0}, {0, 0.1, 0}}, 0.01)}};
  EXPECT_EQ(dropTargetPoints(test::sphere(0.1, 2), Eigen::Isometry3d::Identity(), obstacles), 2U);
  EXPECT_TRUE(obstacles[0].shape->mesh.triangles.empty());
}

}  // namespace
}  // namespace handhold
