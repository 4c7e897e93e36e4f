#include "app/plan_report_command.h"

#include "app/program.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "plan/playback.h"
#include "plan/task_trials.h"
#include "scene/distance_map.h"
#include "view/report_plan.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

constexpr std::size_t kMostRanks = 5000;  // rows of the ranking on the page
constexpr double kSamePlace = 1e-6;       // m

/// What the plan says it was made from, with what the command says instead.
PlanSource sourceOf(const PlanReportCommand& command, const PlanFile& file) {
  PlanSource source = file.source.value_or(PlanSource{});
  if (!command.robot.empty()) source.robot = command.robot;
  if (!command.scene.empty()) source.scene = command.scene;
  if (!command.database.empty()) source.database = command.database;
  for (const auto& [name, folder] : command.packages) source.packages[name] = folder;
  if (source.robot.empty() || source.scene.empty() || source.database.empty()) {
    throw InputError(
        fmt::format("{}: does not say what it was made from, want --robot, --scene and --db", command.plan));
  }
  return source;
}

/// `hand_over` of t_bar is "hand over t_bar".
std::string stepName(std::string step, const std::string& object) {
  std::replace(step.begin(), step.end(), '_', ' ');
  return step + " " + object;
}

void append(std::vector<float>& array, const Eigen::Vector3d& v) {
  for (const double x : v) array.push_back(static_cast<float>(x));
}

/// Robot, objects and obstacles with their poses over time, and the times.
void addBodies(const Robot& robot, const std::vector<PlayedObject>& objects, const std::vector<TriangleMesh>& meshes,
               const std::vector<Obstacle>& obstacles, const Playback& playback, ReportedPlan& report) {
  using Role = ReportedBody::Role;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    ReportedBody body{objects[i].name, Role::object, meshes[i], {}, playback.droppedAt[i].value_or(-1)};
    for (const auto& frame : playback.X_WO) body.X_W.push_back(frame[i]);
    report.bodies.push_back(std::move(body));
  }
  std::set<int> handLinks;
  for (const Arm& arm : robot.arms) handLinks.insert(arm.handLinks.begin(), arm.handLinks.end());
  for (std::size_t i = 0; i < robot.body.links.size(); ++i) {
    const Link& link = robot.body.links[i];
    if (link.mesh.triangles.empty()) continue;
    const Role role = handLinks.count(static_cast<int>(i)) > 0 ? Role::hand : Role::robot;
    ReportedBody body{link.name, role, link.mesh, {}};
    for (const auto& frame : playback.X_WL) body.X_W.push_back(frame[i]);
    report.bodies.push_back(std::move(body));
  }
  for (const Obstacle& obstacle : obstacles) {
    report.bodies.push_back({obstacle.name, Role::obstacle, obstacle.shape->mesh, {obstacle.X_WS}});
  }
  report.time = playback.time;
  for (const Playback::Segment& segment : playback.segments) {
    const std::string note = segment.step.empty() ? "" : stepName(segment.step, segment.object);
    report.segments.push_back({segment.name, note, segment.begin, segment.end});
  }
}

/// Clearance of the target's surface in the scene (Berenson et al. 2007, figure 6).
ReportedMap distanceMapOf(const Scene& scene, const GraspTable& table, double far) {
  SceneRays rays;
  rays.update(scene.obstacles);
  ReportedMap map;
  map.label = "Distance map";
  map.unit = "m";
  map.meaning = fmt::format(
      "how far the surface point is from the nearest obstacle in a cone of 15 degrees about its "
      "normal, at most {} m",
      far);
  map.point = table.mapPoint;
  map.normal = table.mapNormal;
  DistanceMap({.far = far}).compute(rays, map.point, map.normal, scene.X_WO, map.value);
  return map;
}

/// The score and its terms, each of the best grasp at every target point (figure 7).
std::vector<ReportedMap> scoreMaps(const Ranking& ranking, int arm, const GraspTable& table, ScoreKind kind,
                                   bool calibrated) {
  const bool paper = kind == ScoreKind::paper;
  std::vector<ReportedMap> maps(4);
  const std::array<const char*, 4> labels = {"Environment clearance Ge", "Grasp quality Gq", "Robot position Gb",
                                             "Score G"};
  const std::array<const char*, 4> meanings = {
      paper ? "mean of the distance map about the target point" : "clearance of the hand on its way in and of the arm",
      calibrated ? "calibrated probability that the grasp holds" : "epsilon by the largest of the set",
      paper ? "does the approach lead away from the shoulder" : "does inverse kinematics reach grasp and pre-grasp",
      "all three together: the order in which grasps are tested"};
  for (std::size_t i = 0; i < 4; ++i) maps[i].label = labels[i], maps[i].meaning = meanings[i];
  std::set<std::uint32_t> seen;  // the ranking is best first
  for (const RankedGrasp& ranked : ranking.grasps) {
    if (ranked.score.arm != arm || !seen.insert(ranked.trial[0]).second) continue;
    const StoredGrasp& grasp = table.grasps[ranked.score.grasp];
    const std::array<double, 4> values = {ranked.score.ge, ranked.score.gq, ranked.score.gb, ranked.score.score};
    for (std::size_t i = 0; i < 4; ++i) {
      append(maps[i].point, grasp.targetPoint);
      append(maps[i].normal, -grasp.approach);
      maps[i].value.push_back(static_cast<float>(values[i]));
    }
  }
  return maps;
}

void addRanking(Planner& planner, const Ranking& ranking, const PlanResult& result, ReportedPlan& report) {
  const Robot& robot = planner.robot();
  for (const Arm& arm : robot.arms) report.hands.push_back(&arm.hand);
  std::map<std::size_t, const PlanResult::Traced*> traced;
  for (const PlanResult::Traced& row : result.trace) traced[row.rank] = &row;
  report.ranked = ranking.grasps.size();
  const std::size_t rows = std::min(ranking.grasps.size(), std::max(kMostRanks, result.tested));
  for (std::size_t i = 0; i < rows; ++i) {
    const RankedGrasp& ranked = ranking.grasps[i];
    const StoredGrasp& grasp = planner.graspTable(result.object, ranked.score.arm)->grasps[ranked.score.grasp];
    ReportedRank row;
    row.hand = ranked.score.arm;
    row.arm = robot.arms[static_cast<std::size_t>(ranked.score.arm)].name;
    row.grasp = ranked.score.grasp;
    row.score = ranked.score.score;
    row.gq = ranked.score.gq, row.gb = ranked.score.gb, row.ge = ranked.score.ge;
    row.X_WH = ranked.X_WH;
    row.jointPosition = grasp.finalPosition;
    if (const auto at = traced.find(i + 1); at != traced.end()) {
      row.verdict = at->second->reason;
      row.detail = at->second->detail;
    } else if (result.planned && result.rank == i + 1) {
      row.verdict = "planned";
    }
    report.ranking.push_back(std::move(row));
  }
  report.rejected = {result.rejected.begin(), result.rejected.end()};
}

/// The plan is made again, which tells what its file does not: why grasps were rejected. It must be the same one.
PlanResult planAgain(const PlanReportCommand& command, const PlanFile& file, ScoreKind kind, Planner& planner) {
  PlanRequest request;
  request.score = kind;
  request.trace = true;
  PlanResult result = planner.plan(request);
  const bool planned = !file.motions.empty();
  bool same = result.planned == planned;
  if (same && planned) {
    same = result.arm == file.arm && result.setVersion == file.setVersion && result.grasp.score.grasp == file.grasp &&
           result.trajectory.points.size() == file.motions[0].trajectory.points.size() &&
           (result.trajectory.points.back().position - file.motions[0].trajectory.points.back().position).norm() <
               kSamePlace;
  }
  if (!same) {
    throw InputError(
        fmt::format("{}: robot, scene and database now give another plan ({}), want them as they were, or a new plan",
                    command.plan, result.planned ? fmt::format("grasp {}", result.grasp.score.grasp) : result.reason));
  }
  return result;
}

ReportedPlan reportPlan(const PlanReportCommand& command, const PlanFile& file, const PlanSource& source,
                        Planner& planner) {
  const Robot& robot = planner.robot();
  const ScoreKind kind = *scoreOf(source.score);
  planner.loadScene(source.scene);
  const PlanResult result = planAgain(command, file, kind, planner);
  const Ranking ranking = planner.rank(kind);
  const Scene& scene = planner.scene();

  ReportedPlan report;
  report.title = fmt::format("{} by {}", result.object, robot.name);
  report.status = file.status;
  const std::vector<PlayedObject> objects = {{result.object, scene.X_WO}};
  const Playback playback = playBack(robot, scene.X_WB, planner.posture(), objects, file.motions);
  addBodies(robot, objects, {planner.objectMesh(result.object)}, scene.obstacles, playback, report);
  addRanking(planner, ranking, result, report);
  if (!ranking.grasps.empty()) {
    const int arm = (result.planned ? result.grasp : ranking.grasps.front()).score.arm;
    const auto table = planner.graspTable(result.object, arm);
    report.maps = scoreMaps(ranking, arm, *table, kind, !source.calibrations.empty());
    report.maps.insert(report.maps.begin(), distanceMapOf(scene, *table, robot.score.far));
  }
  auto& facts = report.facts;
  if (!file.reason.empty()) facts.emplace_back("Reason", file.reason);
  if (result.planned) {
    facts.emplace_back("Arm and hand", fmt::format("{}, {}", result.arm, result.hand));
    facts.emplace_back("Grasp", fmt::format("{} of set version {}", result.grasp.score.grasp, result.setVersion));
    facts.emplace_back("Rank", fmt::format("{} of {}", result.rank, ranking.grasps.size()));
    facts.emplace_back("Motion", fmt::format("{:.2f} s", playback.time.back()));
    facts.emplace_back("Clearance", fmt::format("{:.1f} mm in transit", 1000 * result.clearance));
  }
  facts.emplace_back("Tested", fmt::format("{} grasps", result.tested));
  facts.emplace_back("Score", source.score);
  if (!source.calibrations.empty())
    facts.emplace_back("Gq by", fmt::format("{}", fmt::join(source.calibrations, ", ")));
  return report;
}

ReportedPlan reportTask(const PlanFile& file, const PlanSource& source, Planner& planner) {
  const Robot& robot = planner.robot();
  const ObjectMeshes meshOf = [&](const std::string& object) { return planner.objectMesh(object); };
  Task task = loadTask(source.scene, robot, meshOf);
  if (source.draw) task = drawTask(task, meshOf, source.seed, static_cast<int>(*source.draw));
  Scene scene = task.surroundings;
  scene.target = task.objects.front().object;  // any, so that the planner knows where the robot stands
  scene.X_WO = task.objects.front().X_WO;
  planner.setScene(scene);

  ReportedPlan report;
  report.title = fmt::format("{} by {}", std::filesystem::path(source.scene).stem().string(), robot.name);
  report.status = file.status;
  std::vector<PlayedObject> objects;
  std::vector<TriangleMesh> meshes;
  for (const TaskObject& object : task.objects) {
    objects.push_back({object.name, object.X_WO});
    meshes.push_back(planner.objectMesh(object.object));
  }
  const Playback playback = playBack(robot, scene.X_WB, planner.posture(), objects, file.motions);
  addBodies(robot, objects, meshes, scene.obstacles, playback, report);
  if (!file.reason.empty()) report.facts.emplace_back("Reason", file.reason);
  if (playback.time.back() > 0) report.facts.emplace_back("Motion", fmt::format("{:.1f} s", playback.time.back()));
  std::map<std::string, std::size_t> rejected;
  for (const FiledStep& step : file.steps) {
    report.facts.emplace_back(stepName(step.step, step.object),
                              fmt::format("{}{}", step.arm.empty() ? "not done" : armText(step.arm),
                                          step.rejected.empty() ? "" : "; rejected: " + counted(step.rejected)));
    for (const auto& [reason, count] : step.rejected) rejected[reason] += count;
  }
  report.rejected = {rejected.begin(), rejected.end()};
  return report;
}

}  // namespace

int runPlanReport(const PlanReportCommand& command) {
  const PlanFile file = readPlanFile(command.plan);
  const PlanSource source = sourceOf(command, file);
  Planner planner(source.database, loadRobot(source.robot, source.packages), withCalibrations(source.calibrations));
  ReportedPlan report;
  try {
    report = file.isTask ? reportTask(file, source, planner) : reportPlan(command, file, source, planner);
  } catch (const InputError& error) {
    const std::string message = error.what();
    throw message.starts_with(command.plan) ? error : InputError(fmt::format("{}: {}", command.plan, message));
  }
  report.facts.emplace_back("Robot", source.robot);
  report.facts.emplace_back(file.isTask ? "Task" : "Scene", source.scene);
  report.facts.emplace_back("Database", source.database);
  const std::string html = planReportHtml(report);
  replaceContent(command.output, html);
  fmt::print("{}: {}, {} bodies, {} times, {:.1f} MB\n", command.output, report.status, report.bodies.size(),
             report.time.size(), static_cast<double>(html.size()) / 1e6);
  return kExitDone;
}

}  // namespace handhold
