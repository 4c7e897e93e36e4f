#include "mesh/ray_scene.h"

#include "core/random.h"
#include "mesh/shapes.h"

#include <optional>
#include <thread>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kRayTol = 1e-6;  // relative to a size of 0.1 m: Embree computes in single precision

Vector3d randomPoint(const RandomStream& random, double halfSide) {
  return (2 * Vector3d(random.uniform(0), random.uniform(1), random.uniform(2)) - Vector3d::Ones()) * halfSide;
}

Vector3d randomDirection(const RandomStream& random) { return randomPoint(random.child(99), 1).normalized(); }

/// Solves o + t d = a + u (b - a) + v (c - a) in double.
std::optional<double> hitTriangle(const std::array<Vector3d, 3>& t, const Vector3d& origin, const Vector3d& direction) {
  Eigen::Matrix3d m;
  m << t[1] - t[0], t[2] - t[0], -direction;
  const Vector3d uvt = m.fullPivLu().solve(origin - t[0]);
  if (uvt[0] < 0 || uvt[1] < 0 || uvt[0] + uvt[1] > 1 || uvt[2] < 0) return std::nullopt;
  return uvt[2];
}

TEST(RayScene, AgreesWithBruteForce) {
  const TriangleMesh mesh = test::joined(test::sphere(0.1, 2), test::box({-0.02, -0.03, 0.05}, {0.04, 0.02, 0.2}));
  const RayScene scene(mesh);
  int hits = 0;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    const Vector3d origin = randomPoint(random, 0.25);
    const Vector3d direction = randomDirection(random);
    double nearest = std::numeric_limits<double>::infinity();
    std::size_t count = 0;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const auto distance = hitTriangle(mesh.corners(i), origin, direction);
      if (!distance) continue;
      nearest = std::min(nearest, *distance);
      ++count;
    }
    const RayHit hit = scene.cast(origin, direction);
    ASSERT_EQ(hit.missed(), count == 0);
    std::vector<RayCrossing> met;
    scene.crossings(origin, direction, met);
    EXPECT_EQ(met.size(), count);
    if (hit.missed()) continue;
    ++hits;
    EXPECT_NEAR(hit.distance, nearest, kRayTol);
    EXPECT_EQ(met.front().hit.distance, hit.distance);
  }
  EXPECT_GT(hits, 200);
}

TEST(RayScene, HitNamesTheTriangle) {
  const TriangleMesh mesh = test::cube(0.1);
  const RayHit hit = RayScene(mesh).cast({0.03, 0.06, 1}, {0, 0, -1});
  EXPECT_NEAR(hit.distance, 0.9, kRayTol);
  EXPECT_TRUE(mesh.normal(hit.triangle).isApprox(Vector3d::UnitZ()));
  EXPECT_TRUE(RayScene(mesh).cast({0.03, 0.06, 1}, {0, 0, 1}).missed());
}

// The diagonal of a face belongs to two triangles, and a corner of the octahedron to four: one crossing each.
TEST(RayScene, EdgesAndVerticesAreCrossedOnce) {
  const RayScene cube(test::cube(1));
  std::vector<RayCrossing> met;
  for (double x = 0.1; x < 1; x += 0.1) {
    cube.crossings({x, x, 0.5}, {0, 0, 1}, met);
    EXPECT_EQ(met.size(), 1U) << x;
    cube.crossings({x, x, -0.5}, {0, 0, 1}, met);
    ASSERT_EQ(met.size(), 2U) << x;
    EXPECT_EQ(met[0].sign, -1);
    EXPECT_EQ(met[1].sign, 1);
  }
  RayScene(test::sphere(1, 0)).crossings({0, 0, 0}, {0, 0, 1}, met);
  EXPECT_LE(met.size(), 1U);
}

TEST(RayScene, CavityIsOutside) {
  const RayScene scene(
      test::joined(test::cube(0.1), test::insideOut(test::box({0.03, 0.03, 0.03}, {0.07, 0.07, 0.07}))));
  EXPECT_TRUE(scene.contains({0.01, 0.05, 0.05}));
  EXPECT_FALSE(scene.contains({0.05, 0.05, 0.05}));
  EXPECT_FALSE(scene.contains({0.15, 0.05, 0.05}));
}

// Solids that overlap wind twice and are inside all the same; so is a point between parts that touch.
TEST(RayScene, OverlapIsInside) {
  const RayScene scene(test::joined(test::cube(0.1), test::box({0.05, 0, 0}, {0.15, 0.1, 0.1})));
  for (const double x : {0.02, 0.07, 0.12}) EXPECT_TRUE(scene.contains({x, 0.05, 0.05})) << x;
  EXPECT_FALSE(scene.contains({0.16, 0.05, 0.05}));
}

// An open box: the majority of the directions finds the middle inside and the outside outside.
TEST(RayScene, OpenMeshIsDecidedByMajority) {
  TriangleMesh mesh = test::cube(0.1);
  mesh.triangles.erase(mesh.triangles.begin() + 2, mesh.triangles.begin() + 4);
  const RayScene scene(mesh);
  EXPECT_TRUE(scene.contains({0.05, 0.05, 0.03}));
  EXPECT_FALSE(scene.contains({0.05, 0.05, -0.03}));
  EXPECT_FALSE(scene.contains({0.3, 0.3, 0.3}));
}

// The polyhedron lies between the balls of its smallest and largest face distance.
TEST(RayScene, ContainsAgreesWithTheSphere) {
  const TriangleMesh mesh = test::sphere(0.1, 4);
  double inner = 0.1;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    inner = std::min(inner, mesh.normal(i).dot(mesh.corners(i)[0]));
  const RayScene scene(mesh);
  int between = 0;
  for (std::uint64_t seed = 0; seed < 20000; ++seed) {
    const Vector3d point = randomPoint(RandomStream(seed), 0.12);
    if (point.norm() >= inner && point.norm() <= 0.1) {
      ++between;
    } else {
      EXPECT_EQ(scene.contains(point), point.norm() < inner) << seed;
    }
  }
  EXPECT_LT(between, 200);
}

// The centre and grid points of symmetric shapes look straight along edges of nothing, but near many of them.
TEST(RayScene, ContainsHoldsOnAGrid) {
  const RayScene scene(test::cube(1));
  for (int i = -4; i <= 12; ++i) {
    for (int j = -4; j <= 12; ++j) {
      for (int k = -4; k <= 12; ++k) {
        const Vector3d point = Vector3d(i, j, k) / 8;
        if (((point.array() == 0) || (point.array() == 1)).any()) continue;  // in the plane of a face
        const bool inside = ((point.array() > 0) && (point.array() < 1)).all();
        EXPECT_EQ(scene.contains(point), inside) << point.transpose();
      }
    }
  }
}

TEST(RayScene, EmptyMeshIsMissed) {
  const RayScene scene{TriangleMesh{}};
  EXPECT_TRUE(scene.cast({0, 0, 0}, {0, 0, 1}).missed());
  EXPECT_FALSE(scene.contains({0, 0, 0}));
}

TEST(RayScene, MovesAndThreads) {
  RayScene first(test::cube(1));
  RayScene scene(test::sphere(1, 1));
  scene = std::move(first);
  std::vector<int> inside(4, 0);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < inside.size(); ++t) {
    threads.emplace_back([&, t] {
      const RayScene own(test::sphere(0.1, 3));  // building is safe from many threads, too
      for (std::uint64_t i = 0; i < 2000; ++i) {
        const Vector3d point = randomPoint(RandomStream(i), 1.5);
        inside[t] += scene.contains(point) ? 1 : 0;
        inside[t] += own.contains(point) ? 1 : 0;
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_GT(inside[0], 0);
  for (const int count : inside) EXPECT_EQ(count, inside[0]);
}

}  // namespace
}  // namespace handhold
