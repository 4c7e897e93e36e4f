// Tasks with toy boxes: what is planned holds, what cannot be done counts why, a wrong file is refused by its line.
#include "plan/check_plan.h"
#include "plan/task_trials.h"
#include "plan_world.h"
#include "support/sanitized.h"

#include <numbers>
#include <sstream>

#include <gmock/gmock.h>

namespace handhold::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StrEq;

constexpr double kCoarser = kSanitized ? 8 : 1;  // the steps of the independent check grow under sanitizers
constexpr double kRounding = 1e-5;               // m, rad: grasps are stored with 32 bits

class TaskTest : public PlanWorld {
 protected:
  TaskTest() {
    std::filesystem::create_directories(folder_ / "pumas");
    write("pumas/pumas.urdf", twoPumas());
    std::string arms, home;
    for (const char* side : {"right", "left"}) {
      arms += fmt::format(
          "  - {{name: {0}, base_link: {0}_base, tip_link: {0}_flange, hand: {1}/hands/jaw, "
          "mount: {{position: [0, 0, 0]}}}}\n",
          side, source());
      home += fmt::format("{0}_joint_2: 0.785398, {0}_joint_3: -3.141593, {0}_joint_5: 0.785398, {0}_finger_1: 0.04, ",
                          side);
    }
    write("pumas/robot.yaml",
          fmt::format("urdf: pumas.urdf\narms:\n{}home: {{{}}}\nmax_velocity: 1.5\nmax_acceleration: 3\n", arms,
                      home.substr(0, home.size() - 2)));
  }

  /// Two Pumas on one floor, 0.9 m apart, both looking along x.
  static std::string twoPumas() {
    std::ostringstream text;
    text << std::ifstream(source() + "/robots/puma560/puma560.urdf").rdbuf();
    const std::string all = text.str();
    const std::size_t begin = all.find("<link name=\"base\">"), end = all.find("</robot>");
    std::string result = "<robot name=\"pumas\"><link name=\"floor\"/>\n";
    for (const char* side : {"right", "left"}) {
      std::string one = all.substr(begin, end - begin);
      for (std::size_t at = one.find("<material"); at != std::string::npos; at = one.find("<material", at)) {
        one.erase(at, one.find("/>", at) + 2 - at);
      }
      for (const std::string name : {"link name=\"", "joint name=\"", "parent link=\"", "child link=\""}) {
        for (std::size_t at = one.find(name); at != std::string::npos; at = one.find(name, at + name.size())) {
          one.insert(at + name.size(), std::string(side) + "_");
        }
      }
      result += fmt::format(
          "<joint name=\"{0}_mount\" type=\"fixed\"><parent link=\"floor\"/><child link=\"{0}_base\"/>"
          "<origin xyz=\"0 {1} 0\"/></joint>\n{2}",
          side, std::string_view(side) == "right" ? -0.45 : 0.45, one);
    }
    return result + "</robot>\n";
  }

  Planner pumas() const { return {(folder_ / "db").string(), loadRobot((folder_ / "pumas").string())}; }

  static Task taskOf(Planner& planner, const std::string& text) {
    return parseTask(text, "task.yaml", planner.robot(),
                     [&](const std::string& object) { return planner.objectMesh(object); });
  }

  /// The independent check of one motion, as a user would have to set it up from the result.
  std::optional<std::string> faultOf(const Robot& robot, const Task& task, const TaskMotion& motion,
                                     std::uint32_t grasp, std::vector<Obstacle> others = {}) const {
    const GraspSet set = toyBoxSet(jaw_);
    std::vector<Obstacle> obstacles = task.surroundings.obstacles;
    for (Obstacle& o : others) obstacles.push_back(std::move(o));
    CheckedMotion checked;
    checked.robot = &robot;
    checked.arm = motion.arm;
    checked.trajectory = &motion.trajectory;
    const auto& joints = robot.body.joints;
    for (const std::string& name : motion.jointNames) {
      checked.joints.push_back(static_cast<int>(
          std::find_if(joints.begin(), joints.end(), [&](const Joint& j) { return j.name == name; }) - joints.begin()));
    }
    checked.posture = motion.posture;
    checked.X_WB = task.surroundings.X_WB;
    checked.obstacles = &obstacles;
    checked.target = &set.objectMesh;
    checked.targetWatertight = true;
    checked.X_WO = motion.X_WO;
    checked.X_OH = set.X_OH(grasp);
    checked.finalPosition = Eigen::Vector2d(0.025, 0.025);
    checked.holds = motion.trajectory.segments.front().name != "transit";
    checked.X_WO_after = motion.X_WO_after;
    return findFault(checked, {0.001 * kCoarser, 0.2 * std::numbers::pi / 180 * kCoarser});
  }

  static std::vector<std::string> segmentsOf(const TaskMotion& motion) {
    std::vector<std::string> names;
    for (const TrajectorySegment& segment : motion.trajectory.segments) names.push_back(segment.name);
    return names;
  }

  Hand jaw_ = loadHand(source() + "/hands/jaw");
};

constexpr const char* kTable =
    "robot: {joints: home}\n"
    "obstacles:\n"
    "  - {name: table, box: [0.7, 1.6, 0.04], pose: {position: [0.6, 0, -0.02]}}\n";

// Two boxes of which the second stands where the first shall be put: the steps' order matters.
const std::string kTidyUp = std::string(kTable) +
                            "  - {name: can, mesh: " HANDHOLD_SOURCE_DIR
                            "/meshes/tube.obj, scale: 4, pose: {position: [0.2, -0.6, -0.4]}}\n"
                            "objects:\n"
                            "  - {object: toy_box, pose: {position: [0.5, 0.25, 0]}}\n"
                            "  - {name: other, object: toy_box, pose: {position: [0.5, 0, 0]}}\n"
                            "steps:\n"
                            "  - {pick: other}\n"
                            "  - {drop: other, into: can, release_height: 0.03}\n"
                            "  - {pick: toy_box, arm: arm}\n"
                            "  - {carry: toy_box, region: {position: [0.45, 0.1, 0.3], size: [0.1, 0.1, 0.1]}}\n"
                            "  - {place: toy_box, region: {position: [0.5, 0, 0], turn: yaw}}\n";

const std::string kRegrasp =
    std::string(kTable) +
    "objects: [{object: toy_box, pose: {position: [0.5, -0.45, 0]}}]\n"
    "steps:\n"
    "  - {pick: toy_box, arm: right}\n"
    "  - {hand_over: toy_box, to: left, region: {position: [0.5, 0, 0.45], size: [0.2, 0.2, 0.2], turn: any}}\n"
    "  - {place: toy_box, region: {position: [0.5, 0.45, 0.12], orientation: [1, 0, 0, 0], turn: yaw}}\n";

TEST_F(TaskTest, TidiesUpWithMotionsThatHold) {
  Planner planner = puma();
  const Task task = taskOf(planner, kTidyUp);
  const TaskResult result = TaskPlanner(planner).plan(task);
  ASSERT_TRUE(result.done) << result.reason;
  ASSERT_EQ(result.steps.size(), 5u);
  EXPECT_THAT(segmentsOf(result.steps[0].motions.at(0)), ElementsAre("transit", "approach", "close", "lift"));
  EXPECT_THAT(segmentsOf(result.steps[1].motions.at(0)), ElementsAre("carry", "drop", "return"));
  EXPECT_THAT(segmentsOf(result.steps[3].motions.at(0)), ElementsAre("carry"));
  EXPECT_THAT(segmentsOf(result.steps[4].motions.at(0)), ElementsAre("carry", "lower", "open", "retreat", "return"));
  const Obstacle box{"toy_box", makeMeshShape(toyBoxSet(jaw_).objectMesh), task.objects[0].X_WO};
  for (std::size_t i = 0; i < result.steps.size(); ++i) {
    SCOPED_TRACE(i);
    const auto& motion = result.steps[i].motions.at(0);
    EXPECT_EQ(faultOf(planner.robot(), task, motion, result.steps[i].grasp,
                      i < 2 ? std::vector{box} : std::vector<Obstacle>()),
              std::nullopt);
    // A motion begins where the one before ended.
    if (i > 0) {
      const auto& before = result.steps[i - 1].motions.at(0).trajectory.points.back();
      EXPECT_NEAR((before.position - motion.trajectory.points.front().position).norm(), 0, kRounding);
    }
  }
  // Above the can, 60 cm tall and 20 cm wide inside, as a whole; upright where it shall stand.
  const Eigen::Isometry3d dropped = result.steps[1].motions[0].X_WO_after;
  double lowest = 1;
  for (const Eigen::Vector3d& v : box.shape->mesh.vertices) {
    const Eigen::Vector3d p = dropped * v;
    lowest = std::min(lowest, p.z());
    EXPECT_LT((p - Eigen::Vector3d(0.2, -0.6, 0)).head<2>().norm(), 0.1);
  }
  EXPECT_NEAR(lowest, 0.2 + 0.03, 1e-4);
  const Eigen::Isometry3d placed = result.steps[4].motions[0].X_WO_after;
  EXPECT_NEAR((placed.translation() - Eigen::Vector3d(0.5, 0, 0)).norm(), 0, kRounding);
  EXPECT_NEAR(placed.linear()(2, 2), 1, kRounding);
}

TEST_F(TaskTest, HandsOverAndPutsDownUpsideDown) {
  Planner planner = pumas();
  const Task task = taskOf(planner, kRegrasp);
  const TaskResult result = TaskPlanner(planner).plan(task);
  ASSERT_TRUE(result.done) << result.reason;
  const auto& motions = result.steps[1].motions;
  ASSERT_EQ(motions.size(), 3u);
  EXPECT_THAT(segmentsOf(motions[0]), ElementsAre("carry"));
  EXPECT_THAT(segmentsOf(motions[1]), ElementsAre("transit", "approach", "close"));
  EXPECT_THAT(segmentsOf(motions[2]), ElementsAre("open", "retreat", "return"));
  EXPECT_EQ(result.steps[0].arm, 0);
  EXPECT_EQ(result.steps[1].arm, 1);
  EXPECT_EQ(result.steps[1].grasp, result.steps[2].grasp);
  EXPECT_EQ(faultOf(planner.robot(), task, result.steps[0].motions.at(0), result.steps[0].grasp), std::nullopt);
  EXPECT_EQ(faultOf(planner.robot(), task, motions[0], result.steps[0].grasp), std::nullopt);
  EXPECT_EQ(faultOf(planner.robot(), task, motions[1], result.steps[1].grasp), std::nullopt);
  EXPECT_EQ(faultOf(planner.robot(), task, motions[2], result.steps[0].grasp), std::nullopt);
  EXPECT_EQ(faultOf(planner.robot(), task, result.steps[2].motions.at(0), result.steps[2].grasp), std::nullopt);
  EXPECT_NEAR(result.steps[2].motions[0].X_WO_after.linear()(2, 2), -1, kRounding);

  // Had the taking hand been closed there before, the box would have come through it.
  TaskMotion bad = motions[0];
  const auto& joints = planner.robot().body.joints;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    if (joints[i].name.starts_with("left_")) bad.posture[at] = motions[2].posture[at];
  }
  EXPECT_THAT(faultOf(planner.robot(), task, bad, result.steps[0].grasp).value_or(""), HasSubstr(" meets left_"));

  // Equal tasks, equal plans.
  Planner again = pumas();
  EXPECT_EQ(taskJson(task, again.robot(), TaskPlanner(again).plan(task), false),
            taskJson(task, planner.robot(), result, false));
}

/// A guard that cannot fail guards nothing.
TEST_F(TaskTest, TheIndependentCheckFindsFaultsOfACarry) {
  Planner planner = puma();
  const Task task = taskOf(planner, kTidyUp);
  const TaskResult result = TaskPlanner(planner).plan(task);
  ASSERT_TRUE(result.done) << result.reason;
  const std::uint32_t grasp = result.steps[4].grasp;
  const auto fault = [&](const TaskMotion& motion, std::vector<Obstacle> others = {}) {
    return faultOf(planner.robot(), task, motion, grasp, std::move(others)).value_or("");
  };
  const TaskMotion& good = result.steps[4].motions[0];
  ASSERT_EQ(fault(good), "");

  TaskMotion bad = good;
  bad.X_WO.translation().x() += 0.001;
  EXPECT_THAT(fault(bad), HasSubstr("from the stored grasp"));
  bad = good;
  bad.X_WO_after.translation().z() += 0.001;
  EXPECT_THAT(fault(bad), StrEq("leaves the target elsewhere than it says"));
  bad = good;
  bad.trajectory.segments[0].name = "transit";
  EXPECT_THAT(fault(bad), StrEq("has a segment lower, want one of: transit, approach, close, lift"));
  bad = good;
  // Only a lower may come down to what the box then stands on.
  bad.trajectory.segments[1].name = "carry";
  const Obstacle mat = obstacle("mat", makeBoxShape({0.04, 0.04, 0.001}), {0.5, 0, 0.0005});
  EXPECT_EQ(fault(good, {mat}), "");
  EXPECT_THAT(fault(bad, {mat}), HasSubstr("the target meets mat"));
  bad = good;
  bad.trajectory.segments[3].name = "carry";  // the box goes with the hand that has let go
  EXPECT_NE(fault(bad), "");

  // A thin rod where only the carried box comes by: 2 mm within its far side, in the middle of the carry.
  const TaskMotion& carry = result.steps[3].motions[0];
  const GraspSet set = toyBoxSet(jaw_);
  Eigen::VectorXd posture = planner.robot().home;
  const auto& points = carry.trajectory.points;
  posture.head(6) = points[points.size() / 2].position.head(6);
  const Eigen::Isometry3d X_WO =
      forwardKinematics(planner.robot().body, posture)[planner.robot().arms[0].handLinks[0]] *
      set.X_OH(grasp).inverse();
  const Eigen::Vector3d approach(set.approachDirection[3 * grasp], set.approachDirection[3 * grasp + 1],
                                 set.approachDirection[3 * grasp + 2]);
  const double support = 0.5 * approach.cwiseAbs().dot(kToyBox);
  const Eigen::Vector3d far = Eigen::Vector3d(0, 0, 0.06) + (support - 0.002) * approach;
  const Obstacle rod = obstacle("rod", makeSphereShape(0.003), X_WO * far);
  EXPECT_THAT(fault(carry, {rod}), HasSubstr("the target meets rod"));
}

TEST_F(TaskTest, WhatCannotBeDoneIsCounted) {
  Planner planner = puma();
  const auto plan = [&](const std::string& steps) {
    return TaskPlanner(planner).plan(taskOf(
        planner, std::string(kTable) + "objects: [{object: toy_box, pose: {position: [0.5, 0.1, 0]}}]\n" + steps));
  };
  const auto countOf = [](const TaskResult& result) {
    std::size_t sum = 0;
    for (const TaskStepResult& step : result.steps) {
      for (const auto& [reason, count] : step.rejected) sum += count;
    }
    return sum;
  };
  // Out of reach: every grasp is dropped at the place, which is looked at first.
  TaskResult result = plan("steps: [{pick: toy_box}, {place: toy_box, region: {position: [3, 0, 0]}}]\n");
  EXPECT_FALSE(result.done);
  EXPECT_FALSE(result.feasible);
  EXPECT_THAT(result.reason, StrEq("toy_box: no stored grasp does it here"));
  EXPECT_EQ(countOf(result), 26u);
  EXPECT_GT(result.steps[1].rejected["unreachable"], 0u);
  EXPECT_TRUE(result.steps[0].motions.empty());
  // In the table.
  result = plan("steps: [{pick: toy_box}, {place: toy_box, region: {position: [0.5, -0.2, -0.05]}}]\n");
  EXPECT_FALSE(result.feasible);
  EXPECT_GT(result.steps[1].rejected["target_collision"], 0u);
  EXPECT_EQ(countOf(result), 26u);
}

TEST_F(TaskTest, RandomScenesAreEqualForAnyNumberOfThreads) {
  const std::string text = kTidyUp +
                           "trials:\n"
                           "  objects: {other: {position: [0.5, 0.1, 0], size: [0.2, 0.6, 0], turn: yaw}}\n"
                           "  blocks: {on: table, fewest: 2, most: 3}\n";
  Planner planner = puma();
  const ObjectMeshes meshes = [&](const std::string& object) { return planner.objectMesh(object); };
  const Task task = taskOf(planner, text);
  const Task drawn = drawTask(task, meshes, 3, 7);
  EXPECT_TRUE(drawTask(task, meshes, 3, 7).objects[1].X_WO.isApprox(drawn.objects[1].X_WO, 0));
  EXPECT_FALSE(drawTask(task, meshes, 3, 8).objects[1].X_WO.isApprox(drawn.objects[1].X_WO, 1e-6));
  EXPECT_TRUE(drawn.objects[0].X_WO.isApprox(task.objects[0].X_WO, 0));  // it has no region
  EXPECT_GE(drawn.surroundings.obstacles.size(), 4u);
  EXPECT_LE(drawn.surroundings.obstacles.size(), 5u);
  if (kSanitized) return;  // plans are slow there
  std::vector<std::string> reports;
  for (const int threads : {1, 2}) {
    auto trials = runTaskTrials([&] { return puma(); }, {}, task, 2, threads);
    for (TaskTrial& trial : trials) trial.seconds = 0;
    reports.push_back(trialsJson(task, trials, 1));
  }
  EXPECT_EQ(reports[0], reports[1]);
  EXPECT_THAT(reports[0], HasSubstr("\"feasible\": 2"));
}

TEST_F(TaskTest, RefusalsNameTheLine) {
  Planner planner = pumas();
  const auto refusal = [&](const std::string& rest) {
    return refusalOf([&] {
      taskOf(planner,
             std::string(kTable) + "objects: [{object: toy_box, pose: {position: [0.5, -0.4, 0]}}]\nsteps:\n" + rest);
    });
  };
  EXPECT_THAT(refusal("  - {pick: cup}\n"),
              StrEq("task.yaml:6: steps[0].pick is \"cup\", want one of the objects: toy_box"));
  EXPECT_THAT(refusal("  - {pick: toy_box, arm: third}\n"),
              StrEq("task.yaml:6: steps[0].arm is \"third\", want an arm: right, left"));
  EXPECT_THAT(refusal("  - {pick: toy_box}\n"),
              StrEq("task.yaml:5: steps end with toy_box in a hand, want a place or drop of it"));
  EXPECT_THAT(refusal("  - {drop: toy_box, into: table, release_height: 0}\n"),
              StrEq("task.yaml:6: steps[0].drop is \"toy_box\", which is in no hand there, want a pick of it first"));
  EXPECT_THAT(refusal("  - {pick: toy_box}\n  - {pick: toy_box}\n"),
              StrEq("task.yaml:7: steps[1].pick comes while toy_box is in a hand, want a place or drop first"));
  EXPECT_THAT(refusal("  - {pick: toy_box, from: table}\n"), HasSubstr("task.yaml:6: steps[0].from"));
  EXPECT_THAT(refusal("  - {throw: toy_box}\n"),
              StrEq("task.yaml:6: steps[0] says nothing to do, want one of: pick, carry, hand_over, place, drop"));
  EXPECT_THAT(refusal("  - {pick: toy_box}\n  - {hand_over: toy_box, to: left, region: {position: [0, 0, 1]}}\n"),
              StrEq("task.yaml:7: steps[1] hands over from any arm, want the pick to say which"));
  EXPECT_THAT(refusal("  - {pick: toy_box, arm: left}\n"
                      "  - {hand_over: toy_box, to: left, region: {position: [0, 0, 1]}}\n"),
              StrEq("task.yaml:7: steps[1].to is \"left\", which shares left_joint_1 with left, want arms that share "
                    "no joint"));
  EXPECT_THAT(refusal("  - {pick: toy_box}\n  - {place: toy_box, region: {position: [1, 0, 0], turn: round}}\n"),
              StrEq("task.yaml:7: steps[1].region.turn is \"round\", want one of: none, yaw, any"));
  EXPECT_THAT(refusal("  - {pick: toy_box}\n  - {drop: toy_box, into: sink, release_height: 0}\n"),
              StrEq("task.yaml:7: steps[1].into is \"sink\", want one of the obstacles: table"));
  EXPECT_THAT(refusalOf([&] { taskOf(planner, "objects: []\nsteps: []\n"); }),
              HasSubstr("has no robot.joints, want the present joint positions, or the word home"));
  const Task task = taskOf(planner, kRegrasp);
  EXPECT_THAT(refusalOf([&] {
                drawTask(
                    task, [&](const std::string& o) { return planner.objectMesh(o); }, 1, 0);
              }),
              StrEq("trials is missing, want the regions of the objects and the blocks"));
}

}  // namespace
}  // namespace handhold::testing
