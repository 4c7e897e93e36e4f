#include "plan/planner.h"
#include "plan/task_planner.h"

#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Json = nlohmann::ordered_json;

Json poseJson(const Eigen::Isometry3d& X) {
  const Eigen::Quaterniond q(X.linear());
  return {X.translation().x(), X.translation().y(), X.translation().z(), q.x(), q.y(), q.z(), q.w()};
}

Json vectorJson(const Eigen::VectorXd& v) { return std::vector<double>(v.data(), v.data() + v.size()); }

/// @param file  scene or task: what the file is called among the keys
Json sourceJson(const PlanSource& source, const char* file) {
  Json json = {{"robot", source.robot}, {file, source.scene}, {"db", source.database}, {"score", source.score}};
  if (!source.calibrations.empty()) json["calibrations"] = source.calibrations;
  if (!source.packages.empty()) json["packages"] = source.packages;
  return json;
}

Json termsJson(const GraspScore& score) { return {{"gq", score.gq}, {"gb", score.gb}, {"ge", score.ge}}; }

Json trajectoryJson(const std::vector<std::string>& jointNames, const Trajectory& trajectory) {
  Json points = Json::array(), segments = Json::array();
  for (const TrajectoryPoint& point : trajectory.points) {
    points.push_back({{"time_from_start", point.time},
                      {"positions", vectorJson(point.position)},
                      {"velocities", vectorJson(point.velocity)}});
  }
  for (const TrajectorySegment& segment : trajectory.segments) {
    segments.push_back({{"name", segment.name}, {"begin", segment.begin}, {"end", segment.end}});
  }
  return {{"joint_names", jointNames}, {"points", points}, {"segments", segments}};
}

}  // namespace

std::string rankingJson(const Planner& planner, const Ranking& ranking, std::size_t top) {
  Json list = Json::array();
  for (std::size_t i = 0; i < ranking.grasps.size() && (top == 0 || i < top); ++i) {
    const RankedGrasp& grasp = ranking.grasps[i];
    Json row = {{"rank", i + 1}, {"grasp", grasp.score.grasp}, {"trial", grasp.trial}, {"score", grasp.score.score}};
    row.update(termsJson(grasp.score));
    row["hand_pose"] = poseJson(grasp.X_WH);
    row["arm"] = planner.robot().arms[grasp.score.arm].name;
    list.push_back(std::move(row));
  }
  return list.dump();
}

std::string planJson(const PlanResult& result, bool pretty, const PlanSource* source) {
  Json json = {{"status", result.planned ? "planned" : "infeasible"}, {"object", result.object}};
  if (result.planned) {
    json["hand"] = result.hand;
    json["arm"] = result.arm;
    json["set_version"] = result.setVersion;
    json["grasp"] = result.grasp.score.grasp;
    json["trial"] = result.grasp.trial;
    json["rank"] = result.rank;
    json["score"] = result.grasp.score.score;
    json["terms"] = termsJson(result.grasp.score);
    json["hand_pose"] = poseJson(result.grasp.X_WH);
    json["clearance"] = result.clearance;
  } else {
    json["reason"] = result.reason;
  }
  json["tested"] = result.tested;
  json["rejected"] = result.rejected;
  for (const PlanResult::Traced& traced : result.trace) {
    Json row = {{"rank", traced.rank}, {"grasp", traced.grasp.score.grasp}, {"reason", traced.reason}};
    row["detail"] = traced.detail;
    json["trace"].push_back(std::move(row));
  }
  if (result.planned) json["trajectory"] = trajectoryJson(result.jointNames, result.trajectory);
  json["checks"] = result.checks;
  if (result.stopped) json["stopped"] = true;
  json["timing_ms"] = result.timingMs;
  if (source != nullptr) json["source"] = sourceJson(*source, "scene");
  return json.dump(pretty ? 1 : -1);
}

std::string taskJson(const Task& task, const Robot& robot, const TaskResult& result, bool pretty,
                     const PlanSource* source) {
  Json json = {{"status", result.done ? "planned" : result.feasible ? "failed" : "infeasible"}};
  if (!result.done) json["reason"] = result.reason;
  json["steps"] = Json::array();
  for (std::size_t i = 0; i < result.steps.size(); ++i) {
    const TaskStepResult& step = result.steps[i];
    Json row = {{"step", kVerbNames[static_cast<std::size_t>(task.steps[i].verb)]},
                {"object", task.objects[task.steps[i].object].name},
                {"rejected", step.rejected}};
    if (result.done) {
      row["arm"] = robot.arms[step.arm].name;
      row["grasp"] = step.grasp;
      row["trial"] = step.trial;
      for (const TaskMotion& motion : step.motions) {
        row["motions"].push_back({{"arm", robot.arms[motion.arm].name},
                                  {"object_pose", poseJson(motion.X_WO)},
                                  {"object_pose_after", poseJson(motion.X_WO_after)},
                                  {"trajectory", trajectoryJson(motion.jointNames, motion.trajectory)}});
      }
    }
    json["steps"].push_back(std::move(row));
  }
  json["checks"] = result.checks;
  if (source != nullptr) {
    json["source"] = sourceJson(*source, "task");
    json["source"]["seed"] = source->seed;
    if (source->draw) json["source"]["draw"] = *source->draw;
  }
  return json.dump(pretty ? 1 : -1);
}

}  // namespace handhold
