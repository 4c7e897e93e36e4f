// The collection of real and hard meshes, where HANDHOLD_DATA names its folder. Boxes are those of its SOURCES.md.

#include "core/error.h"
#include "mesh/object.h"
#include "mesh/ray_scene.h"

#include <cstdlib>
#include <filesystem>
#include <set>

#include <Eigen/Eigenvalues>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using testing::Contains;
using testing::HasSubstr;
using testing::StartsWith;

constexpr double kBoxTol = 6e-5;  // four decimals are given

const MeshUnit kNone{};
const MeshUnit kMillimetres{0.001, true, "mm"};
const MeshUnit kInches{0.0254, true, "in"};

struct Item {
  const char* file;
  MeshUnit unit;
  bool watertight;
  Vector3d low;
  Vector3d high;
  int nParts = 1;
};

// clang-format off
const Item kItems[] = {
  {"hard/cube20_mm.stl", kMillimetres, true, {-0.0480, -0.0049, -0.0310}, {-0.0280, 0.0151, -0.0110}},
  {"hard/cycloidal_inch_100parts.ply", kInches, true, {0.0061, -0.0086, 0.0206}, {0.0537, 0.0390, 0.0487}, 100},
  {"hard/golf_ball_mm.stl", kMillimetres, true, {-0.0279, -0.0518, -0.0002}, {0.0148, -0.0091, 0.0421}},
  {"hard/half_flipped_banana.ply", kNone, true, {-0.0430, -0.0966, -0.0004}, {0.0659, 0.0819, 0.0363}},
  {"hard/idler_riser_inch_open.STL", kInches, false, {-0.0020, 0, 0}, {0.0655, 0.0750, 0.0159}},
  {"hard/inverted_soup_can.stl", kNone, true, {-0.0431, 0.0501, 0.0001}, {0.0248, 0.1179, 0.1019}},
  {"hard/scanned_mug_open.obj", kNone, false, {-0.0570, -0.0395, -0.0483}, {0.0571, 0.0394, 0.0484}},
  {"hard/thin_shell_bag.obj", kNone, false, {-0.0600, -0.0600, -0.0600}, {0.0600, 0.0117, 0.0600}},
  {"hard/tray_bottom_mm.STL", kMillimetres, true, {0, 0, -0.3556}, {0.3556, 0.0032, 0}},
  {"household/evo_bowl.glb", kNone, true, {-0.0734, -0.0306, -0.0734}, {0.0734, 0.0306, 0.0734}},
  {"openrave/mug1.dae", kNone, true, {-0.0528, -0.0528, 0}, {0.0837, 0.0528, 0.1092}},  // z up, as the file has it
  {"openrave/mug2.ply", kNone, true, {-0.0512, -0.0512, 0}, {0.1048, 0.0512, 0.1364}},
  {"ycb/003_cracker_box.obj", kNone, true, {-0.0488, -0.0962, -0.0032}, {0.0230, 0.0679, 0.2102}},
  {"ycb/004_sugar_box.ply", kNone, true, {-0.0322, -0.0638, 0}, {0.0173, 0.0304, 0.1760}},
  {"ycb/005_tomato_soup_can.dae", kNone, true, {-0.0431, 0.0501, 0.0001}, {0.0248, 0.1179, 0.1019}},
  {"ycb/006_mustard_bottle.stl", kNone, true, {-0.0639, -0.0568, -0.0032}, {0.0333, 0.0098, 0.1881}},
  {"ycb/009_gelatin_box.glb", kNone, true, {-0.0675, -0.0005, -0.0423}, {0.0219, 0.0295, 0.0588}},
  {"ycb/011_banana.obj", kNone, true, {-0.0430, -0.0966, -0.0004}, {0.0659, 0.0819, 0.0363}},
  {"ycb/019_pitcher_base.stl", kNone, true, {-0.0804, -0.0324, -0.0028}, {0.0687, 0.1125, 0.2396}},
  {"ycb/021_bleach_cleanser.stl", kNone, true, {-0.0729, -0.0221, -0.0005}, {0.0296, 0.0456, 0.2501}},
  {"ycb/024_bowl.ply", kNone, true, {-0.0956, -0.1243, -0.0005}, {0.0659, 0.0369, 0.0545}},
  {"ycb/025_mug.ply", kNone, true, {-0.0673, -0.0292, -0.0005}, {0.0496, 0.0639, 0.0808}},
  {"ycb/035_power_drill.ply", kNone, true, {-0.1381, -0.0832, -0.0032}, {0.0461, 0.1043, 0.0541}},
  {"ycb/036_wood_block.stl", kNone, true, {-0.0282, -0.0616, -0.0001}, {0.0757, 0.0418, 0.2059}},
  {"ycb/037_scissors.stl", kNone, true, {-0.0380, -0.0648, -0.0004}, {0.0581, 0.1367, 0.0153}},
  {"ycb/040_large_marker.ply", kNone, true, {-0.0462, -0.0656, -0.0003}, {-0.0252, 0.0554, 0.0186}},
  {"ycb/048_hammer.obj", kNone, true, {-0.1288, -0.1891, -0.0006}, {0.0534, 0.1436, 0.0322}},
  {"ycb/051_large_clamp.ply", kNone, true, {-0.0746, -0.0937, -0.0004}, {0.0454, 0.0773, 0.0388}},
};

const std::pair<const char*, const char*> kRefused[] = {
  {"hard/soup.stl", "is a soup of unconnected triangles: 0 of 300 edges"},
  {"hard/self_intersecting.obj", "m when no unit is written, want 0.005 to 2 m or a `unit:`"},
  {"hard/teapot_open_shell.stl", "the diagonal is 80 m when no unit is written"},
};
// clang-format on

/// Just below the surface is inside, and just above is outside unless another part touches there.
void expectOutwardNormals(const TriangleMesh& mesh, bool onePart) {
  constexpr double kStep = 1e-5;       // m
  constexpr std::size_t kStride = 97;  // triangles
  constexpr double kFolds = 0.03;      // share of places where the scans fold over closer than the step
  const RayScene scene(mesh);
  double below = 0;
  double above = 0;
  double asked = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += kStride) {
    const auto [a, b, c] = mesh.corners(i);
    const Vector3d step = mesh.normal(i) * kStep;
    below += scene.contains((a + b + c) / 3 - step) ? 1 : 0;
    above += scene.contains((a + b + c) / 3 + step) ? 0 : 1;
    asked += 1;
  }
  EXPECT_GE(below, (1 - kFolds) * asked) << asked;
  if (onePart) {
    EXPECT_GE(above, (1 - kFolds) * asked) << asked;
  }
}

class Catalog : public testing::Test {
 protected:
  void SetUp() override {
    const char* data = std::getenv("HANDHOLD_DATA");
    if (data == nullptr) GTEST_SKIP() << "HANDHOLD_DATA is not set to the folder of the mesh collection";
    folder_ = std::string(data) + "/meshes/";
  }
  ObjectModel load(const char* file, const MeshUnit& unit) const { return loadObject(folder_ + file, unit); }
  std::string folder_;
};

TEST_F(Catalog, EveryMeshLoadsWithItsBox) {
  for (const Item& item : kItems) {
    SCOPED_TRACE(item.file);
    const ObjectModel object = load(item.file, item.unit);
    EXPECT_EQ(object.watertight, item.watertight);
    EXPECT_EQ(object.warnings.empty(), item.watertight) << testing::PrintToString(object.warnings);
    const auto box = boundingBox(object.mesh);
    EXPECT_LT((box.min() - item.low).cwiseAbs().maxCoeff(), kBoxTol) << box.min().transpose();
    EXPECT_LT((box.max() - item.high).cwiseAbs().maxCoeff(), kBoxTol) << box.max().transpose();
    EXPECT_EQ(object.mass.volume > 0, item.watertight);
    EXPECT_GT(object.mass.area, 0);
    const Vector3d moments = object.mass.inertia.selfadjointView<Eigen::Lower>().eigenvalues();
    EXPECT_GT(moments[0], 0);
    EXPECT_LE(moments[2], (moments[0] + moments[1]) * (1 + 1e-9));
    if (!item.watertight) continue;
    expectOutwardNormals(object.mesh, item.nParts == 1);
  }
}

TEST_F(Catalog, TheRestIsRefusedForItsReason) {
  for (const auto& [file, reason] : kRefused) {
    try {
      load(file, kNone);
      ADD_FAILURE() << file << " was accepted";
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(reason));
      EXPECT_THAT(error.what(), StartsWith(folder_ + file + ": "));
    }
  }
}

TEST_F(Catalog, ListIsComplete) {
  std::set<std::string> listed;
  for (const Item& item : kItems) listed.insert(item.file);
  for (const auto& [file, reason] : kRefused) listed.insert(file);
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_)) {
    if (!entry.is_regular_file()) continue;
    EXPECT_THAT(listed, Contains(std::filesystem::relative(entry.path(), folder_).string()));
  }
}

TEST_F(Catalog, InvertedCanIsTheCan) {
  const ObjectModel inverted = load("hard/inverted_soup_can.stl", kNone);
  const ObjectModel can = load("ycb/005_tomato_soup_can.dae", kNone);
  EXPECT_THAT(inverted.notes, Contains("all triangles turned: the mesh was inside out"));
  EXPECT_NEAR(inverted.mass.volume, can.mass.volume, 1e-5 * can.mass.volume);
}

TEST_F(Catalog, HalfFlippedBananaIsTheBanana) {
  const ObjectModel flipped = load("hard/half_flipped_banana.ply", kNone);
  const ObjectModel banana = load("ycb/011_banana.obj", kNone);
  EXPECT_THAT(flipped.notes, Contains(HasSubstr("triangles turned to agree with the neighbours")));
  EXPECT_NEAR(flipped.mass.volume, banana.mass.volume, 1e-5 * banana.mass.volume);
}

}  // namespace
}  // namespace handhold
