#include "mesh/mass_properties.h"

#include "mesh/shapes.h"

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kExact = 1e-13;  // relative: sums of a dozen terms in double

// V = abc, inertia V (b^2 + c^2) / 12.
TEST(MassProperties, BoxHasTheClosedForm) {
  const MassProperties mass = massProperties(test::box({0, 0, 0}, {0.1, 0.2, 0.3}), true);
  EXPECT_NEAR(mass.volume, 0.006, 0.006 * kExact);
  EXPECT_NEAR(mass.area, 0.22, 0.22 * kExact);
  EXPECT_TRUE(mass.centerOfMass.isApprox(Vector3d(0.05, 0.1, 0.15), kExact));
  const Matrix3d wanted = Vector3d(0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04).asDiagonal() * (0.006 / 12);
  EXPECT_TRUE(mass.inertia.isApprox(wanted, kExact)) << mass.inertia;
  EXPECT_NEAR(mass.radius, std::sqrt(0.14) / 2, kExact);
}

// Moving an object moves its centre and leaves volume and inertia, even a kilometre away.
TEST(MassProperties, DoesNotDependOnTheOrigin) {
  const TriangleMesh near = test::box({-0.05, -0.1, -0.15}, {0.05, 0.1, 0.15});
  TriangleMesh far = near;
  const Vector3d offset(1000, -500, 250);
  for (auto& vertex : far.vertices) vertex += offset;
  const MassProperties a = massProperties(near, true);
  const MassProperties b = massProperties(far, true);
  constexpr double kFar = 1e-9;  // 1000 m in doubles leaves 1e-13 m
  EXPECT_NEAR(a.volume, b.volume, kFar * a.volume);
  EXPECT_TRUE(b.centerOfMass.isApprox(a.centerOfMass + offset, kFar));
  EXPECT_TRUE(b.inertia.isApprox(a.inertia, kFar));
}

// Corner tetrahedron with legs 1: V = 1/6, centre 1/4, integral of x^2 = 1/60, of xy = 1/120.
TEST(MassProperties, TetrahedronHasTheClosedForm) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  const MassProperties mass = massProperties(mesh, true);
  EXPECT_NEAR(mass.volume, 1.0 / 6, kExact);
  EXPECT_TRUE(mass.centerOfMass.isApprox(Vector3d::Constant(0.25), kExact));
  const double square = 1.0 / 60 - 1.0 / 96;
  const double product = 1.0 / 120 - 1.0 / 96;
  Matrix3d wanted = Matrix3d::Constant(-product);
  wanted.diagonal().setConstant(2 * square);
  EXPECT_TRUE(mass.inertia.isApprox(wanted, 1e-12)) << mass.inertia;
}

// A fine polyhedron tends to the ball from inside: volume 4/3 pi r^3, inertia 2/5 V r^2.
TEST(MassProperties, SphereIsApproached) {
  const double r = 0.05;
  const MassProperties mass = massProperties(test::sphere(r, 5), true);
  const double ball = 4.0 / 3 * std::numbers::pi * r * r * r;
  EXPECT_LT(mass.volume, ball);
  EXPECT_NEAR(mass.volume, ball, 0.003 * ball);
  EXPECT_NEAR(mass.inertia(0, 0), 0.4 * ball * r * r, 0.004 * 0.4 * ball * r * r);
  EXPECT_NEAR(mass.inertia(0, 1), 0, 1e-6 * mass.inertia(0, 0));
  EXPECT_NEAR(mass.radius, r, 1e-9);
}

// A cavity is subtracted.
TEST(MassProperties, CavityIsSubtracted) {
  const TriangleMesh mesh =
      test::joined(test::cube(0.1), test::insideOut(test::box({0.02, 0.02, 0.02}, {0.05, 0.05, 0.05})));
  const MassProperties mass = massProperties(mesh, true);
  EXPECT_NEAR(mass.volume, 1e-3 - 2.7e-5, 1e-12);
  EXPECT_NEAR(mass.centerOfMass.x(), (1e-3 * 0.05 - 2.7e-5 * 0.035) / (1e-3 - 2.7e-5), 1e-12);
}

// An open mesh counts by area: a square plate of side s has inertia A s^2 / 12 in its plane, A s^2 / 6 about its
// normal.
TEST(MassProperties, OpenMeshCountsByArea) {
  TriangleMesh plate;
  plate.vertices = {{1, 0, 0}, {1.2, 0, 0}, {1.2, 0.2, 0}, {1, 0.2, 0}};
  plate.triangles = {{0, 1, 2}, {0, 2, 3}};
  const MassProperties mass = massProperties(plate, false);
  EXPECT_EQ(mass.volume, 0);
  EXPECT_NEAR(mass.area, 0.04, 1e-15);
  EXPECT_TRUE(mass.centerOfMass.isApprox(Vector3d(1.1, 0.1, 0), 1e-12));
  const Matrix3d wanted = Vector3d(1, 1, 2).asDiagonal() * (0.04 * 0.04 / 12);
  EXPECT_TRUE(mass.inertia.isApprox(wanted, 1e-10)) << mass.inertia;
}

}  // namespace
}  // namespace handhold
