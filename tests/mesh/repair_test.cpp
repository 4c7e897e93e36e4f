#include "mesh/repair.h"

#include "core/error.h"
#include "core/random.h"
#include "mesh/object.h"
#include "mesh/shapes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

const MeshUnit kMetres{1.0, true, "m"};
const MeshUnit kUnwritten{};

ObjectModel repair(const TriangleMesh& mesh) { return repairObject(mesh, kMetres, "thing"); }

std::string refusalOf(const TriangleMesh& mesh, const MeshUnit& unit = kMetres) {
  try {
    repairObject(mesh, unit, "thing.obj");
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), AllOf(StartsWith("thing.obj: "), testing::Not(HasSubstr("\n"))));
    return error.what();
  }
  return "accepted";
}

/// Every triangle with vertices of its own, as STL delivers it.
TriangleMesh unwelded(const TriangleMesh& mesh) {
  TriangleMesh soup;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto n = static_cast<std::uint32_t>(soup.vertices.size());
    for (const auto& corner : mesh.corners(i)) soup.vertices.push_back(corner);
    soup.triangles.push_back({n, n + 1, n + 2});
  }
  return soup;
}

TEST(Watertight, ClosedOpenAndInconsistent) {
  TriangleMesh mesh = test::cube(0.1);
  EXPECT_TRUE(isWatertight(mesh));
  EXPECT_TRUE(isWatertight(test::insideOut(mesh)));
  std::swap(mesh.triangles[3][0], mesh.triangles[3][1]);
  EXPECT_FALSE(isWatertight(mesh));
  mesh.triangles.erase(mesh.triangles.begin() + 3);
  EXPECT_FALSE(isWatertight(mesh));
  EXPECT_FALSE(isWatertight({}));
}

// Two cubes that share an edge: four faces there, and still closed.
TEST(Watertight, FourFacesAtAnEdgeAreClosed) {
  const ObjectModel object = repair(test::joined(test::cube(0.1), test::box({0.1, 0.1, 0}, {0.2, 0.2, 0.1})));
  EXPECT_EQ(object.mesh.vertices.size(), 14U);
  EXPECT_TRUE(object.watertight);
  EXPECT_NEAR(object.mass.volume, 2e-3, 1e-9);
  EXPECT_THAT(object.warnings, IsEmpty());
}

TEST(Append, MovesThePart) {
  TriangleMesh mesh = test::cube(1);
  append(mesh, test::cube(1), Eigen::Isometry3d(Eigen::Translation3d(5, 0, 0)));
  EXPECT_EQ(mesh.vertices.size(), 16U);
  EXPECT_EQ(mesh.triangles[12][0], 8U);
  EXPECT_EQ(boundingBox(mesh).max().x(), 6);
}

TEST(Repair, WeldsAndKeepsFloats) {
  const ObjectModel object = repair(unwelded(test::sphere(0.03, 3)));
  EXPECT_EQ(object.mesh.vertices.size(), 258U);
  EXPECT_TRUE(object.watertight);
  EXPECT_THAT(object.notes, Contains("1278 repeated positions welded"));
  for (const auto& vertex : object.mesh.vertices) EXPECT_EQ(vertex, vertex.cast<float>().cast<double>());
}

// Zero and minus zero are one place.
TEST(Repair, WeldsSignedZeros) {
  TriangleMesh mesh = unwelded(test::cube(0.1));
  for (std::size_t i = 0; i < mesh.vertices.size(); i += 2) {
    for (double& x : mesh.vertices[i]) x = x == 0 ? -0.0 : x;
  }
  EXPECT_EQ(repair(mesh).mesh.vertices.size(), 8U);
}

TEST(Repair, ScalesToMetres) {
  const ObjectModel object = repairObject(test::cube(20), {0.001, true, "mm"}, "thing");
  EXPECT_NEAR(object.mass.volume, 8e-6, 1e-12);
  EXPECT_EQ(object.mesh.vertices[7].x(), static_cast<double>(0.02F));
}

TEST(Repair, DropsDegenerateAndRepeatedTrianglesAndUnusedVertices) {
  TriangleMesh mesh = test::cube(0.1);
  mesh.vertices.emplace_back(9, 9, 9);
  mesh.triangles.push_back({3, 3, 5});
  mesh.triangles.push_back({7, 5, 1});  // {1, 7, 5} again
  const ObjectModel object = repair(mesh);
  EXPECT_EQ(object.mesh.triangles.size(), 12U);
  EXPECT_EQ(object.mesh.vertices.size(), 8U);
  EXPECT_TRUE(object.watertight);
  EXPECT_THAT(object.notes, Contains("1 triangle without area dropped"));
  EXPECT_THAT(object.notes, Contains("1 repeated triangle dropped"));
}

// Two boxes on one base repeat its triangles; dropping the second copy would open the surface.
TEST(Repair, KeepsRepeatedTrianglesOfClosedMeshes) {
  const ObjectModel object = repair(test::joined(test::cube(0.1), test::box({0, 0, 0}, {0.1, 0.1, 0.2})));
  EXPECT_EQ(object.mesh.triangles.size(), 24U);
  EXPECT_TRUE(object.watertight);
}

// A vertex in the middle of an edge, joined by a triangle without area: the neighbour takes it over.
TEST(Repair, FlatTriangleIsTakenOverByItsNeighbour) {
  TriangleMesh mesh = test::cube(0.5);
  mesh.vertices.emplace_back(0.25, 0, 0);  // on the edge 0-1; triangle {0, 3, 1} is left whole, {0, 1, 5} is divided
  mesh.triangles[4] = {0, 8, 5};
  mesh.triangles.push_back({8, 1, 5});
  mesh.triangles.push_back({0, 1, 8});
  ASSERT_TRUE(isWatertight(mesh));
  const ObjectModel object = repair(mesh);
  EXPECT_TRUE(object.watertight);
  EXPECT_EQ(object.mesh.triangles.size(), 14U);
  EXPECT_DOUBLE_EQ(object.mass.volume, 0.125);
  EXPECT_THAT(object.notes, Contains("1 triangle without area dropped"));
}

// Both neighbours of a cut may be flat, back to back.
TEST(Repair, FlatTrianglesInARowVanish) {
  TriangleMesh mesh = test::cube(0.5);
  mesh.vertices.emplace_back(0.125, 0, 0);
  mesh.vertices.emplace_back(0.25, 0, 0);
  mesh.triangles[4] = {0, 8, 5};
  mesh.triangles.insert(mesh.triangles.end(), {{8, 9, 5}, {9, 1, 5}, {0, 9, 8}, {0, 1, 9}});
  ASSERT_TRUE(isWatertight(mesh));
  const ObjectModel object = repair(mesh);
  EXPECT_TRUE(object.watertight);
  EXPECT_EQ(object.mesh.triangles.size(), 16U);
  EXPECT_DOUBLE_EQ(object.mass.volume, 0.125);
}

TEST(Orientation, TurnedTrianglesAgreeAgain) {
  const TriangleMesh good = test::sphere(0.05, 3);
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    TriangleMesh mesh = good;
    const RandomStream random(seed);
    const double share = random.uniform(0);
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (random.uniform(i + 1) < share) std::swap(mesh.triangles[i][0], mesh.triangles[i][2]);
    }
    const ObjectModel object = repair(mesh);
    EXPECT_TRUE(object.watertight);
    EXPECT_NEAR(object.mass.volume, test::volume(good), 1e-6 * object.mass.volume);
  }
}

TEST(Orientation, InsideOutMeshIsTurned) {
  const ObjectModel object = repair(test::insideOut(test::cube(0.1)));
  EXPECT_NEAR(object.mass.volume, 1e-3, 1e-9);
  EXPECT_THAT(object.notes, Contains("all triangles turned: the mesh was inside out"));
}

const TriangleMesh kInner = test::box({0.03, 0.03, 0.03}, {0.06, 0.07, 0.08});

TEST(Orientation, CavityIsKept) {
  const ObjectModel object = repair(test::joined(test::cube(0.1), test::insideOut(kInner)));
  EXPECT_NEAR(object.mass.volume, 1e-3 - 6e-5, 1e-9);
  EXPECT_THAT(object.notes, IsEmpty());
}

TEST(Orientation, InsideOutMeshWithCavityIsTurnedAsAWhole) {
  const ObjectModel object = repair(test::joined(test::insideOut(test::cube(0.1)), kInner));
  EXPECT_NEAR(object.mass.volume, 1e-3 - 6e-5, 1e-9);
}

// Beside, not within: an inside-out part is no cavity.
TEST(Orientation, InsideOutPartBesideIsTurned) {
  TriangleMesh mesh = test::cube(0.1);
  append(mesh, test::insideOut(kInner), Eigen::Isometry3d(Eigen::Translation3d(0.2, 0, 0)));
  const ObjectModel object = repair(mesh);
  EXPECT_NEAR(object.mass.volume, 1e-3 + 6e-5, 1e-9);
  EXPECT_THAT(object.notes, Contains("1 of 2 parts turned: inside out"));
}

// An island in a cavity: three shells, alternating.
TEST(Orientation, IslandInCavityIsKept) {
  const TriangleMesh island = test::box({0.04, 0.04, 0.04}, {0.05, 0.05, 0.05});
  const ObjectModel object = repair(test::joined(test::joined(test::cube(0.1), test::insideOut(kInner)), island));
  EXPECT_NEAR(object.mass.volume, 1e-3 - 6e-5 + 1e-6, 1e-9);
  EXPECT_THAT(object.notes, IsEmpty());
}

/// A cube without its top.
TriangleMesh openCube() {
  TriangleMesh mesh = test::cube(0.1);
  mesh.triangles.erase(mesh.triangles.begin() + 2, mesh.triangles.begin() + 4);
  return mesh;
}

TEST(Orientation, OpenMeshIsAcceptedWithAWarning) {
  const ObjectModel object = repair(openCube());
  EXPECT_FALSE(object.watertight);
  EXPECT_EQ(object.mass.volume, 0);
  EXPECT_THAT(object.warnings, Contains(StartsWith("open: 4 open edges;")));
  EXPECT_NEAR(object.mass.centerOfMass.z(), 0.04, 1e-9);  // (4 * 0.05 + 0) / 5
}

TEST(Orientation, OpenMeshFacingInwardIsTurned) {
  const ObjectModel object = repair(test::insideOut(openCube()));
  EXPECT_THAT(object.notes, Contains("open surface turned: its normals pointed mostly inward"));
  EXPECT_EQ(object.mesh.triangles, repair(openCube()).mesh.triangles);
}

TEST(Orientation, MoebiusStripIsAcceptedWithAWarning) {
  TriangleMesh mesh;
  constexpr std::uint32_t kSteps = 24;
  for (std::uint32_t i = 0; i < kSteps; ++i) {
    const double angle = 2 * std::numbers::pi * i / kSteps;
    for (const double side : {-0.02, 0.0, 0.02}) {
      const double r = 0.1 + side * std::cos(angle / 2);
      mesh.vertices.emplace_back(r * std::cos(angle), r * std::sin(angle), side * std::sin(angle / 2));
    }
  }
  for (std::uint32_t i = 0; i < kSteps; ++i) {
    const std::uint32_t j = 3 * ((i + 1) % kSteps);
    const bool last = i + 1 == kSteps;
    for (std::uint32_t k = 0; k < 2; ++k) {
      const std::uint32_t a = 3 * i + k;
      const std::uint32_t c = last ? j + 2 - k : j + k;
      const std::uint32_t d = last ? c - 1 : c + 1;
      mesh.triangles.insert(mesh.triangles.end(), {{a, c, d}, {a, d, a + 1}});
    }
  }
  EXPECT_THAT(repair(mesh).warnings, Contains(StartsWith("not orientable: ")));
}

TEST(Refusal, NoTriangles) {
  EXPECT_EQ(refusalOf({}), "thing.obj: has no triangles");
  EXPECT_EQ(refusalOf({{{0, 0, 0}, {1, 0, 0}}, {}}), "thing.obj: has no triangles");
}

TEST(Refusal, CoordinateNotFinite) {
  TriangleMesh mesh = test::cube(0.1);
  mesh.vertices[5].y() = std::nan("");
  EXPECT_EQ(refusalOf(mesh), "thing.obj: vertex 5 is (0.1, nan, 0.1), want finite numbers");
  mesh.vertices[5].y() = 1e300;  // no 32-bit float
  EXPECT_THAT(refusalOf(mesh), HasSubstr("vertex 5 is ("));
}

TEST(Refusal, IndexOutOfRange) {
  TriangleMesh mesh = test::cube(0.1);
  mesh.triangles[7][1] = 8;
  EXPECT_EQ(refusalOf(mesh), "thing.obj: triangle 7 uses vertex 8, want below 8");
}

TEST(Refusal, NoArea) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {0.1, 0.1, 0.1}, {0.2, 0.2, 0.2}};
  mesh.triangles = {{0, 1, 2}, {0, 0, 1}};
  EXPECT_EQ(refusalOf(mesh), "thing.obj: has no triangle with an area");
}

TEST(Refusal, ClosedWithoutVolume) {
  TriangleMesh sheet;
  sheet.vertices = {{0, 0, 0}, {0.1, 0, 0}, {0.1, 0.1, 0}, {0, 0.1, 0}};
  sheet.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 2, 1}, {0, 3, 2}};
  EXPECT_THAT(refusalOf(sheet), HasSubstr("is closed but encloses no volume"));
}

TEST(Refusal, ImplausibleSizeWithoutUnit) {
  EXPECT_EQ(
      refusalOf(test::cube(20), kUnwritten),
      "thing.obj: the diagonal is 34.6 m when no unit is written, want 0.005 to 2 m or a `unit:`; `unit: mm` would "
      "make it 0.0346 m, `unit: cm` would make it 0.346 m, `unit: in` would make it 0.88 m");
  EXPECT_THAT(refusalOf(test::cube(1e6), kUnwritten), HasSubstr("no common unit fits: write `scale:`"));
  EXPECT_THAT(refusalOf(test::cube(0.001), kUnwritten), HasSubstr("the diagonal is 0.00173 m"));
  EXPECT_EQ(refusalOf(test::cube(0.1), kUnwritten), "accepted");
  EXPECT_THAT(repair(test::cube(20)).warnings, Contains("the diagonal is 34.6 m with the unit \"m\""));
}

TEST(Refusal, Soup) {
  TriangleMesh mesh;
  const RandomStream random(7);
  for (std::uint32_t i = 0; i < 300; ++i) {
    mesh.vertices.emplace_back(random.uniform(3 * i), random.uniform(3 * i + 1), random.uniform(3 * i + 2));
    if (i % 3 == 2) mesh.triangles.push_back({i - 2, i - 1, i});
  }
  EXPECT_EQ(refusalOf(mesh),
            "thing.obj: is a soup of unconnected triangles: 0 of 300 edges are shared by two of them, want "
            "half");
}

TEST(Refusal, ScaleNotPositive) {
  EXPECT_EQ(refusalOf(test::cube(1), {0, true, "0"}), "thing.obj: the scale is 0, want a positive number");
}

}  // namespace
}  // namespace handhold
