#include "physics/convex_pieces.h"

#include "mesh/primitives.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace handhold {
namespace {

Eigen::AlignedBox3d boxOf(const ConvexPiece& piece) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& corner : piece) box.extend(corner);
  return box;
}

TEST(ConvexPieces, ConnectedPartsAreTheHullsOfALink) {
  TriangleMesh mesh = boxMesh({0.04, 0.02, 0.02});
  append(mesh, cylinderMesh(0.01, 0.03), Eigen::Isometry3d(Eigen::Translation3d(0.02, 0, 0)));
  const std::vector<ConvexPiece> pieces = connectedHulls(mesh);
  ASSERT_EQ(pieces.size(), 2u);
  EXPECT_TRUE(boxOf(pieces[0]).sizes().isApprox(Eigen::Vector3d(0.04, 0.02, 0.02)));
  EXPECT_NEAR(boxOf(pieces[1]).sizes().z(), 0.03, 1e-12);
}

// Two plates at a right angle with a common edge: no piece fills the space between them, and every corner is covered.
TEST(ConvexPieces, AnAngleIsNotFilled) {
  TriangleMesh mesh;
  constexpr std::uint32_t kCells = 12;  // HACD joins triangles: it needs some to choose from
  for (std::uint32_t i = 0; i <= 2 * kCells; ++i) {
    const double s = 0.06 * (static_cast<double>(i) / kCells - 1);  // along the profile, the edge at 0
    for (const double y : {-0.03, 0.03}) {
      mesh.vertices.emplace_back(s < 0 ? -s : 0, y, s < 0 ? 0 : s);
      mesh.vertices.emplace_back(s < 0 ? -s : -0.004, y, s < 0 ? -0.004 : s);
    }
    if (i == 0) continue;
    const std::uint32_t a = 4 * (i - 1), b = 4 * i;  // inner and outer at -y, inner and outer at +y
    for (const auto& [p, q] : {std::pair(0u, 2u), std::pair(3u, 1u), std::pair(1u, 0u), std::pair(2u, 3u)}) {
      mesh.triangles.push_back({a + p, a + q, b + p});
      mesh.triangles.push_back({b + p, a + q, b + q});
    }
  }
  const std::vector<ConvexPiece> pieces = convexPieces(mesh);
  ASSERT_GE(pieces.size(), 2u);
  for (const ConvexPiece& piece : pieces) EXPECT_LT(boxOf(piece).sizes().x() * boxOf(piece).sizes().z(), 0.05 * 0.05);
  for (const Eigen::Vector3d& v : mesh.vertices) {
    EXPECT_TRUE(std::any_of(pieces.begin(), pieces.end(), [&](const ConvexPiece& piece) {
      return boxOf(piece).squaredExteriorDistance(v) < 0.003 * 0.003;
    })) << v.transpose();
  }
}

}  // namespace
}  // namespace handhold
