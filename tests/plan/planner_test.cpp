// Ranking and plans in scenes around a box on a table: what is returned holds, what cannot be done says why.
#include "core/file.h"
#include "plan/check_plan.h"
#include "plan/experiment.h"
#include "plan_world.h"
#include "support/sanitized.h"

#include <numbers>

#include <gmock/gmock.h>

namespace handhold::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StrEq;

constexpr double kCoarser = kSanitized ? 8 : 1;  // the steps of the independent check grow under sanitizers

/// The independent check of a result, as a user would have to set it up.
std::optional<std::string> faultOf(const Planner& planner, const PlanResult& result, const Hand& jaw) {
  const GraspSet set = toyBoxSet(jaw);
  CheckedMotion motion;
  motion.robot = &planner.robot();
  motion.arm = findArm(planner.robot(), result.arm);
  motion.trajectory = &result.trajectory;
  for (const std::string& name : result.jointNames) {
    const auto& joints = planner.robot().body.joints;
    motion.joints.push_back(static_cast<int>(
        std::find_if(joints.begin(), joints.end(), [&](const Joint& j) { return j.name == name; }) - joints.begin()));
  }
  motion.posture = planner.robot().home;
  motion.X_WB = planner.scene().X_WB;
  motion.obstacles = &planner.scene().obstacles;
  motion.target = &set.objectMesh;
  motion.targetWatertight = true;
  motion.X_WO = planner.scene().X_WO;
  motion.X_OH = set.X_OH(result.grasp.score.grasp);
  motion.finalPosition = Eigen::Vector2d(0.025, 0.025);
  return findFault(motion, {0.001 * kCoarser, 0.2 * std::numbers::pi / 180 * kCoarser});
}

class PlannerTest : public PlanWorld {
 protected:
  Hand jaw_ = loadHand(source() + "/hands/jaw");
};

TEST_F(PlannerTest, PlansHoldForEveryRobotAndScore) {
  for (const bool isPanda : {false, true}) {
    Planner planner = isPanda ? panda() : puma();
    planner.setScene(scene({obstacle("post", makeCylinderShape(0.03, 0.25), {0.5, -0.12, 0.125}),
                            obstacle("carton", makeBoxShape({0.08, 0.1, 0.2}), {0.36, 0.16, 0.1})}));
    for (const ScoreKind kind : {ScoreKind::paper, ScoreKind::reach}) {
      SCOPED_TRACE(fmt::format("{} {}", planner.robot().name, kind == ScoreKind::paper ? "paper" : "reach"));
      const PlanResult result = planner.plan({.score = kind});
      ASSERT_TRUE(result.planned) << result.reason;
      EXPECT_EQ(faultOf(planner, result, jaw_), std::nullopt);
      std::vector<std::string> names;
      for (const TrajectorySegment& segment : result.trajectory.segments) names.push_back(segment.name);
      EXPECT_EQ(names, (std::vector<std::string>{"transit", "approach", "close", "lift"}));
      EXPECT_EQ(result.tested, result.rank);
      std::size_t rejected = 0;
      for (const auto& [reason, count] : result.rejected) rejected += count;
      EXPECT_EQ(rejected + 1, result.tested);
    }
  }
}

TEST_F(PlannerTest, EqualQuestionsGetEqualPlans) {
  const auto obstacles = std::vector{obstacle("wall", makeBoxShape({0.02, 0.3, 0.25}), {0.33, 0, 0.125})};
  std::string first;
  for (int i = 0; i < 2; ++i) {
    Planner planner = puma();
    planner.setScene(scene(obstacles));
    for (int repeat = 0; repeat < 2; ++repeat) {
      PlanResult result = planner.plan({});
      ASSERT_TRUE(result.planned) << result.reason;
      result.timingMs.clear();
      if (first.empty()) first = planJson(result, false);
      EXPECT_EQ(planJson(result, false), first);
    }
  }
}

TEST_F(PlannerTest, RankingFollowsACommonRigidMotion) {
  Eigen::Isometry3d X = Eigen::Translation3d(3, -2, 0.7) * Eigen::AngleAxisd(2.1, Eigen::Vector3d::UnitZ());
  X.rotate(Eigen::AngleAxisd(0.8, Eigen::Vector3d(1, 2, 0.5).normalized()));
  Scene here = scene({obstacle("ball", makeSphereShape(0.05), {0.42, 0.1, 0.1})});
  Scene there = here;
  there.X_WB = X * here.X_WB;
  there.X_WO = X * here.X_WO;
  for (Obstacle& o : there.obstacles) o.X_WS = X * o.X_WS;
  Planner planner = puma();
  for (const ScoreKind kind : {ScoreKind::paper, ScoreKind::reach}) {
    planner.setScene(here);
    const Ranking a = planner.rank(kind);
    planner.setScene(there);
    const Ranking b = planner.rank(kind);
    ASSERT_EQ(a.grasps.size(), b.grasps.size());
    for (std::size_t i = 0; i < a.grasps.size(); ++i) {
      // Mirrored grasps have equal scores: their order may turn round with the rounding.
      EXPECT_NEAR(a.grasps[i].score.score, b.grasps[i].score.score, 1e-4);
      const auto same = std::find_if(b.grasps.begin(), b.grasps.end(),
                                     [&](const RankedGrasp& g) { return g.score.grasp == a.grasps[i].score.grasp; });
      EXPECT_NEAR(same->score.score, a.grasps[i].score.score, 1e-4);
      EXPECT_TRUE(same->X_WH.isApprox(X * a.grasps[i].X_WH, 1e-9));
    }
  }
}

// A robot on a turned base stands so in random scenes, and in their files.
TEST_F(PlannerTest, RandomScenesTurnTheBaseAsTheWorkspaceDoes) {
  const std::string yaml = readFile((folder_ / "puma/robot.yaml").string());
  write("puma/robot.yaml", yaml +
                               "workspace:\n"
                               "  base: {position: [0.1, -0.2, 0.05], orientation: [0, 0, 0.6, 0.8]}\n"
                               "  table: {size: [0.9, 0.7, 0.04], position: [0.24, 0.33, -0.02]}\n"
                               "  x: [0.2, 0.3]\n  y: [0.25, 0.35]\n");
  Planner planner = puma();
  const std::string scene = takeRandomScene(planner, "toy_box", 0, {});
  Eigen::Isometry3d X_WB(Eigen::Translation3d(0.1, -0.2, 0.05));
  X_WB.rotate(Eigen::Quaterniond(0.8, 0, 0, 0.6));
  EXPECT_TRUE(planner.scene().X_WB.isApprox(X_WB, 1e-12)) << scene;
  planner.loadScene(write("scene.yaml", scene));
  EXPECT_TRUE(planner.scene().X_WB.isApprox(X_WB, 1e-12)) << scene;
}

TEST_F(PlannerTest, ImpossibleScenesSayWhy) {
  Planner planner = puma({.maxMotions = 3});
  planner.setScene(scene({}, {2.5, 0, 0}));
  PlanResult result = planner.plan({});
  EXPECT_FALSE(result.planned);
  EXPECT_EQ(result.rejected.at("unreachable") + result.rejected["hand_collision"], 26u);

  // A box without a lid or a door.
  planner.setScene(scene({obstacle("front", makeBoxShape({0.01, 0.2, 0.4}), {0.42, 0.1, 0.2}),
                          obstacle("back", makeBoxShape({0.01, 0.2, 0.4}), {0.58, 0.1, 0.2}),
                          obstacle("left", makeBoxShape({0.2, 0.01, 0.4}), {0.5, 0.18, 0.2}),
                          obstacle("right", makeBoxShape({0.2, 0.01, 0.4}), {0.5, 0.02, 0.2}),
                          obstacle("lid", makeBoxShape({0.2, 0.2, 0.01}), {0.5, 0.1, 0.25})}));
  result = planner.plan({.trace = true});
  EXPECT_FALSE(result.planned);
  EXPECT_EQ(result.tested, 26u);
  EXPECT_EQ(result.rejected.at("hand_collision"), 26u);
  ASSERT_EQ(result.trace.size(), 26u);
  EXPECT_THAT(result.trace[0].detail, HasSubstr(" meets "));
  EXPECT_THAT(result.reason, StrEq("none of the 26 stored grasps works here"));

  // The target inside an obstacle.
  planner.setScene(scene({obstacle("block", makeBoxShape({0.3, 0.3, 0.3}), {0.5, 0.1, 0.15})}));
  result = planner.plan({});
  EXPECT_FALSE(result.planned);
  EXPECT_EQ(result.rejected.at("hand_collision"), 26u);

  // The robot stands in something.
  planner.setScene(scene({obstacle("fog", makeBoxShape({1, 1, 1}), {0, 0, 1.2})}));
  result = planner.plan({});
  EXPECT_FALSE(result.planned);
  EXPECT_EQ(result.tested, 0u);
  EXPECT_THAT(result.reason, ::testing::MatchesRegex("where the robot stands, [a-z_0-9]+ meets fog"));
}

TEST_F(PlannerTest, APreferredGraspStaysUntilAnotherIsClearlyBetter) {
  Planner planner = puma();
  planner.setScene(scene());
  const PlanResult free = planner.plan({.score = ScoreKind::reach});
  ASSERT_TRUE(free.planned);
  const Ranking ranking = planner.rank(ScoreKind::reach);
  const auto second = std::find_if(ranking.grasps.begin(), ranking.grasps.end(), [&](const RankedGrasp& g) {
    return g.score.grasp != free.grasp.score.grasp && ranking.grasps[0].score.score < 1.05 * g.score.score;
  });
  ASSERT_NE(second, ranking.grasps.end());
  const PlanResult kept = planner.plan({.score = ScoreKind::reach, .prefer = second->score.grasp});
  ASSERT_TRUE(kept.planned);
  EXPECT_EQ(kept.grasp.score.grasp, second->score.grasp);
  // The last of the ranking is far worse: it is not kept.
  const PlanResult dropped = planner.plan({.score = ScoreKind::reach, .prefer = ranking.grasps.back().score.grasp});
  EXPECT_EQ(dropped.grasp.score.grasp, free.grasp.score.grasp);
}

TEST_F(PlannerTest, StopsWhenTold) {
  Planner planner = puma();
  planner.setScene(scene());
  const PlanResult result = planner.plan({.stop = [](std::uint64_t checks) { return checks >= 40; }});
  EXPECT_FALSE(result.planned);
  EXPECT_TRUE(result.stopped);
  EXPECT_LT(result.checks, 400u);
}

TEST_F(PlannerTest, RefusalsNameWhatIsWrong) {
  Planner planner = puma();
  EXPECT_THAT(refusalOf([&] { planner.rank(ScoreKind::paper); }), StrEq("no scene was given, want one first"));
  Scene wrong = scene();
  wrong.target = "teapot";
  EXPECT_THAT(refusalOf([&] { planner.setScene(wrong); }),
              StrEq("target.object: db has no set of teapot with the hand jaw, want one: handhold build"));
  EXPECT_THAT(refusalOf([&] { planner.objectMesh("teapot"); }),
              StrEq("the database db has no object teapot, want one of: toy_box"));
  wrong = scene();
  wrong.joints = {{"elbow", 1.0}};
  EXPECT_THAT(
      refusalOf([&] { planner.setScene(wrong); }),
      StrEq("robot.joints.elbow is no joint of the robot puma, want one of: joint_1, joint_2, joint_3, joint_4, "
            "joint_5, joint_6, finger_1"));
  wrong.joints = {{"finger_2", 0.01}};
  EXPECT_THAT(refusalOf([&] { planner.setScene(wrong); }),
              StrEq("robot.joints.finger_2 is a mimic joint, want the joint that it follows: finger_1"));
  wrong.joints = {{"finger_1", 0.5}};
  EXPECT_THAT(refusalOf([&] { planner.setScene(wrong); }),
              StrEq("robot.joints.finger_1 is 0.5, want it within 0 .. 0.04"));
  wrong = scene();
  wrong.arm = "third";
  EXPECT_THAT(refusalOf([&] { planner.setScene(wrong); }),
              StrEq("robot.arm is \"third\", want an arm of the robot puma: arm"));
  wrong = scene();
  wrong.joints.reset();
  planner.setScene(wrong);
  EXPECT_EQ(planner.rank(ScoreKind::paper).grasps.size(), 26u);
  EXPECT_THAT(refusalOf([&] { planner.plan({}); }),
              StrEq("robot.joints is missing, want the present joint positions, or the word home"));
  EXPECT_THAT(refusalOf([&] { Planner((folder_ / "nowhere").string(), planner.robot()); }), HasSubstr("nowhere"));
}

/// A guard that cannot fail guards nothing.
TEST_F(PlannerTest, TheIndependentCheckFindsFaults) {
  Planner planner = puma();
  planner.setScene(scene());
  const PlanResult good = planner.plan({});
  ASSERT_TRUE(good.planned);
  ASSERT_EQ(faultOf(planner, good, jaw_), std::nullopt);

  PlanResult bad = good;
  bad.trajectory.points[0].position[0] += 0.01;
  EXPECT_THAT(faultOf(planner, bad, jaw_).value_or(""), HasSubstr("begins with joint_1 at"));
  bad = good;
  for (TrajectoryPoint& point : bad.trajectory.points) point.time *= 0.9;
  EXPECT_THAT(faultOf(planner, bad, jaw_).value_or(""), HasSubstr("moves at"));
  bad = good;
  bad.grasp.score.grasp = (good.grasp.score.grasp + 2) % 26;
  EXPECT_THAT(faultOf(planner, bad, jaw_).value_or(""), HasSubstr("from the stored grasp"));
  bad = good;
  bad.trajectory.segments[1].name = "transit";
  EXPECT_THAT(faultOf(planner, bad, jaw_).value_or(""), StrEq("has no segment approach"));
  bad = good;
  bad.trajectory.segments[2].name = "approach";  // fingers on the target before `close`
  bad.trajectory.segments[1].name = "close";
  EXPECT_NE(faultOf(planner, bad, jaw_), std::nullopt);

  // The same motion with a thin rod across the way of the hand, and with a ceiling over the lifted box.
  Scene crossed = scene({obstacle("rod", makeCylinderShape(0.002, 0.02), {0, 0, 0})});
  const auto& approach = good.trajectory.segments[1];
  const Eigen::VectorXd& q = good.trajectory.points[(approach.begin + approach.end) / 2].position;
  Eigen::VectorXd posture = planner.robot().home;
  posture.head(6) = q.head(6);
  const Eigen::Isometry3d X_WH = forwardKinematics(
      planner.robot().body, followMimics(planner.robot().body, posture))[planner.robot().arms[0].handLinks[0]];
  crossed.obstacles.back().X_WS.translation() = X_WH.translation();
  planner.setScene(crossed);
  EXPECT_THAT(faultOf(planner, good, jaw_).value_or(""), HasSubstr("meets rod"));
  planner.setScene(scene({obstacle("ceiling", makeBoxShape({0.04, 0.07, 0.01}), {0.5, 0.1, 0.12 + 0.03})}));
  EXPECT_NE(faultOf(planner, good, jaw_), std::nullopt);
}

TEST_F(PlannerTest, StartingNearerThanTheClearanceIsSaid) {
  Planner planner = puma();
  const Robot& robot = planner.robot();
  const std::vector<Eigen::Isometry3d> X = forwardKinematics(robot.body, robot.home);
  Eigen::Vector3d highest(0, 0, -1);  // of the hand
  for (const int link : robot.arms[0].handLinks) {
    for (const Eigen::Vector3d& v : robot.body.links[link].mesh.vertices) {
      if ((X[link] * v).z() > highest.z()) highest = X[link] * v;
    }
  }
  const auto plate = makeBoxShape({0.01, 0.01, 0.01});
  planner.setScene(scene({obstacle("plate", plate, highest + Eigen::Vector3d(0, 0, 0.005 + 0.003))}));
  EXPECT_EQ(planner.plan({}).clearance, 0);
  planner.setScene(scene({obstacle("plate", plate, highest + Eigen::Vector3d(0, 0, 0.005 + 0.02))}));
  EXPECT_EQ(planner.plan({}).clearance, 0.005);
}

}  // namespace
}  // namespace handhold::testing
