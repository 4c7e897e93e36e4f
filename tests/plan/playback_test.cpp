#include "plan/playback.h"

#include "core/file.h"
#include "plan/plan_world.h"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

constexpr double kRounding = 1e-9;  // m: forward kinematics on two ways

class PlaybackTest : public testing::PlanWorld {
 protected:
  PlaybackTest() : planner_(panda()) {
    planner_.setScene(scene());
    result_ = planner_.plan({});
    EXPECT_TRUE(result_.planned) << result_.reason;
    source_.robot = "/robots/panda";
    source_.scene = "/scene.yaml";
    source_.database = "/db";
    source_.score = "reach";
    source_.packages = {{"panda_description", "/panda"}};
    json_ = Json::parse(planJson(result_, true, &source_));
  }

  PlanFile filed() const { return readPlanFile(write("plan.json", json_.dump())); }
  Playback played(const PlanFile& file, std::size_t mostFrames = 3000) const {
    return playBack(planner_.robot(), planner_.scene().X_WB, planner_.posture(),
                    {{result_.object, planner_.scene().X_WO}}, file.motions, 25, mostFrames);
  }
  std::string refusalOfFile(const std::string& content) const {
    return refusalOf([&] { readPlanFile(write("plan.json", content)); });
  }

  mutable Planner planner_;
  PlanResult result_;
  PlanSource source_;
  Json json_;
};

TEST_F(PlaybackTest, APlanIsReadBackAsItWasWritten) {
  const PlanFile file = filed();
  EXPECT_FALSE(file.isTask);
  EXPECT_EQ(file.status, "planned");
  EXPECT_EQ(file.grasp, result_.grasp.score.grasp);
  EXPECT_EQ(file.rank, result_.rank);
  ASSERT_TRUE(file.source);
  EXPECT_EQ(file.source->robot, source_.robot);
  EXPECT_EQ(file.source->scene, source_.scene);
  EXPECT_EQ(file.source->database, source_.database);
  EXPECT_EQ(file.source->score, "reach");
  EXPECT_EQ(file.source->packages, source_.packages);
  ASSERT_EQ(file.motions.size(), 1u);
  const Trajectory& read = file.motions[0].trajectory;
  ASSERT_EQ(read.points.size(), result_.trajectory.points.size());
  for (std::size_t i = 0; i < read.points.size(); ++i) {
    EXPECT_EQ(read.points[i].time, result_.trajectory.points[i].time);
    EXPECT_EQ(read.points[i].position, result_.trajectory.points[i].position);
  }
}

// The hand arrives where the plan says; the object stays until the lift, then rises by 5 cm without turning.
TEST_F(PlaybackTest, HandAndObjectGoWhereThePlanSays) {
  const PlanFile file = filed();
  const Playback playback = played(file);
  ASSERT_EQ(playback.segments.size(), 4u);
  const Playback::Segment &close = playback.segments[2], &lift = playback.segments[3];
  EXPECT_EQ(close.name, "close");
  EXPECT_NEAR(lift.end, result_.trajectory.points.back().time, 1e-12);
  EXPECT_DOUBLE_EQ(playback.time.back(), lift.end);
  const Arm& arm = planner_.robot().arms[0];
  const Eigen::Isometry3d X_WO = planner_.scene().X_WO;
  bool sawTheEndOfClose = false;
  for (std::size_t k = 0; k < playback.time.size(); ++k) {
    if (k > 0) {
      EXPECT_GT(playback.time[k], playback.time[k - 1]);
    }
    if (playback.time[k] <= close.end) {
      EXPECT_EQ(playback.X_WO[k][0].matrix(), X_WO.matrix()) << playback.time[k];
    }
    if (playback.time[k] != close.end) continue;
    sawTheEndOfClose = true;
    const Eigen::Isometry3d X_WH = playback.X_WL[k][static_cast<std::size_t>(arm.tipLink)] * arm.X_TH;
    EXPECT_TRUE(X_WH.isApprox(result_.grasp.X_WH, 1e-4));
  }
  EXPECT_TRUE(sawTheEndOfClose);
  const Eigen::Isometry3d& end = playback.X_WO.back()[0];
  EXPECT_NEAR((end.translation() - X_WO.translation() - Eigen::Vector3d(0, 0, 0.05)).norm(), 0, 1e-4);
  EXPECT_TRUE(end.linear().isApprox(X_WO.linear(), 1e-3));
  EXPECT_FALSE(playback.droppedAt[0]);
}

// Few frames show the same motion: those that both have are equal.
TEST_F(PlaybackTest, FewerFramesOfTheSameMotion) {
  const PlanFile file = filed();
  const Playback fine = played(file), coarse = played(file, 10);
  EXPECT_LT(coarse.time.size(), 16u);  // and one more for each of five ends of segments
  EXPECT_GT(fine.time.size(), 2 * coarse.time.size());
  EXPECT_TRUE(coarse.X_WL.back().back().isApprox(fine.X_WL.back().back(), kRounding));
  EXPECT_TRUE(coarse.X_WO.back()[0].isApprox(fine.X_WO.back()[0], 1e-6));
}

// Of a task: the object is where the file says when a motion has ended, and gone when it was dropped.
TEST_F(PlaybackTest, ATaskMovesItsObjects) {
  const Json step = {{"step", "drop"},
                     {"object", "toy_box"},
                     {"arm", "arm"},
                     {"rejected", {{"unreachable", 3}}},
                     {"motions", Json::array({{{"arm", planner_.robot().arms[0].name},
                                               {"object_pose_after", {1, 2, 3, 0, 0, 0, 1}},
                                               {"trajectory", json_["trajectory"]}}})}};
  Json task = {{"status", "planned"}, {"steps", Json::array({step})}};
  task["steps"][0]["motions"][0]["trajectory"]["segments"][2]["name"] = "drop";
  PlanFile file = readPlanFile(write("plan.json", task.dump()));
  EXPECT_TRUE(file.isTask);
  EXPECT_EQ(file.steps[0].rejected.at("unreachable"), 3u);
  file.motions.push_back(file.motions[0]);
  const Playback playback = playBack(planner_.robot(), planner_.scene().X_WB, planner_.posture(),
                                     {{"toy_box", planner_.scene().X_WO}}, file.motions);
  EXPECT_TRUE(playback.droppedAt[0]);
  const double first = result_.trajectory.points.back().time;
  EXPECT_DOUBLE_EQ(playback.time.back(), 2 * first);
  for (std::size_t k = 0; k < playback.time.size(); ++k) {
    if (playback.time[k] > first && playback.time[k] < first + 0.1) {
      EXPECT_EQ(playback.X_WO[k][0].translation(), Eigen::Vector3d(1, 2, 3));
    }
  }
}

TEST_F(PlaybackTest, RefusesWhatTheRobotOrSceneDoNotHave) {
  PlanFile file = filed();
  const auto refusal = [&](const std::function<void(FiledMotion&)>& change) {
    PlanFile changed = file;
    change(changed.motions[0]);
    return refusalOf([&] { played(changed); });
  };
  EXPECT_THAT(refusal([](FiledMotion& m) { m.arm = "third"; }), HasSubstr("has no arm third"));
  EXPECT_THAT(refusal([](FiledMotion& m) { m.object = "teapot"; }), HasSubstr("no object teapot"));
  EXPECT_THAT(refusal([](FiledMotion& m) { m.jointNames[0] = "elbow"; }), HasSubstr("elbow"));
}

TEST_F(PlaybackTest, RefusesFilesThatAreNoPlan) {
  EXPECT_THAT(refusalOfFile("{"), HasSubstr("plan.json: "));
  EXPECT_THAT(refusalOfFile("[]"), HasSubstr("want a file that handhold-plan"));
  EXPECT_THAT(refusalOfFile("{\"a\": 1}"), HasSubstr("status"));
  const auto changed = [&](const char* pointer, const Json& value) {
    Json json = json_;
    json[Json::json_pointer(pointer)] = value;
    return refusalOfFile(json.dump());
  };
  EXPECT_THAT(changed("/trajectory/points/1/time_from_start", -1), HasSubstr("at point 1"));
  EXPECT_THAT(changed("/trajectory/points/1/positions", Json::array({1, 2})), HasSubstr("2 numbers, want 8"));
  EXPECT_THAT(changed("/trajectory/segments/1/end", 1'000'000), HasSubstr("segment approach"));
  EXPECT_THAT(changed("/trajectory/points", Json::array()), HasSubstr("segment transit"));
  EXPECT_THAT(changed("/trajectory/joint_names", "joint_1"), HasSubstr("plan.json: "));
  EXPECT_THAT(refusalOf([&] { readPlanFile(folder_ / "none.json"); }), HasSubstr("none.json: cannot be read"));
}

}  // namespace
}  // namespace handhold
