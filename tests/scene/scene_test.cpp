// What a scene file may say, and one test for each thing that it may not.
#include "scene/scene.h"

#include "core/error.h"
#include "core/yaml.h"
#include "mesh/object.h"
#include "mesh/primitives.h"
#include "scene/scene_files.h"

#include <cstdlib>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

/// A database of one object.
TriangleMesh onlyMug(const std::string& object) {
  if (object != "mug") throw InputError("db: has no object " + object);
  return boxMesh({0.08, 0.08, 0.1});
}

class SceneFile : public test::SceneFolder {
 protected:
  Scene load(const std::string& text) const { return loadScene(write("scene.yaml", text), onlyMug); }
  Scene loadObstacle(const std::string& entry) const { return load(kTarget + "obstacles:\n  - " + entry + "\n"); }

  std::string refusal(const std::string& text) const {
    return refusalOf([&] { load(text); });
  }
  std::string obstacleRefusal(const std::string& entry) const {
    return refusalOf([&] { loadObstacle(entry); });
  }

  inline static const std::string kTarget = "target: {object: mug, pose: {position: [0.4, 0, 0.2]}}\n";  // line 1
};

TEST_F(SceneFile, ReadsWhatTheContractShows) {
  write("can.obj", test::objText(boxMesh({60, 60, 120})));
  write("cloud.xyz", "1 2 3\n");
  const Scene scene = load(R"(
robot: {base: {position: [0, 0, 0.5]}, joints: {joint_1: 0.25, joint_2: -1}, arm: right}
target: {object: mug, pose: {position: [0.4, 0, 0.2], orientation: [0, 0, 1, 0]}}
obstacles:
  - {name: table, box: [1.2, 0.8, 0.02], pose: {position: [0.5, 0, 0.09]}}
  - {name: post, cylinder: {radius: 0.03, length: 0.2}, pose: {position: [0.4, 0.2, 0.2]}}
  - {name: ball, sphere: {radius: 0.05}}
  - {name: can, mesh: can.obj, unit: mm, pose: {position: [0.5, 0.1, 0.15]}}
  - {name: can2, mesh: can.obj, scale: 0.002}
  - {name: mug2, object: mug, pose: {position: [0.5, -0.1, 0.15]}}
  - {name: sensed, points: cloud.xyz, radius: 0.004}
)");
  EXPECT_EQ(scene.X_WB.translation(), Vector3d(0, 0, 0.5));
  ASSERT_TRUE(scene.joints.has_value());
  EXPECT_EQ(scene.joints->at("joint_1"), 0.25);
  EXPECT_EQ(scene.joints->at("joint_2"), -1);
  EXPECT_EQ(scene.arm, "right");
  EXPECT_EQ(scene.target, "mug");
  EXPECT_EQ(scene.X_WO.translation(), Vector3d(0.4, 0, 0.2));
  EXPECT_NEAR(scene.X_WO.linear()(0, 0), -1, 1e-12);
  std::vector<std::string> names;
  for (const Obstacle& obstacle : scene.obstacles) names.push_back(obstacle.name);
  EXPECT_THAT(names, ElementsAre("table", "post", "ball", "can", "can2", "mug2", "sensed"));
  EXPECT_EQ(std::get<ObstacleShape::Box>(scene.obstacles[0].shape->kind).size, Vector3d(1.2, 0.8, 0.02));
  EXPECT_EQ(scene.obstacles[0].X_WS.translation(), Vector3d(0.5, 0, 0.09));
  EXPECT_EQ(std::get<ObstacleShape::Cylinder>(scene.obstacles[1].shape->kind).length, 0.2);
  EXPECT_EQ(std::get<ObstacleShape::Sphere>(scene.obstacles[2].shape->kind).radius, 0.05);
  EXPECT_NEAR(boundingBox(scene.obstacles[3].shape->mesh).sizes().z(), 0.12, 1e-7);
  EXPECT_NEAR(boundingBox(scene.obstacles[4].shape->mesh).sizes().z(), 0.24, 1e-7);
  EXPECT_NEAR(boundingBox(scene.obstacles[5].shape->mesh).sizes().z(), 0.1, 1e-7);
  EXPECT_EQ(std::get<ObstacleShape::Points>(scene.obstacles[6].shape->kind).radius, 0.004);
}

TEST_F(SceneFile, RobotAndObstaclesMayBeLeftOut) {
  const Scene scene = load(kTarget);
  EXPECT_TRUE(scene.obstacles.empty());
  EXPECT_FALSE(scene.joints.has_value());
  EXPECT_TRUE(scene.arm.empty());
  EXPECT_TRUE(scene.X_WB.isApprox(Eigen::Isometry3d::Identity()));
}

TEST_F(SceneFile, HomeIsAnEmptyMap) {
  const Scene scene = load("robot: {joints: home}\n" + kTarget);
  ASSERT_TRUE(scene.joints.has_value());
  EXPECT_TRUE(scene.joints->empty());
}

TEST_F(SceneFile, RefusesWhatIsNoScene) {
  EXPECT_EQ(refusalOf([&] { loadScene((folder_ / "gone.yaml").string(), onlyMug); }),
            "gone.yaml: cannot be read: No such file or directory");
  EXPECT_EQ(refusal("obstacles: []\n"), "scene.yaml:1: the file has no key \"target\", want one");
  EXPECT_EQ(refusal(kTarget + "obstacle: []\n"),
            "scene.yaml:2: obstacle is not a known key, want one of: robot, target, obstacles");
  EXPECT_EQ(refusal(kTarget + "obstacles: 3\n"), "scene.yaml:2: obstacles is \"3\", want a list");
  EXPECT_EQ(refusal(kTarget + kTarget), "scene.yaml:2: target is given twice, want it once");
}

TEST_F(SceneFile, RefusesABadRobot) {
  EXPECT_EQ(refusal(kTarget + "robot: {bas: {}}\n"),
            "scene.yaml:2: robot.bas is not a known key, want one of: base, joints, arm");
  EXPECT_EQ(refusal(kTarget + "robot: {joints: away}\n"),
            "scene.yaml:2: robot.joints is \"away\", want a map of joint positions, or the word home");
  EXPECT_EQ(refusal(kTarget + "robot: {joints: [1, 2]}\n"),
            "scene.yaml:2: robot.joints is a list of 2, want a map of joint positions, or the word home");
  EXPECT_EQ(refusal(kTarget + "robot: {joints: {a: .nan}}\n"),
            "scene.yaml:2: robot.joints.a is \".nan\", want a finite number");
  EXPECT_EQ(refusal(kTarget + "robot: {base: {position: [0, 0]}}\n"),
            "scene.yaml:2: robot.base.position is a list of 2, want three numbers [x, y, z]");
  EXPECT_EQ(refusal(kTarget + "robot: {base: {position: [0, 0, 1e6]}}\n"),
            "scene.yaml:2: robot.base is farther than 10000 m, want metres");
}

TEST_F(SceneFile, RefusesABadTarget) {
  EXPECT_EQ(refusal("target: {object: mug}\n"), "scene.yaml:1: target has no key \"pose\", want one");
  EXPECT_EQ(refusal("target: {pose: {}}\n"), "scene.yaml:1: target has no key \"object\", want one");
  EXPECT_EQ(refusal("target: {object: cup, pose: {}}\n"),
            "scene.yaml:1: target.object is \"cup\": db: has no object cup");
  EXPECT_EQ(refusal("target: {object: mug, pose: {orientation: [0, 0, 0, 2]}}\n"),
            "scene.yaml:1: target.pose.orientation is not of length 1, want a unit quaternion [x, y, z, w]");
}

TEST_F(SceneFile, RefusesABadObstacle) {
  const auto expect = [&](const std::string& entry, const std::string& message) {
    EXPECT_EQ(obstacleRefusal(entry), "scene.yaml:3: obstacles[0]" + message) << entry;
  };
  expect("{box: [1, 1, 1]}", " has no key \"name\", want one");
  expect("{name: a}", " has no shape, want one of: box, cylinder, sphere, mesh, object, points");
  expect("{name: a, box: [1, 1, 1], sphere: {radius: 1}}", ".sphere is given beside box, want one shape");
  expect("{name: a, cone: 1}",
         ".cone is not a known key, want one of: name, pose, box, cylinder, sphere, mesh, unit, scale, object, points, "
         "radius");
  expect("{name: a, box: [1, 1]}", ".box is a list of 2, want three full extents [x, y, z] in metres");
  expect("{name: a, box: [1, 0, 1]}", ".box[1] is \"0\", want metres > 0 and at most 10000");
  expect("{name: a, box: [1, .inf, 1]}", ".box[1] is \".inf\", want a finite number");
  expect("{name: a, box: [1, 1, 1e5]}", ".box[2] is \"1e5\", want metres > 0 and at most 10000");
  expect("{name: a, cylinder: {radius: 1}}", ".cylinder has no key \"length\", want one");
  expect("{name: a, cylinder: {radius: -1, length: 1}}",
         ".cylinder.radius is \"-1\", want metres > 0 and at most 10000");
  expect("{name: a, cylinder: {radius: 1, length: 1, r: 1}}",
         ".cylinder.r is not a known key, want one of: radius, length");
  expect("{name: a, sphere: 1}", ".sphere is \"1\", want a map");
  expect("{name: a, sphere: {radius: x}}", ".sphere.radius is \"x\", want a finite number");
  expect("{name: a, object: cup}", ".object is \"cup\": db: has no object cup");
  expect("{name: a, sphere: {radius: 1}, unit: m}", ".unit is given beside sphere, want it with mesh alone");
  expect("{name: a, object: mug, scale: 2}", ".scale is given beside object, want it with mesh alone");
  expect("{name: a, sphere: {radius: 1}, radius: 1}", ".radius is given beside sphere, want it with points alone");
  expect("{name: a, mesh: a.obj, unit: m, scale: 1}", ".scale is given beside unit, want one of them");
  expect("{name: a, mesh: a.obj, unit: foot}", ".unit is \"foot\", want m, cm, mm or in");
  expect("{name: a, points: a.xyz}", " has no key \"radius\", want one");
  expect("{name: a, points: a.xyz, radius: 0}", ".radius is \"0\", want metres > 0 and at most 10000");
  expect("{name: a, sphere: {radius: 1}, pose: [0, 0, 0]}", ".pose is a list of 3, want a map");
  expect("{name: a, sphere: {radius: 1}, pose: {position: [0, -20000, 0]}}",
         ".pose is farther than 10000 m, want metres");
}

TEST_F(SceneFile, RefusesANameTwice) {
  EXPECT_EQ(refusal(kTarget + "obstacles:\n  - {name: a, box: [1, 1, 1]}\n  - {name: a, sphere: {radius: 1}}\n"),
            "scene.yaml:4: obstacles[1].name is \"a\" for the second time, want every name once");
}

TEST_F(SceneFile, RefusesFilesThatCannotBeUsed) {
  EXPECT_THAT(obstacleRefusal("{name: a, mesh: gone.obj, unit: m}"),
              StartsWith("scene.yaml:3: obstacles[0].mesh is \"gone.obj\": gone.obj: cannot be read"));
  EXPECT_EQ(obstacleRefusal("{name: a, points: gone.xyz, radius: 1}"),
            "scene.yaml:3: obstacles[0].points is \"gone.xyz\": gone.xyz: cannot be read: No such file or directory");
  write("big.obj", test::objText(boxMesh({60, 60, 120})));
  EXPECT_THAT(obstacleRefusal("{name: a, mesh: big.obj}"), HasSubstr("want 0.005 to 2 m or a `unit:`"));
}

TEST_F(SceneFile, RefusesACloudThatIsTooFineForItsExtent) {
  std::string text;
  for (int i = 0; i < 200'001; ++i) text += fmt::format("{} {} {}\n", i % 100, i / 100 % 100, i / 10'000);
  write("cloud.xyz", text);
  EXPECT_EQ(obstacleRefusal("{name: a, points: cloud.xyz, radius: 0.01}"),
            "scene.yaml:3: obstacles[0].points leaves 200001 points half a radius apart, want at most 200000: a larger "
            "radius");
}

TEST_F(SceneFile, AnOpenMeshGetsANote) {
  TriangleMesh open = boxMesh({0.1, 0.1, 0.1});
  open.triangles.pop_back();
  write("open.obj", test::objText(open));
  const Scene scene = loadObstacle("{name: lid, mesh: open.obj, unit: m}");
  EXPECT_FALSE(scene.obstacles[0].shape->watertight);
  EXPECT_THAT(scene.notes, Contains(HasSubstr("lid: is not watertight")));
}

// The mug's own points, and those so near that their balls would reach it, are not in the way of grasping it.
TEST_F(SceneFile, PointsOfTheTargetAreDropped) {
  write("cloud.xyz", "0.4 0 0.2\n0.44 0 0.2\n0.444 0 0.2\n0.5 0 0.2\n");  // the mug: 8 x 8 x 10 cm about (0.4, 0, 0.2)
  const Scene scene = loadObstacle("{name: seen, points: cloud.xyz, radius: 0.004}");
  const auto& points = std::get<ObstacleShape::Points>(scene.obstacles[0].shape->kind).points;
  ASSERT_EQ(points.size(), 1U);
  EXPECT_EQ(points[0], Vector3d(0.5, 0, 0.2));
  EXPECT_THAT(scene.notes, Contains("3 points of clouds dropped: they are the target"));
}

TEST_F(SceneFile, OneEntryIsReadAlone) {
  const YamlValue entry = YamlValue::parseText("{name: a, points: cloud.xyz, radius: 0.01}", "request", 1);
  write("cloud.xyz", "0 0 0\n0.001 0 0\n1 0 0\n");
  std::vector<std::string> notes;
  const Obstacle obstacle = readObstacle(entry, folder_ / "scene.yaml", onlyMug, &notes);
  EXPECT_EQ(obstacle.name, "a");
  EXPECT_THAT(notes, ElementsAre("a: 2 of 3 points kept, as balls of 0.011 m that cover the others"));
}

/// The catalog's own files, as a database would hold them.
TriangleMesh fromCatalog(const std::string& object) {
  return loadObject(fmt::format("{}/meshes/{}.obj", HANDHOLD_SOURCE_DIR, object), {1, true, "m"}).mesh;
}

TEST(ShippedScenes, AllLoadAndNothingReachesTheTarget) {
  int files = 0;
  for (const auto& file : fs::directory_iterator(std::string(HANDHOLD_SOURCE_DIR) + "/jobs/scenes")) {
    if (file.path().extension() != ".yaml") continue;
    SCOPED_TRACE(file.path().filename());
    ++files;
    const Scene scene = loadScene(file.path().string(), fromCatalog);
    EXPECT_TRUE(scene.joints.has_value());
    const Eigen::AlignedBox3d target = boundingBox(fromCatalog(scene.target));
    for (const Obstacle& obstacle : scene.obstacles) {
      SCOPED_TRACE(obstacle.name);
      if (std::holds_alternative<ObstacleShape::Points>(obstacle.shape->kind)) {
        EXPECT_THAT(scene.notes, Contains(HasSubstr("they are the target")));
        continue;
      }
      TriangleMesh moved;
      append(moved, obstacle.shape->mesh, scene.X_WO.inverse() * obstacle.X_WS);
      const Eigen::AlignedBox3d box = boundingBox(moved);
      // Touching the table is all that is allowed.
      EXPECT_LE(target.intersection(box).sizes().minCoeff(), 1e-6);
    }
  }
  EXPECT_EQ(files, 3);
}

}  // namespace
}  // namespace handhold
