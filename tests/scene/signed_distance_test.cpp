// Signed distances against every triangle and every point, near and far.
#include "scene/signed_distance.h"

#include "mesh/object.h"
#include "scene/random_scenes.h"
#include "support/brute_force.h"

#include <cstdlib>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kRoundingTol = 1e-7;  // m; the grid stores floats

// The same by cases: outside the distance to the nearest point of the solid, inside the least depth.
double boxDistance(const Vector3d& p, const Vector3d& size) {
  const double outside = (p - p.cwiseMax(-size / 2).cwiseMin(size / 2)).norm();
  return outside > 0 ? outside : -(size / 2 - p.cwiseAbs()).minCoeff();
}

double cylinderDistance(const Vector3d& p, double radius, double length) {
  const double r = std::hypot(p.x(), p.y()), beyond = r - radius, above = std::abs(p.z()) - length / 2;
  if (beyond <= 0 && above <= 0) return -std::min(-beyond, -above);
  return std::hypot(std::max(beyond, 0.0), std::max(above, 0.0));
}

TEST(SignedDistance, IsExactForPrimitives) {
  const Vector3d size(0.1, 0.2, 0.05);
  const SignedDistance box(makeBoxShape(size)), cylinder(makeCylinderShape(0.03, 0.2)), ball(makeSphereShape(0.07));
  EXPECT_EQ(box.error(), 0);
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const Vector3d p = test::randomVector(RandomStream(i), 0.2);
    EXPECT_NEAR(box(p), boxDistance(p, size), 1e-15);
    EXPECT_NEAR(cylinder(p), cylinderDistance(p, 0.03, 0.2), 1e-15);
    EXPECT_NEAR(ball(p), p.norm() - 0.07, 1e-15);
  }
}

TEST(SignedDistance, IsExactForClouds) {
  for (const std::size_t count : {1, 7, 9, 1000}) {
    SCOPED_TRACE(count);
    std::vector<Vector3d> points;
    for (std::uint64_t i = 0; i < count; ++i) {
      points.push_back(test::randomVector(RandomStream(i).child(count), 0.3));
      if (i % 5 == 4) points.back().z() = 0;  // many with one coordinate
    }
    const auto shape = makePointsShape(points, 1e-4);
    const SignedDistance distance(shape);
    const auto& cloud = std::get<ObstacleShape::Points>(shape->kind);
    for (std::uint64_t i = 0; i < 500; ++i) {
      const Vector3d p = i % 10 == 0 ? cloud.points[i % cloud.points.size()]
                                     : test::randomVector(RandomStream(i).child(7), i % 2 == 0 ? 0.3 : 2);
      double nearest = 1e9;
      for (const Vector3d& q : cloud.points) nearest = std::min(nearest, (p - q).norm());
      EXPECT_NEAR(distance(p), nearest - cloud.radius, 1e-14);
    }
  }
}

double toMesh(const Vector3d& p, const ObstacleShape& shape) {
  const double distance = testing::distanceTo(p, shape.mesh);
  return shape.watertight && testing::windingNumber(p, shape.mesh) > 0.5 ? -distance : distance;
}

/// Returns how many of the points were inside.
int expectWithinError(const std::shared_ptr<const ObstacleShape>& shape, int count) {
  const SignedDistance distance(shape);
  const double error = distance.error() + kRoundingTol;
  const Eigen::AlignedBox3d box = boundingBox(shape->mesh);
  EXPECT_LT(error, 0.02 * box.diagonal().norm() + 1e-3);
  int inside = 0, outsideGrid = 0;
  for (int i = 0; i < count; ++i) {
    SCOPED_TRACE(i);
    const Vector3d spread = box.sizes().cwiseProduct(test::randomVector(RandomStream(i), i % 2 == 0 ? 0.6 : 1.5));
    const Vector3d p = box.center() + spread;
    const double exact = toMesh(p, *shape), found = distance(p);
    inside += exact < 0;
    if (box.exteriorDistance(p) < 1e-6) {
      EXPECT_NEAR(found, exact, error);
    } else {
      ++outsideGrid;
      EXPECT_LE(found, exact + error);                     // no more clearance than there is
      EXPECT_GE(found, (exact - error) / std::sqrt(2.0));  // and no less than 0.7 of it
    }
  }
  EXPECT_GT(outsideGrid, count / 5);
  return inside;
}

TEST(SignedDistance, OfMeshesIsWithinItsError) {
  EXPECT_GT(expectWithinError(makeMeshShape(test::hollowBall(0.08, 0.05)), 400), 20);
  const TriangleMesh two = test::joined(test::sphere(0.05, 2), test::box({0.06, 0, 0}, {0.2, 0.01, 0.02}));
  EXPECT_GT(expectWithinError(makeMeshShape(two), 400), 2);
  TriangleMesh open = test::sphere(0.05, 2);
  open.triangles.resize(open.triangles.size() / 2);
  EXPECT_EQ(expectWithinError(makeMeshShape(open), 300), 0);
  TriangleMesh flat;  // a square without thickness
  flat.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  flat.triangles = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_EQ(expectWithinError(makeMeshShape(flat), 300), 0);
}

TEST(SignedDistance, HasNoJumpWhereTheGridEnds) {
  const auto shape = makeMeshShape(test::sphere(0.05, 2));
  const SignedDistance distance(shape);
  for (std::uint64_t i = 0; i < 50; ++i) {
    const Vector3d direction = test::randomVector(RandomStream(i), 1).normalized();
    double last = distance(Vector3d::Zero());
    for (double t = 1e-4; t < 0.15; t += 1e-4) {
      const double here = distance(t * direction);
      EXPECT_LE(std::abs(here - last), 2e-4) << t;
      last = here;
    }
  }
}

TEST(SignedDistance, OfRealMeshesIsWithinItsError) {
  const char* data = std::getenv("HANDHOLD_DATA");
  if (data == nullptr) GTEST_SKIP() << "HANDHOLD_DATA is not set to the folder of the mesh collection";
  for (const char* file : {"ycb/035_power_drill.ply", "hard/scanned_mug_open.obj", "ycb/024_bowl.ply"}) {
    SCOPED_TRACE(file);
    expectWithinError(makeMeshShape(loadObject(std::string(data) + "/meshes/" + file, {1, true, "m"}).mesh), 60);
  }
}

}  // namespace
}  // namespace handhold
