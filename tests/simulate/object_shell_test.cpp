#include "simulate/object_shell.h"

#include "mesh/primitives.h"

#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

Vector3d pointOf(const ObjectShell& shell, std::size_t i) {
  return {shell.point[0][i], shell.point[1][i], shell.point[2][i]};
}

class ShellPoints : public ::testing::TestWithParam<std::string> {
 protected:
  /// A box whose faces are cut finely, and small boxes far apart, so that neighbours are not near.
  static ObjectModel object() {
    ObjectModel model;
    if (GetParam() == "box") model.mesh = boxMesh({0.1, 0.06, 0.03});
    for (int i = 0; GetParam() == "crumbs" && i < 20; ++i) {
      const TriangleMesh crumb = boxMesh({2e-3, 2e-3, 2e-3});
      const auto first = static_cast<std::uint32_t>(model.mesh.vertices.size());
      for (const Vector3d& p : crumb.vertices) model.mesh.vertices.push_back(p + 0.03 * i * Vector3d::UnitX());
      for (const auto& t : crumb.triangles) model.mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
    return model;
  }
};

INSTANTIATE_TEST_SUITE_P(Shapes, ShellPoints, ::testing::Values("box", "crumbs"),
                         [](const auto& shape) { return shape.param; });

// The coarse fields of a hand say nothing of larger blocks.
TEST_P(ShellPoints, LieInBlocksOfTheirRadius) {
  const ObjectShell shell(object());
  const SphereTree::Spheres& blocks = shell.pointTree.blocks;
  const std::size_t points = shell.point[0].size();
  ASSERT_EQ(points % SphereTree::kWidth, 0U);
  for (std::size_t i = 0; i < points; ++i) {
    const std::size_t b = i / SphereTree::kWidth;
    const Vector3d center(blocks.x[b], blocks.y[b], blocks.z[b]);
    ASSERT_LE((pointOf(shell, i) - center).norm(), blocks.radius[b]);
    ASSERT_LE(blocks.radius[b], ObjectShell::kBlockRadius);
  }
}

TEST_P(ShellPoints, HoldEveryCorner) {
  const ObjectModel model = object();
  const ObjectShell shell(model);
  for (const Vector3d& vertex : model.mesh.vertices) {
    double nearest = 1;
    for (std::size_t i = 0; i < shell.point[0].size(); ++i) {
      nearest = std::min(nearest, (pointOf(shell, i) + shell.center - vertex).norm());
    }
    EXPECT_LT(nearest, 1e-7) << vertex.transpose();
  }
}

}  // namespace
}  // namespace handhold
