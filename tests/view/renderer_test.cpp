#include "view/renderer.h"

#include "mesh/primitives.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

RenderSettings smallPicture() {
  RenderSettings settings;
  settings.width = 48;
  settings.height = 36;
  return settings;
}

std::array<int, 3> pixel(const Image& image, int column, int row) {
  const std::uint8_t* p = image.rgb.data() + std::size_t{3} * (row * image.width + column);
  return {p[0], p[1], p[2]};
}

ScenePart sphereAt(const Vector3d& position, const Vector3d& colour) {
  ScenePart part{sphereMesh(0.05), Eigen::Isometry3d::Identity(), colour, false};
  part.X_W.translation() = position;
  return part;
}

Image pictureOf(const std::vector<ScenePart>& scene, const RenderSettings& settings) {
  return render(scene, frameScene(scene, Vector3d(1, 0.4, 0.5), 4.0 / 3), settings);
}

bool isRed(const std::array<int, 3>& p) { return p[0] > 2 * p[1] && p[0] > 2 * p[2]; }
int brightness(const std::array<int, 3>& p) { return p[0] + p[1] + p[2]; }
bool isLight(const std::array<int, 3>& p) { return p[0] > 215 && p[1] > 215 && p[2] > 215; }

// A framed sphere is in the middle and reaches nearly to the top and bottom; the corners are background.
TEST(Renderer, SphereInTheMiddleBackgroundInTheCorners) {
  const Image image = pictureOf({sphereAt({0.3, -0.2, 0.1}, {0.8, 0.05, 0.05})}, smallPicture());
  ASSERT_EQ(image.rgb.size(), 3U * 48 * 36);
  for (const auto& [column, row] : {std::pair{24, 18}, {24, 4}, {24, 31}, {11, 18}, {36, 18}}) {
    EXPECT_TRUE(isRed(pixel(image, column, row))) << column << " " << row;
  }
  for (const auto& [column, row] : {std::pair{0, 0}, {47, 0}, {0, 35}, {47, 35}, {24, 0}}) {
    EXPECT_TRUE(isLight(pixel(image, column, row))) << column << " " << row;
  }
}

// Up in the world is up in the picture, and the nearer of two things hides the farther.
TEST(Renderer, UpIsUpAndNearHidesFar) {
  const Vector3d red(0.8, 0.03, 0.03), green(0.03, 0.8, 0.03);
  const std::vector<ScenePart> stacked = {sphereAt({0, 0, 0.2}, red), sphereAt({0, 0, 0}, green)};
  const Image column = pictureOf(stacked, smallPicture());
  EXPECT_TRUE(isRed(pixel(column, 24, 8)));
  EXPECT_GT(pixel(column, 24, 28)[1], 2 * pixel(column, 24, 28)[0]);

  const Vector3d toEye = Vector3d(1, 0.4, 0.5).normalized();
  const Image behind = pictureOf({sphereAt(Vector3d::Zero(), green), sphereAt(0.1 * toEye, red)}, smallPicture());
  EXPECT_TRUE(isRed(pixel(behind, 24, 18)));
}

// A mark inside a sphere is seen through it, another part there is not.
TEST(Renderer, MarksShineThrough) {
  std::vector<ScenePart> scene = {sphereAt(Vector3d::Zero(), {0.3, 0.3, 0.3})};
  scene.push_back({sphereMesh(0.01), Eigen::Isometry3d::Identity(), {0.8, 0.01, 0.01}, false});
  EXPECT_FALSE(isRed(pixel(pictureOf(scene, smallPicture()), 24, 18)));
  scene.back().isMark = true;
  EXPECT_TRUE(isRed(pixel(pictureOf(scene, smallPicture()), 24, 18)));
}

// The floor's shadow darkens background and nothing else; without it the background has one colour.
TEST(Renderer, GroundShadowIsOptional) {
  const std::vector<ScenePart> scene = {sphereAt(Vector3d::Zero(), {0.5, 0.05, 0.05})};
  RenderSettings settings = smallPicture();
  const Image with = pictureOf(scene, settings);
  settings.groundShadow = false;
  const Image without = pictureOf(scene, settings);
  int darker = 0;
  for (int row = 0; row < 36; ++row) {
    for (int column = 0; column < 48; ++column) {
      if (pixel(with, column, row) == pixel(without, column, row)) continue;
      EXPECT_LT(brightness(pixel(with, column, row)), brightness(pixel(without, column, row))) << column << " " << row;
      darker += isLight(pixel(without, column, row)) ? 1 : 0;
    }
  }
  EXPECT_GT(darker, 100);
  EXPECT_EQ(pixel(without, 0, 35), pixel(without, 47, 0));
}

TEST(Renderer, SamePictureTwice) {
  const std::vector<ScenePart> scene = {sphereAt({0, 0, 0}, {0.5, 0.2, 0.1}),
                                        sphereAt({0.07, 0, 0.03}, {0.1, 0.2, 0.5})};
  EXPECT_EQ(pictureOf(scene, smallPicture()).rgb, pictureOf(scene, smallPicture()).rgb);
}

TEST(Renderer, EmptySceneIsBackground) {
  const Image image = pictureOf({}, smallPicture());
  EXPECT_TRUE(isLight(pixel(image, 24, 18)));
}

// Equation (1): every vertex is inside the frame, and one touches the margin on two opposite sides.
TEST(FrameScene, AllVerticesInsideAndTight) {
  constexpr double kInside = 1 / 1.10;  // the margin
  ScenePart part{boxMesh({0.3, 0.1, 0.2}), Eigen::Isometry3d::Identity(), {1, 1, 1}, false};
  part.X_W.translation() = Vector3d(1, 2, 3);
  for (const double aspect : {0.5, 1.0, 2.5}) {
    const Camera camera = frameScene({part}, Vector3d(0.3, -1, 0.4), aspect);
    EXPECT_NEAR(camera.tanHalfWidth / camera.tanHalfHeight, aspect, 1e-12);
    Eigen::Array2d low(1, 1), high(-1, -1);
    for (const Vector3d& vertex : part.mesh.vertices) {
      const Vector3d p = camera.X_WC.inverse() * (part.X_W * vertex);
      const Eigen::Array2d seen(p.x() / -p.z() / camera.tanHalfWidth, p.y() / -p.z() / camera.tanHalfHeight);
      low = low.min(seen);
      high = high.max(seen);
    }
    EXPECT_NEAR(std::max(high[0], high[1]), kInside, 1e-9);
    EXPECT_NEAR(std::min(low[0], low[1]), -kInside, 1e-9);
    EXPECT_NEAR(high[0] + low[0], 0, 0.2);  // the side that is not tight is only nearly centred, in perspective
  }
}

TEST(ComposeGrid, PicturesStandInTheirCells) {
  const Image a{2, 1, std::vector<std::uint8_t>(6, 10)}, b{2, 3, std::vector<std::uint8_t>(18, 20)};
  const Image grid = composeGrid({a, b, a}, 2);
  ASSERT_EQ(grid.width, 4);
  ASSERT_EQ(grid.height, 6);
  EXPECT_EQ(pixel(grid, 0, 0)[0], 255);  // above the lower picture
  EXPECT_EQ(pixel(grid, 1, 1)[0], 10);
  EXPECT_EQ(pixel(grid, 2, 0)[0], 20);
  EXPECT_EQ(pixel(grid, 3, 2)[0], 20);
  EXPECT_EQ(pixel(grid, 0, 4)[0], 10);
  EXPECT_EQ(pixel(grid, 3, 5)[0], 255);  // no fourth picture
}

TEST(ComposeGrid, Columns) {
  const std::array<int, 10> expected = {1, 1, 2, 3, 2, 3, 3, 3, 3, 3};
  for (std::size_t count = 0; count < expected.size(); ++count) EXPECT_EQ(gridColumns(count), expected[count]) << count;
}

}  // namespace
}  // namespace handhold
