// The distance grid of a link against every triangle.
#include "simulate/link_grid.h"

#include "core/random.h"
#include "hand/hand.h"
#include "mesh/primitives.h"
#include "mesh/ray_scene.h"
#include "mesh/shapes.h"
#include "simulate/contacts.h"
#include "simulate/fast_kernels.h"
#include "support/brute_force.h"

#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using testing::distanceTo;

constexpr double kRounding = 1e-6;  // m, of single precision and of what errors are rounded up by
constexpr int kPoints = 2000;

/// A box with a post that stands in it, 12 mm wide, 16 mm deep: an L of two overlapping pieces.
TriangleMesh ell() {
  return test::joined(test::box({0, 0, 0}, {0.06, 0.02, 0.02}), test::box({0.004, 0.004, 0.004}, {0.016, 0.06, 0.016}));
}

/// Two triangles with corners `a`, `a + u`, `a + u + v`, `a + v`.
void addRectangle(TriangleMesh& mesh, const Vector3d& a, const Vector3d& u, const Vector3d& v) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), {a, a + u, a + u + v, a + v});
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 2, first + 3});
}

/// The sides of a box that has no faces across y.
void addSleeve(TriangleMesh& mesh, const Vector3d& low, const Vector3d& high) {
  const Vector3d size = high - low, x(size.x(), 0, 0), y(0, size.y(), 0), z(0, 0, size.z());
  for (const Vector3d& a : {low, Vector3d(low + z)}) addRectangle(mesh, a, x, y);
  for (const Vector3d& a : {low, Vector3d(low + x)}) addRectangle(mesh, a, y, z);
}

/// What of the L can be touched: its surface without what lies in the other piece. Not oriented.
TriangleMesh ellOutside() {
  TriangleMesh mesh;
  addSleeve(mesh, {0, 0, 0}, {0.06, 0.02, 0.02});
  addRectangle(mesh, {0, 0, 0}, {0.06, 0, 0}, {0, 0, 0.02});
  // The upper face around the post.
  const double x[] = {0, 0.004, 0.016, 0.06}, z[] = {0, 0.004, 0.016, 0.02};
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) {
      if (i == 1 && k == 1) continue;
      addRectangle(mesh, {x[i], 0.02, z[k]}, {x[i + 1] - x[i], 0, 0}, {0, 0, z[k + 1] - z[k]});
    }
  }
  addSleeve(mesh, {0.004, 0.02, 0.004}, {0.016, 0.06, 0.016});
  addRectangle(mesh, {0.004, 0.06, 0.004}, {0.012, 0, 0}, {0, 0, 0.012});
  return mesh;
}

TriangleMesh cylinder() { return cylinderMesh(0.0123, 0.05); }

/// A shape, its grid and the truth about both.
struct Measured {
  TriangleMesh mesh;
  TriangleMesh surface;  // without what lies inside another piece
  LinkGrid grid;
  RayScene scene;

  explicit Measured(const TriangleMesh& shape) : Measured(shape, shape) {}
  Measured(const TriangleMesh& shape, const TriangleMesh& outside)
      : mesh(rounded(shape)), surface(rounded(outside)), grid(mesh), scene(mesh) {}

  static TriangleMesh rounded(TriangleMesh mesh) {
    roundToFloat(mesh);
    return mesh;
  }

  /// Signed distances to what can be touched, and to any triangle at all: inside they differ where pieces overlap.
  double truth(const Vector3d& p) const { return sign(p) * distanceTo(p, surface); }
  double toAnyTriangle(const Vector3d& p) const { return sign(p) * distanceTo(p, mesh); }
  double sign(const Vector3d& p) const { return scene.contains(p) ? -1 : 1; }

  /// Half of the points in and around the shape, up to twice the grid's margin; the others within the band around its
  /// surface.
  Vector3d point(int i) const {
    const RandomStream stream = RandomStream(5).child(i);
    if (i % 2 == 0) {
      const Eigen::AlignedBox3d box = boundingBox(mesh);
      const Vector3d u(stream.uniform(0), stream.uniform(1), stream.uniform(2));
      return box.min().array() - 2 * LinkGrid::kMargin + u.array() * (box.sizes().array() + 4 * LinkGrid::kMargin);
    }
    const std::size_t t = stream.bits(3) % mesh.triangles.size();
    const auto [a, b, c] = mesh.corners(t);
    const double root = std::sqrt(stream.uniform(4)), v = stream.uniform(5);
    return (1 - root) * a + root * (1 - v) * b + root * v * c +
           LinkGrid::kBand * (2 * stream.uniform(6) - 1) * mesh.normal(t);
  }
};

/// Trilinear interpolation of the distance; +inf outside.
double interpolated(const LinkGrid& grid, const Vector3d& p) {
  const Lattice<float>& lattice = grid.distance;
  int at[3];
  double f[3];
  for (int i = 0; i < 3; ++i) {
    const double u = (p[i] - lattice.origin[i]) / lattice.step;
    at[i] = static_cast<int>(std::floor(u));
    f[i] = u - at[i];
    if (at[i] < 0 || at[i] + 1 >= lattice.size[i]) return std::numeric_limits<double>::infinity();
  }
  double distance = 0;
  for (int c = 0; c < 8; ++c) {
    const int x = c & 1, y = c >> 1 & 1, z = c >> 2;
    distance += (x ? f[0] : 1 - f[0]) * (y ? f[1] : 1 - f[1]) * (z ? f[2] : 1 - f[2]) *
                lattice.value[lattice.index(at[0] + x, at[1] + y, at[2] + z)];
  }
  return distance;
}

std::set<std::uint32_t> keptTriangles(const LinkGrid& grid) { return {grid.source.begin(), grid.source.end()}; }

/// The shipped Barrett hand's first link of that name.
TriangleMesh barrettLink(const std::string& name) {
  const Hand hand = loadHand(HANDHOLD_SOURCE_DIR "/hands/barrett");
  for (const Link& link : hand.links) {
    if (link.name == name) return link.mesh;
  }
  throw std::runtime_error("no link " + name);
}

/// The link without the triangles that the grid leaves out; AnOmittedTriangleIsHiddenEverywhere holds that they are
/// hidden.
TriangleMesh withoutOmitted(const TriangleMesh& mesh) {
  TriangleMesh kept{mesh.vertices, {}};
  for (const std::uint32_t i : keptTriangles(LinkGrid(mesh))) kept.triangles.push_back(mesh.triangles[i]);
  return kept;
}

Measured shape(const std::string& name) {
  if (name == "box") return Measured(test::box({-0.01, 0, 0.003}, {0.02, 0.017, 0.05}));
  if (name == "cylinder") return Measured(cylinder());
  if (name == "ell") return Measured(ell(), ellOutside());
  const TriangleMesh link = barrettLink("finger_1_distal_link");
  return Measured(link, withoutOmitted(link));
}

class ClosedShape : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(All, ClosedShape, ::testing::Values("box", "cylinder", "ell", "barrett"),
                         [](const auto& item) { return std::string(item.param); });

// Beyond the band values are distances that are too small: inside they bound from above alone, outside from below.
TEST_P(ClosedShape, BoundsEncloseTheSignedDistance) {
  const Measured m = shape(GetParam());
  EXPECT_TRUE(m.grid.closed);
  const double reach = LinkGrid::kBand - 0.5 * std::sqrt(3.0) * m.grid.distance.step;
  int inside = 0, near = 0, outsideTheLattice = 0;
  for (int i = 0; i < kPoints; ++i) {
    const Vector3d p = m.point(i);
    // Faces that lie half inside another piece count as a whole: there the grid sees a surface a little too early.
    const double truth = m.truth(p), low = m.toAnyTriangle(p);
    SCOPED_TRACE(::testing::Message() << "point " << p.transpose() << ", distance " << truth << ", to any triangle "
                                      << low);
    const double lower = m.grid.lowerBound(p), upper = m.grid.upperBound(p);
    EXPECT_LE(lower, upper);
    EXPECT_TRUE(truth <= -reach || lower <= std::max(truth, low) + kRounding) << lower;
    EXPECT_TRUE(truth >= reach || upper >= truth - kRounding) << upper;
    EXPECT_TRUE(truth >= 0 || lower <= 0) << lower;
    inside += truth < 0;
    near += std::abs(truth) < reach;
    outsideTheLattice += upper == std::numeric_limits<double>::infinity();
  }
  EXPECT_GT(inside, kPoints / 20);
  EXPECT_GT(near, kPoints / 4);
  EXPECT_GT(outsideTheLattice, kPoints / 20);
}

// At the nodes within the band the distance is no bound but the distance.
TEST_P(ClosedShape, NodesWithinTheBandAreExact) {
  const Measured m = shape(GetParam());
  const Lattice<float>& lattice = m.grid.distance;
  int within = 0;
  for (int i = 0; i < kPoints; ++i) {
    const RandomStream stream = RandomStream(6).child(i);
    const int x = static_cast<int>(stream.bits(0) % lattice.size[0]);
    const int y = static_cast<int>(stream.bits(1) % lattice.size[1]);
    const int z = static_cast<int>(stream.bits(2) % lattice.size[2]);
    const Vector3d p = lattice.node(x, y, z);
    const double truth = m.truth(p), value = lattice.value[lattice.index(x, y, z)];
    SCOPED_TRACE(::testing::Message() << "node " << p.transpose());
    if (std::abs(truth) >= LinkGrid::kBand) {
      EXPECT_LE(std::abs(value), std::abs(truth) + kRounding);
      EXPECT_GE(value * truth, 0);
      continue;
    }
    ++within;
    EXPECT_LE(value, std::max(truth, m.toAnyTriangle(p)) + kRounding);
    EXPECT_GE(value, truth - kRounding);
  }
  EXPECT_GT(within, kPoints / 10);
}

TEST_P(ClosedShape, NodePairsHoldTheDistancesRoundedDown) {
  const Measured m = shape(GetParam());
  const Lattice<float>& lattice = m.grid.distance;
  ASSERT_EQ(m.grid.nodePairs.size(), lattice.value.size());
  constexpr float kMost = 32767 * LinkGrid::kUnit;
  const auto agrees = [&](std::int32_t units, float value) {
    const float below = std::clamp(value, -kMost, kMost) / LinkGrid::kUnit - static_cast<float>(units);
    return below > -0.01F && below < 1.01F;
  };
  for (std::size_t i = 0; i + 1 < lattice.value.size(); ++i) {
    const std::int32_t here = static_cast<std::int16_t>(m.grid.nodePairs[i] & 0xFFFF), next = m.grid.nodePairs[i] >> 16;
    ASSERT_TRUE(agrees(here, lattice.value[i])) << here << " for " << lattice.value[i];
    ASSERT_TRUE(agrees(next, lattice.value[i + 1])) << next << " for " << lattice.value[i + 1];
  }
}

/// No kept part of the surface within the reach of a node may rise above its plane; where the surface is beyond the
/// reach the planes say no more than that. On convex shapes planes are tangent.
void expectPlanesHold(const Measured& m, const Planes& planes, bool isConvex) {
  const auto& lattice = planes.nodes;
  ASSERT_EQ(lattice.value.size(), lattice.index(0, 0, lattice.size[2]));
  const double reach = static_cast<double>(planes.reach);
  const std::set<std::uint32_t> kept = keptTriangles(m.grid);
  const std::vector<std::uint32_t> triangles(kept.begin(), kept.end());
  int known = 0, tangent = 0, compared = 0, far = 0;
  for (int i = 0; i < 3000; ++i) {
    const RandomStream stream = RandomStream(21).child(i);
    std::array<int, 3> at{};
    for (int k = 0; k < 3; ++k) at[k] = static_cast<int>(stream.bits(k) % lattice.size[k]);
    const Vector3d n = lattice.node(at[0], at[1], at[2]);
    const auto& plane = lattice.value[lattice.index(at[0], at[1], at[2])];
    const Vector3d g = Vector3d(plane[0], plane[1], plane[2]) / Planes::kDirectionUnit;
    const double height = plane[3] * static_cast<double>(Planes::kUnit), distance = distanceTo(n, m.surface);
    if (g.isZero()) {
      ++far;
      EXPECT_GE(distance, reach - kRounding);
      EXPECT_LE(height, reach);
      continue;
    }
    ++known;
    EXPECT_NEAR(g.norm(), 1, 1e-4);
    EXPECT_LE(height, distance);
    tangent += height > distance - 5e-6;
    for (int j = 0; j < 60; ++j) {
      const auto [a, b, c] = m.mesh.corners(triangles[stream.bits(3 * j + 3) % triangles.size()]);
      const double root = std::sqrt(stream.uniform(3 * j + 4)), v = stream.uniform(3 * j + 5);
      const Vector3d x = (1 - root) * a + root * (1 - v) * b + root * v * c;
      if ((x - n).norm() > reach) continue;
      ++compared;
      EXPECT_LE(g.dot(x - n), -height) << "node " << n.transpose() << ", surface " << x.transpose();
    }
  }
  EXPECT_GT(known, 500);
  EXPECT_GT(far, 100);
  EXPECT_GT(compared, 200);
  if (isConvex) {
    EXPECT_GT(tangent, known / 3) << "of " << known;
  }
}

TEST_P(ClosedShape, NothingNearRisesAboveTheNodesPlane) {
  const Measured m = shape(GetParam());
  const bool isConvex = GetParam() == std::string("box") || GetParam() == std::string("cylinder");
  expectPlanesHold(m, m.grid.planes, isConvex);
  expectPlanesHold(m, m.grid.blockPlanes, isConvex);
}

// The kernel drops no small triangle that comes within the margin of the surface, and most of those that do not.
TEST_P(ClosedShape, NearTrianglesHoldAllWithinTheMargin) {
  constexpr float kMargin = 2e-4F;  // m
  const Measured m = shape(GetParam());
  ObjectModel object;
  object.mesh = test::box({0, 0, 0}, {0.04, 0.03, 0.02});
  const ObjectShell shell(object);
  std::vector<std::uint32_t> blocks(shell.triangleTree.blocks.size() + kernels::kGroup);
  std::vector<std::uint32_t> scratch(shell.source.size() + kernels::kGroup), ids(scratch);
  std::size_t within = 0, found = 0;
  for (int i = 0; i < 60; ++i) {
    const RandomStream stream = RandomStream(22).child(i);
    // A face, an edge or a corner of the box comes to a point of the surface.
    const Vector3d axis = Vector3d(stream.uniform(0) - 0.5, stream.uniform(1) - 0.5, stream.uniform(2) - 0.5);
    Eigen::Isometry3d X = Eigen::Isometry3d(Eigen::AngleAxisd(6 * stream.uniform(3), axis.normalized()));
    const auto [a, b, c] = m.mesh.corners(stream.bits(4) % m.mesh.triangles.size());
    const Vector3d target = (a + b + c) / 3;
    const std::size_t piece = stream.bits(5) % shell.source.size();
    const Vector3d corner(shell.triangle[piece].value[0], shell.triangle[piece].value[1],
                          shell.triangle[piece].value[2]);
    X.translation() = target - X.linear() * corner;
    const kernels::PlacedGrid placed = {&m.grid, Placement::of(X)};
    const std::size_t met = kernels::nearBoxes(placed, shell, kMargin, blocks.data());
    const std::size_t count =
        kernels::nearTriangles(placed, shell, {blocks.data(), met}, kMargin, scratch.data(), ids.data());
    const std::set<std::uint32_t> listed(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(count));
    found += listed.size();
    for (std::uint32_t t = 0; t < shell.source.size(); ++t) {
      const auto& v = shell.triangle[t].value;
      bool isNear = false;
      for (int j = 0; j < 28 && !isNear; ++j) {  // points of a triangular net
        const int row = j / 7, column = j % 7;
        const double u = column / 6.0, w = (1 - u) * row / 3.0;
        const Vector3d p =
            X * Vector3d((1 - u - w) * v[0] + u * v[3] + w * v[6], (1 - u - w) * v[1] + u * v[4] + w * v[7],
                         (1 - u - w) * v[2] + u * v[5] + w * v[8]);
        if (std::abs(m.grid.lowerBound(p)) > 3e-3) continue;  // far for sure
        isNear = distanceTo(p, m.surface) < kMargin - kRounding;
      }
      within += isNear;
      EXPECT_TRUE(!isNear || listed.contains(t)) << "small triangle " << t << " in place " << i;
    }
  }
  EXPECT_GT(within, 100U);
  EXPECT_LT(found, 6 * within);
}

// Of a small triangle the pairs hold every kept triangle that one of its corners comes within the reach of.
TEST_P(ClosedShape, PairsHoldEveryTriangleWithinReach) {
  constexpr float kReach = 1e-3F;  // m
  constexpr double kSize = 2e-3;   // m
  const Measured m = shape(GetParam());
  const std::set<std::uint32_t> kept = keptTriangles(m.grid);
  std::size_t within = 0, found = 0;
  kernels::NearTriangles near;
  kernels::Pairs pairs;
  for (int i = 0; i < kPoints; ++i) {
    const RandomStream stream = RandomStream(8).child(i);
    Corners corners;
    for (int k = 0; k < 3; ++k) {
      corners[k] =
          m.point(i) + kSize * Vector3d(stream.uniform(3 * k), stream.uniform(3 * k + 1), stream.uniform(3 * k + 2));
    }
    const Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
    near.id = {0};
    Record record;
    for (int k = 0; k < 9; ++k) record.value[k] = static_cast<float>(corners[k / 3][k % 3]);
    for (int k = 0; k < 3; ++k) record.value[9 + k] = static_cast<float>(normal[k]);
    near.record.assign(kernels::kGroup, record);
    kernels::findPairs(m.grid, near, kReach, false, pairs);
    std::multiset<std::uint32_t> listed;
    for (std::size_t j = 0; j < pairs.count; ++j) listed.insert(m.grid.source[pairs.b[j]]);
    found += pairs.count;
    for (const std::uint32_t t : kept) {
      EXPECT_LE(listed.count(t), 1U) << "triangle " << t;
      const Corners other = m.mesh.corners(t);
      const bool isNear = std::any_of(corners.begin(), corners.end(), [&](const Vector3d& p) {
        return (closestPointOnTriangle(p, other) - p).norm() < kReach - 1e-7;
      });
      EXPECT_TRUE(!isNear || listed.contains(t)) << "triangle " << t << " at " << corners[0].transpose();
      within += isNear;
    }
  }
  EXPECT_GT(within, 500U);
  EXPECT_LT(found, kPoints * kept.size() / 8);
}

// Left out is only what lies inside: dense points of an omitted triangle, 10 um outwards, are all enclosed.
TEST_P(ClosedShape, AnOmittedTriangleIsHiddenEverywhere) {
  const Measured m = shape(GetParam());
  const std::set<std::uint32_t> kept = keptTriangles(m.grid);
  for (std::uint32_t t = 0; t < m.mesh.triangles.size(); ++t) {
    if (kept.contains(t)) continue;
    const auto [a, b, c] = m.mesh.corners(t);
    constexpr int kFine = 24;
    int exposed = 0;
    for (int i = 0; i <= kFine; ++i) {
      for (int k = 0; i + k <= kFine; ++k) {
        const double u = 0.001 + 0.997 * i / kFine, v = 0.001 + 0.997 * k / kFine;
        exposed += !m.scene.contains(a + u * (b - a) + v * (c - a) + 1e-5 * m.mesh.normal(t));
      }
    }
    EXPECT_EQ(exposed, 0) << "triangle " << t;
  }
}

TEST(LinkGrid, LeavesOutTheEndOfThePostInsideTheOtherPiece) {
  const Measured m(ell(), ellOutside());
  const std::set<std::uint32_t> kept = keptTriangles(m.grid);
  EXPECT_EQ(kept.size(), m.mesh.triangles.size() - 2);
  for (std::uint32_t t = 0; t < m.mesh.triangles.size(); ++t) {
    const auto [a, b, c] = m.mesh.corners(t);
    const bool isHiddenEnd = a.y() == b.y() && b.y() == c.y() && a.y() == static_cast<double>(0.004F);
    EXPECT_EQ(kept.contains(t), !isHiddenEnd) << "triangle " << t;
  }
}

TEST(LinkGrid, LeavesOutAPieceThatIsWhollyInside) {
  const TriangleMesh cube = test::cube(0.03);
  const Measured m(test::joined(cube, test::box({0.01, 0.01, 0.01}, {0.02, 0.02, 0.02})), cube);
  EXPECT_EQ(keptTriangles(m.grid).size(), 12U);
  EXPECT_LT(*keptTriangles(m.grid).rbegin(), 12U);
  const Vector3d besideTheCore(0.0095, 0.015, 0.015);
  EXPECT_GE(m.grid.upperBound(besideTheCore), -0.0095);
  EXPECT_LT(m.grid.upperBound(besideTheCore), -0.003);
}

TEST(LinkGrid, KeepsTheWallsOfACavity) {
  const TriangleMesh mesh =
      test::joined(test::cube(0.03), test::insideOut(test::box({0.01, 0.01, 0.01}, {0.02, 0.02, 0.02})));
  const Measured m(mesh);
  EXPECT_TRUE(m.grid.closed);
  EXPECT_EQ(keptTriangles(m.grid).size(), 24U);
  const Vector3d inTheCavity(0.0118, 0.015, 0.0152);
  EXPECT_NEAR(m.truth(inTheCavity), 0.0018, 1e-8);
  EXPECT_GT(m.grid.upperBound(inTheCavity), 0.0018 - kRounding);
  EXPECT_LT(m.grid.lowerBound(inTheCavity), 0.0018 + kRounding);
  EXPECT_GT(m.grid.lowerBound(inTheCavity), 0);
}

TEST(LinkGrid, TellsOpenAndInsideOutMeshesFromClosedOnes) {
  TriangleMesh open = test::cube(0.03);
  EXPECT_TRUE(LinkGrid(open).closed);
  EXPECT_FALSE(LinkGrid(test::insideOut(open)).closed);
  open.triangles.pop_back();
  EXPECT_FALSE(LinkGrid(open).closed);
}

// What is inside an open mesh is not known: the lower bound holds for the distance without a sign, and a sheet has an
// inside.
TEST(LinkGrid, AnOpenSheetIsBoundedFromBelow) {
  TriangleMesh sheet;
  addRectangle(sheet, {0, 0, 0}, {0.03, 0, 0}, {0, 0.02, 0});
  const LinkGrid grid(sheet);
  EXPECT_FALSE(grid.closed);
  EXPECT_EQ(keptTriangles(grid).size(), 2U);
  for (int i = 0; i < kPoints; ++i) {
    const RandomStream stream = RandomStream(8).child(i);
    const Vector3d p(-0.01 + 0.05 * stream.uniform(0), -0.01 + 0.04 * stream.uniform(1),
                     -0.01 + 0.02 * stream.uniform(2));
    EXPECT_LE(grid.lowerBound(p), distanceTo(p, sheet) + kRounding) << p.transpose();
  }
  for (int i = 0; i < 100; ++i) {
    const RandomStream stream = RandomStream(9).child(i);
    const Vector3d p(0.03 * stream.uniform(0), 0.02 * stream.uniform(1), 0);
    EXPECT_LT(interpolated(grid, p), 0) << p.transpose();
  }
}

TEST(LinkGrid, TheBoundingSphereHoldsEveryVertex) {
  for (const TriangleMesh& mesh : {ell(), cylinder()}) {
    const LinkGrid grid(mesh);
    for (const Vector3d& p : mesh.vertices) EXPECT_LE((p - grid.center).norm(), grid.radius + 1e-12);
  }
}

}  // namespace
}  // namespace handhold
