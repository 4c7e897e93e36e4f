// The distance map against every ray on every triangle, and what it promises: moved scenes, points inside, the clamp.
#include "scene/distance_map.h"

#include "mesh/object.h"
#include "mesh/primitives.h"
#include "scene/random_scenes.h"
#include "support/allocations.h"
#include "support/brute_force.h"

#include <cstdlib>
#include <limits>
#include <numbers>
#include <thread>

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kRayTol = 2e-5;  // m; single precision within a metre, and what a ray starts behind its point
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Moeller, Trumbore 1997, in double.
double hitTriangle(const std::array<Vector3d, 3>& t, const Vector3d& origin, const Vector3d& direction) {
  const Vector3d e1 = t[1] - t[0], e2 = t[2] - t[0];
  const Vector3d p = direction.cross(e2);
  const double determinant = e1.dot(p);
  if (determinant == 0) return kInfinity;
  const Vector3d s = origin - t[0];
  const double u = s.dot(p) / determinant;
  if (u < 0 || u > 1) return kInfinity;
  const Vector3d q = s.cross(e1);
  const double v = direction.dot(q) / determinant;
  if (v < 0 || u + v > 1) return kInfinity;
  const double distance = e2.dot(q) / determinant;
  return distance >= 0 ? distance : kInfinity;
}

double castOnAll(const std::vector<Obstacle>& obstacles, const Vector3d& origin, const Vector3d& direction) {
  double nearest = kInfinity;
  for (const Obstacle& obstacle : obstacles) {
    const Vector3d o = obstacle.X_WS.inverse() * origin, d = obstacle.X_WS.inverse().linear() * direction;
    for (std::size_t i = 0; i < obstacle.shape->mesh.triangles.size(); ++i) {
      nearest = std::min(nearest, hitTriangle(obstacle.shape->mesh.corners(i), o, d));
    }
  }
  return nearest;
}

/// By definition where there is one, else by the surface's solid angle.
bool isInside(const Obstacle& obstacle, const Vector3d& p_W) {
  const Vector3d p = obstacle.X_WS.inverse() * p_W;
  if (const auto* box = std::get_if<ObstacleShape::Box>(&obstacle.shape->kind)) {
    return (p.array().abs() < box->size.array() / 2).all();
  }
  if (const auto* cylinder = std::get_if<ObstacleShape::Cylinder>(&obstacle.shape->kind)) {
    return std::abs(p.z()) < cylinder->length / 2 && std::hypot(p.x(), p.y()) < cylinder->radius;
  }
  if (const auto* ball = std::get_if<ObstacleShape::Sphere>(&obstacle.shape->kind)) return p.norm() < ball->radius;
  if (const auto* cloud = std::get_if<ObstacleShape::Points>(&obstacle.shape->kind)) {
    for (const Vector3d& centre : cloud->points) {
      if ((p - centre).norm() < cloud->radius) return true;
    }
    return false;
  }
  return obstacle.shape->watertight && testing::windingNumber(p, obstacle.shape->mesh) > 0.5;
}

struct Target {
  std::vector<float> points, normals;
  std::size_t size() const { return points.size() / 3; }
  Vector3d point(std::size_t i) const { return {points[3 * i], points[3 * i + 1], points[3 * i + 2]}; }
  Vector3d normal(std::size_t i) const { return {normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]}; }

  void add(const Vector3d& p, const Vector3d& n) {
    for (const double x : p) points.push_back(static_cast<float>(x));
    for (const double x : n) normals.push_back(static_cast<float>(x));
  }
};

Target randomTarget(const RandomStream& random, std::size_t count, double halfSide = 0.3) {
  Target target;
  for (std::size_t i = 0; i < count; ++i) {
    target.add(test::randomVector(random.child(i), halfSide),
               test::randomVector(random.child(i).child(1), 1).normalized());
  }
  return target;
}

std::vector<float> compute(const std::vector<Obstacle>& obstacles, const Target& target, const Isometry3d& X_WO,
                           const DistanceMapSettings& settings = {}) {
  SceneRays scene;
  scene.update(obstacles);
  std::vector<float> D;
  DistanceMap(settings).compute(scene, target.points, target.normals, X_WO, D);
  return D;
}

/// Equation (1) of README.md. The frame about a normal is the library's (Duff et al. 2017), written out again.
double byBruteForce(const std::vector<Obstacle>& obstacles, const Vector3d& p_W, const Eigen::Matrix3d& R_WO,
                    const Vector3d& n, const std::vector<Vector3d>& rays, double far) {
  for (const Obstacle& obstacle : obstacles) {
    if (isInside(obstacle, p_W)) return 0;
  }
  const double sign = n.z() < 0 ? -1 : 1, a = -1 / (sign + n.z()), b = n.x() * n.y() * a;
  Eigen::Matrix3d frame;
  frame.col(0) = Vector3d(1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x());
  frame.col(1) = Vector3d(b, sign + n.y() * n.y() * a, -n.y());
  frame.col(2) = n;
  double nearest = far;
  for (const Vector3d& ray : rays) nearest = std::min(nearest, castOnAll(obstacles, p_W, R_WO * (frame * ray)));
  return nearest;
}

TEST(DistanceMapRays, FillTheConeToItsRim) {
  for (const int count : {1, 2, 7, 32, 256}) {
    SCOPED_TRACE(count);
    DistanceMapSettings settings;
    settings.rays = count;
    const std::vector<Vector3d> rays = DistanceMap(settings).rays();
    ASSERT_EQ(rays.size(), static_cast<std::size_t>(count));
    EXPECT_EQ(rays[0], Vector3d::UnitZ());
    int onRim = 0;
    for (const Vector3d& ray : rays) {
      EXPECT_NEAR(ray.norm(), 1, 1e-12);
      EXPECT_GE(ray.z(), std::cos(settings.coneAngle) - 1e-12);
      onRim += ray.z() < std::cos(settings.coneAngle) + 1e-12;
    }
    EXPECT_EQ(onRim, count / 3);
  }
  // No direction of the cone is farther than a third of its half angle from a ray.
  const DistanceMapSettings settings;
  const std::vector<Vector3d> rays = DistanceMap(settings).rays();
  for (int i = 0; i < 2000; ++i) {
    const double angle = settings.coneAngle * std::sqrt((i % 40) / 39.0), turn = 2 * std::numbers::pi * i / 50;
    const Vector3d direction(std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn), std::cos(angle));
    double best = -1;
    for (const Vector3d& ray : rays) best = std::max(best, ray.dot(direction));
    EXPECT_LT(std::acos(std::min(1.0, best)), 0.34 * settings.coneAngle);
  }
}

TEST(DistanceMap, AgreesWithBruteForce) {
  int hits = 0, inside = 0, misses = 0;
  const DistanceMap map;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const RandomStream random(seed);
    const std::vector<Obstacle> obstacles = test::randomObstacles(random);
    const Target target = randomTarget(random.child(1), 60);
    const Isometry3d X_WO = test::randomPose(random.child(2), 0.1);
    const std::vector<float> D = compute(obstacles, target, X_WO);
    ASSERT_EQ(D.size(), target.size());
    for (std::size_t i = 0; i < D.size(); ++i) {
      SCOPED_TRACE(fmt::format("seed {}, point {}", seed, i));
      const double expected =
          byBruteForce(obstacles, X_WO * target.point(i), X_WO.linear(), target.normal(i), map.rays(), 0.5);
      EXPECT_NEAR(D[i], expected, kRayTol);
      hits += expected > 0 && expected < 0.5;
      inside += expected == 0;
      misses += expected == 0.5;
    }
  }
  EXPECT_GT(hits, 50);
  EXPECT_GT(inside, 5);
  EXPECT_GT(misses, 50);
}

// Two runs of one program and one and many threads give the same bits, whatever was computed before.
TEST(DistanceMap, IsDeterministic) {
  const RandomStream random(3);
  const std::vector<Obstacle> obstacles = test::randomObstacles(random);
  const Target target = randomTarget(random.child(1), 500);
  SceneRays scene;
  scene.update(obstacles);
  const DistanceMap map;
  std::vector<float> first;
  map.compute(scene, target.points, target.normals, Isometry3d::Identity(), first);
  std::vector<std::vector<float>> others(4);
  std::vector<std::thread> threads;
  for (auto& D : others) {
    threads.emplace_back([&] { map.compute(scene, target.points, target.normals, Isometry3d::Identity(), D); });
  }
  for (auto& thread : threads) thread.join();
  for (const auto& D : others) EXPECT_EQ(D, first);
  // The order of the points changes which ray goes first, but nothing that comes out.
  Target reversed;
  for (std::size_t i = target.size(); i-- > 0;) reversed.add(target.point(i), target.normal(i));
  std::vector<float> back;
  map.compute(scene, reversed.points, reversed.normals, Isometry3d::Identity(), back);
  std::reverse(back.begin(), back.end());
  EXPECT_EQ(back, first);
}

TEST(DistanceMap, MovesWithTheWorld) {
  int all = 0, edges = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const RandomStream random(seed);
    std::vector<Obstacle> obstacles = test::randomObstacles(random);
    const Target target = randomTarget(random.child(1), 200);
    const Isometry3d X_WO = test::randomPose(random.child(2), 0.1);
    const std::vector<float> before = compute(obstacles, target, X_WO);
    const Isometry3d X = test::randomPose(random.child(3), 1);
    for (Obstacle& obstacle : obstacles) obstacle.X_WS = X * obstacle.X_WS;
    const std::vector<float> after = compute(obstacles, target, X * X_WO);
    for (std::size_t i = 0; i < before.size(); ++i) {
      ++all;
      edges += std::abs(before[i] - after[i]) > kRayTol;
    }
  }
  EXPECT_LE(edges, 0.002 * all);  // rays that graze an edge, which single precision moves
}

TEST(DistanceMap, AMovedObstacleIsARebuiltScene) {
  const RandomStream random(8);
  std::vector<Obstacle> obstacles = test::randomObstacles(random);
  const Target target = randomTarget(random.child(1), 300);
  SceneRays scene;
  scene.update(obstacles);
  const DistanceMap map;
  std::vector<float> before, moved;
  map.compute(scene, target.points, target.normals, Isometry3d::Identity(), before);
  obstacles[1].X_WS = test::randomPose(random.child(5), 0.2);
  obstacles.erase(obstacles.begin());
  obstacles.push_back({"again", obstacles[1].shape, test::randomPose(random.child(6), 0.2)});
  scene.update(obstacles);
  map.compute(scene, target.points, target.normals, Isometry3d::Identity(), moved);
  EXPECT_NE(moved, before);
  EXPECT_EQ(moved, compute(obstacles, target, Isometry3d::Identity()));
}

TEST(DistanceMap, CountsFarWhereNothingIs) {
  const Target target = randomTarget(RandomStream(1), 50);
  DistanceMapSettings settings;
  settings.far = 0.25;
  for (const float d : compute({}, target, Isometry3d::Identity(), settings)) EXPECT_EQ(d, 0.25F);
  Target up;
  up.add({0, 0, 0}, {0, 0, 1});
  const auto plate = [](double z) {
    return std::vector<Obstacle>{
        {"plate", makeBoxShape({1, 1, 0.02}), Isometry3d(Eigen::Translation3d(0, 0, z + 0.01))}};
  };
  EXPECT_NEAR(compute(plate(0.2), up, Isometry3d::Identity(), settings)[0], 0.2, kRayTol);
  EXPECT_EQ(compute(plate(0.3), up, Isometry3d::Identity(), settings)[0], 0.25F);
}

// A plate above the point has its distance, a wall beside it none: the cone opens by 15 degrees.
TEST(DistanceMap, LooksAlongItsConeOnly) {
  Target up;
  up.add({0, 0, 0}, {0, 0, 1});
  const auto wall = [](double x) {
    return std::vector<Obstacle>{
        {"wall", makeBoxShape({0.02, 2, 2}), Isometry3d(Eigen::Translation3d(x + 0.01, 0, 0))}};
  };
  DistanceMapSettings settings;
  settings.far = 0.4;
  EXPECT_EQ(compute(wall(0.11), up, Isometry3d::Identity(), settings)[0], 0.4F);  // 0.11 / sin 15 = 0.425
  const float seen = compute(wall(0.05), up, Isometry3d::Identity(), settings)[0];
  EXPECT_NEAR(seen, 0.05 / std::sin(settings.coneAngle), 0.05 * 0.2);
  settings.rays = 1;  // the axis alone sees no wall
  EXPECT_EQ(compute(wall(0.05), up, Isometry3d::Identity(), settings)[0], 0.4F);
}

TEST(DistanceMap, APointInsideAnObstacleCountsZero) {
  Target target;
  for (const Vector3d& n : {Vector3d(0, 0, 1), Vector3d(1, 0, 0), Vector3d(0, -1, 0)}) target.add({0, 0, 0}, n);
  const TriangleMesh ball = test::sphere(0.3, 3);
  const auto at = [](const std::shared_ptr<const ObstacleShape>& shape) {
    return std::vector<Obstacle>{{"around", shape, Isometry3d(Eigen::Translation3d(0.01, 0.02, 0.03))}};
  };
  for (const auto& shape : {makeBoxShape({0.6, 0.6, 0.6}), makeCylinderShape(0.3, 0.6), makeSphereShape(0.3),
                            makeMeshShape(ball), makePointsShape({{0, 0, 0}}, 0.3)}) {
    for (const float d : compute(at(shape), target, Isometry3d::Identity())) EXPECT_EQ(d, 0);
  }
  // In the cavity of a hollow ball, and in one that has a hole, a point is not inside.
  TriangleMesh open = ball;
  open.triangles.pop_back();
  for (const auto& shape :
       {makeMeshShape(test::joined(ball, test::insideOut(test::sphere(0.2, 3)))), makeMeshShape(open)}) {
    for (const float d : compute(at(shape), target, Isometry3d::Identity())) EXPECT_GT(d, 0.1);
  }
}

// The bottom of a target that stands on its table touches, whichever side of the surface rounding puts it on; a face
// that looks up from a little higher is free.
TEST(DistanceMap, ATouchingPointHasNoClearance) {
  Target target;
  target.add({0.1, 0.1, 0}, {0, 0, -1});
  target.add({0.1, 0.1, 5e-5}, {0, 0, 1});
  for (const auto& slab : {makeBoxShape({2, 2, 1}), makeMeshShape(boxMesh({2, 2, 1}))}) {
    for (const double offset : {-3e-7, 0.0, 3e-7}) {
      SCOPED_TRACE(offset);
      const std::vector<Obstacle> obstacles = {{"slab", slab, Isometry3d(Eigen::Translation3d(0, 0, -0.5 + offset))}};
      const std::vector<float> D = compute(obstacles, target, Isometry3d::Identity());
      EXPECT_LE(D[0], 5e-7);
      EXPECT_EQ(D[1], 0.5F);
    }
  }
}

TEST(DistanceMap, TakesNothingFromTheHeapWhenItHasItsSize) {
  if (!testing::countsAllocations()) GTEST_SKIP() << "the sanitizer has a malloc of its own";
  const RandomStream random(2);
  SceneRays scene;
  scene.update(test::randomObstacles(random));
  const Target target = randomTarget(random.child(1), 300);
  const DistanceMap map;
  std::vector<float> D;
  map.compute(scene, target.points, target.normals, Isometry3d::Identity(), D);
  const long before = testing::allocations();
  map.compute(scene, target.points, target.normals, Isometry3d::Identity(), D);
  EXPECT_EQ(testing::allocations(), before);
}

TEST(SceneRays, CastAgreesWithBruteForce) {
  const RandomStream random(4);
  const std::vector<Obstacle> obstacles = test::randomObstacles(random);
  SceneRays scene;
  EXPECT_EQ(scene.cast({0, 0, 0}, {0, 0, 1}), kInfinity);
  scene.update(obstacles);
  int hits = 0;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    const Vector3d origin = test::randomVector(random.child(i), 0.4);
    const Vector3d direction = test::randomVector(random.child(i).child(1), 1).normalized();
    const double expected = castOnAll(obstacles, origin, direction);
    const double distance = scene.cast(origin, direction);
    ASSERT_EQ(std::isinf(distance), std::isinf(expected)) << i;
    if (std::isinf(expected)) continue;
    ++hits;
    EXPECT_NEAR(distance, expected, kRayTol);
  }
  EXPECT_GT(hits, 60);
}

TEST(SceneRays, AnEmptyCloudIsNowhere) {
  std::vector<Obstacle> obstacles = {{"cloud", makePointsShape({{0.1, 0, 0}}, 0.01)}};
  dropTargetPoints(test::sphere(0.1, 2), Isometry3d::Identity(), obstacles);
  SceneRays scene;
  scene.update(obstacles);
  EXPECT_EQ(scene.cast({0, 0, 0}, {1, 0, 0}), kInfinity);
}

// Real scans as obstacles, closed and open: the map against the plain definition on the same rays.
TEST(DistanceMap, AgreesWithBruteForceOnRealMeshes) {
  const char* data = std::getenv("HANDHOLD_DATA");
  if (data == nullptr) GTEST_SKIP() << "HANDHOLD_DATA is not set to the folder of the mesh collection";
  const auto load = [&](const char* file) {
    return makeMeshShape(loadObject(std::string(data) + "/meshes/" + file, {1, true, "m"}).mesh);
  };
  std::vector<Obstacle> obstacles = {
      {"drill", load("ycb/035_power_drill.ply"), Isometry3d(Eigen::Translation3d(0.1, 0, 0))},
      {"scan", load("hard/scanned_mug_open.obj"), Isometry3d(Eigen::Translation3d(-0.1, 0.05, 0))},
      {"mug", load("ycb/025_mug.ply"), Isometry3d(Eigen::Translation3d(0, -0.1, 0))}};
  const DistanceMap map;
  const Target target = randomTarget(RandomStream(1), 60, 0.15);
  const std::vector<float> D = compute(obstacles, target, Isometry3d::Identity());
  int hits = 0, inside = 0;
  for (std::size_t i = 0; i < D.size(); ++i) {
    const double expected = byBruteForce(obstacles, target.point(i), Eigen::Matrix3d::Identity(), target.normal(i),
                                         map.rays(), DistanceMapSettings{}.far);
    EXPECT_NEAR(D[i], expected, kRayTol) << i;
    hits += expected < 0.5;
    inside += expected == 0;
  }
  EXPECT_GT(hits, 20);
  EXPECT_GT(inside, 0);
}

}  // namespace
}  // namespace handhold
