// The online program: ranks stored grasps in the present scene and plans with them.
#include "app/experiment_command.h"
#include "app/plan_report_command.h"
#include "app/program.h"
#include "app/task_command.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "plan/planner.h"
#include "plan/server.h"

#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string robot, scene, score = "paper", format = "table", output, record, replay, srdf;
  std::string database = defaultDatabase();
  std::vector<std::string> packages, calibrations;
  std::size_t top = 20;
  bool trace = false, initialise = false;
};

Planner makePlanner(const Options& options) {
  return Planner(options.database, loadRobot(options.robot, parsePackages(options.packages)),
                 withCalibrations(options.calibrations));
}

void loadSceneOf(const Options& options, Planner& planner) {
  planner.loadScene(options.scene);
  for (const std::string& note : planner.scene().notes) logInfo(fmt::format("{}: {}", options.scene, note));
}

std::string rankingTable(const Planner& planner, const Ranking& ranking, const Options& options) {
  std::string text = fmt::format("{:>5} {:>6} {:>14}  {:<8} {:>8} {:>6} {:>6} {:>6}  {:<24}\n", "rank", "grasp",
                                 "trial", "arm", "score", "gq", "gb", "ge", "hand at [m]");
  for (std::size_t i = 0; i < std::min(options.top, ranking.grasps.size()); ++i) {
    const RankedGrasp& g = ranking.grasps[i];
    const Eigen::Vector3d& p = g.X_WH.translation();
    text += fmt::format("{:>5} {:>6} {:>14}  {:<8} {:>8.4f} {:>6.3f} {:>6.3f} {:>6.3f}  {:.3f} {:.3f} {:.3f}\n", i + 1,
                        g.score.grasp, fmt::format("{},{},{}", g.trial[0], g.trial[1], g.trial[2]),
                        planner.robot().arms[g.score.arm].name, g.score.score, g.score.gq, g.score.gb, g.score.ge,
                        p.x(), p.y(), p.z());
  }
  const bool isPaper = scoreOf(options.score) == ScoreKind::paper;
  text += "  trial  sample, roll, preshape\n";
  text += fmt::format("  gq     {}\n", options.calibrations.empty() ? "epsilon over the largest of the set"
                                                                    : "the probability that the grasp holds");
  text +=
      fmt::format("  gb     {}\n", isPaper ? "cosine between the approach and the way from the shoulder to the object"
                                           : "1: the arm reaches the grasp and a place before it, 0.5: the grasp");
  text += fmt::format("  ge     {}\n", isPaper ? "clearance of the target point, 1: enough"
                                               : "clearance of the hand on its way and of the arm, 1: enough");
  return text;
}

int runRank(const Options& options) {
  Planner planner = makePlanner(options);
  loadSceneOf(options, planner);
  const Ranking ranking = planner.rank(*scoreOf(options.score));
  if (options.format == "json") {
    fmt::print("{}\n", rankingJson(planner, ranking, options.top));
  } else {
    fmt::print("{}{} {} of {}, score {}{}\n", rankingTable(planner, ranking, options), ranking.grasps.size(),
               ranking.grasps.size() == 1 ? "grasp" : "grasps", planner.scene().target, options.score,
               options.calibrations.empty() ? "" : fmt::format(", gq by {}", fmt::join(options.calibrations, ", ")));
  }
  if (ranking.grasps.empty()) logWarning(fmt::format("the sets of {} have no grasp", planner.scene().target));
  return ranking.grasps.empty() ? kExitItemFailed : kExitDone;
}

double durationOf(const Trajectory& trajectory, const TrajectorySegment& segment) {
  return trajectory.points[segment.end].time - trajectory.points[segment.begin].time;
}

/// What was done, in a few lines.
std::string summary(const PlanResult& result, const Planner& planner) {
  const auto total = [&] {
    double sum = 0;
    for (const auto& [stage, ms] : result.timingMs) sum += ms;
    return sum;
  }();
  std::string text;
  if (!result.planned) {
    text = fmt::format("infeasible: {} by {}: {}\n", result.object, planner.robot().name, result.reason);
  } else {
    text = fmt::format("planned: {} by {}, {}, hand {}: grasp {} of set version {}, rank {}\n", result.object,
                       planner.robot().name, armText(result.arm), result.hand, result.grasp.score.grasp,
                       result.setVersion, result.rank);
    text += fmt::format("terms: gq {:.3f}, gb {:.3f}, ge {:.3f}\n", result.grasp.score.gq, result.grasp.score.gb,
                        result.grasp.score.ge);
  }
  text += fmt::format("tested: {} grasp{}; rejected: {}\n", result.tested, result.tested == 1 ? "" : "s",
                      counted(result.rejected));
  if (result.planned) {
    std::string parts;
    for (const TrajectorySegment& segment : result.trajectory.segments) {
      parts +=
          fmt::format("{}{} {:.2f} s", parts.empty() ? "" : ", ", segment.name, durationOf(result.trajectory, segment));
    }
    text += fmt::format("motion: {:.2f} s ({}), {} points, clearance {:.1f} mm in transit\n",
                        result.trajectory.points.back().time, parts, result.trajectory.points.size(),
                        1000 * result.clearance);
  }
  std::string stages;
  for (const auto& [stage, ms] : result.timingMs) {
    stages += fmt::format("{}{} {:.1f}", stages.empty() ? "" : ", ", stage, ms);
  }
  return text + fmt::format("time: {:.0f} ms ({})\n", total, stages);
}

PlanSource sourceOf(const Options& options) {
  PlanSource source;
  source.robot = fs::absolute(options.robot).lexically_normal().string();
  source.scene = fs::absolute(options.scene).lexically_normal().string();
  source.database = fs::absolute(options.database).lexically_normal().string();
  source.score = options.score;
  for (const std::string& path : options.calibrations) {
    source.calibrations.push_back(fs::absolute(path).lexically_normal().string());
  }
  for (const auto& [name, folder] : parsePackages(options.packages)) {
    source.packages[name] = fs::absolute(folder).lexically_normal().string();
  }
  return source;
}

int runPlan(const Options& options) {
  Planner planner = makePlanner(options);
  loadSceneOf(options, planner);
  PlanRequest request;
  request.score = *scoreOf(options.score);
  request.trace = options.trace;
  PlanResult result;
  try {
    result = planner.plan(request);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", options.scene, error.what()));
  }
  for (const PlanResult::Traced& traced : result.trace) {
    logInfo(
        fmt::format("rank {}, grasp {}: {}: {}", traced.rank, traced.grasp.score.grasp, traced.reason, traced.detail));
  }
  const std::string text = summary(result, planner);
  const PlanSource source = sourceOf(options);
  if (options.output.empty()) {
    fmt::print(stderr, "{}", text);
    fmt::print("{}\n", planJson(result, true, &source));
  } else {
    replaceContent(options.output, planJson(result, true, &source) + "\n");
    fmt::print("{}", text);
  }
  return result.planned ? kExitDone : kExitItemFailed;
}

int runServe(const Options& options) {
  Planner planner = makePlanner(options);
  PlanServer server(planner);
  if (!options.replay.empty()) {
    std::ifstream record(options.replay);
    if (!record) throw InputError(fmt::format("{}: cannot be read, want a file that --record wrote", options.replay));
    return replay(server, record, options.replay, std::cout) ? kExitDone : kExitItemFailed;
  }
  std::ofstream record;
  if (!options.record.empty()) {
    record.open(options.record, std::ios::trunc);
    if (!record) throw SystemError(fmt::format("{}: cannot be written", options.record));
  }
  serve(server, std::cin, std::cout, options.record.empty() ? nullptr : &record);
  return kExitDone;
}

void describe(const Robot& robot) {
  fmt::print("{}: {} links, {} joints\n", robot.name, robot.body.links.size(), robot.body.joints.size());
  for (const Arm& arm : robot.arms) {
    std::vector<std::string> names;
    for (const int joint : arm.joints) names.push_back(robot.body.joints[joint].name);
    fmt::print("arm {}: {} joints ({}), hand {}\n", arm.name, arm.joints.size(), fmt::join(names, ", "), arm.hand.name);
  }
  fmt::print("allowed to touch: {} pairs of links\n", robot.allowedCollisions.size());
  for (const std::string& note : robot.notes) fmt::print("note: {}\n", note);
}

int runRobot(const Options& options) {
  const PackagePaths packages = parsePackages(options.packages);
  if (options.initialise) {
    fmt::print("{}", initialRobotConfig(options.robot, options.srdf, packages));
  } else {
    describe(loadRobot(options.robot, packages));
  }
  return kExitDone;
}

int runProgram(int argc, char** argv) {
  CLI::App app("Handhold ranks stored grasps in the present scene and plans with them.", "handhold-plan");
  app.set_version_flag("--version", "handhold-plan " HANDHOLD_VERSION);
  app.require_subcommand(1);
  Options options;
  const CLI::IsMember isScore(std::vector<std::string>(kScoreNames.begin(), kScoreNames.end()));
  const auto addRobot = [&](CLI::App* command) {
    command->add_option("--robot", options.robot, "the robot's folder, or its YAML file")->required()->type_name("DIR");
    command->add_option("--db", options.database, "the database folder (default: $HANDHOLD_DB, then ./db)");
    command->add_option("--package", options.packages, "NAME=DIR: where package://NAME/ leads")->type_name("NAME=DIR");
  };
  const auto addCalibration = [&](CLI::App* command) {
    command
        ->add_option("--calibration", options.calibrations,
                     "gq is the probability that a grasp holds: a file of handhold physics --calibrate, one a hand")
        ->type_name("FILE")
        ->expected(1)
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  };
  const auto addScene = [&](CLI::App* command) {
    addRobot(command);
    addCalibration(command);
    command->add_option("--scene", options.scene, "the scene file")->required()->type_name("SCENE.yaml");
    command
        ->add_option("--score", options.score,
                     "paper: Berenson et al. 2007; reach: exact inverse kinematics and the "
                     "swept hand")
        ->check(isScore);
  };

  CLI::App* rank = app.add_subcommand("rank", "the stored grasps in the order in which they are worth trying here");
  addScene(rank);
  rank->add_option("--top", options.top, "at most K (default 20; 0: all)")
      ->check(CLI::Range(0, std::numeric_limits<int>::max()))
      ->type_name("K");
  rank->add_option("--format", options.format, "table or json")->check(CLI::IsMember({"table", "json"}));

  CLI::App* plan = app.add_subcommand("plan", "the first grasp that works here, with the motion of arm and hand");
  addScene(plan);
  plan->add_flag("--trace", options.trace, "say why each grasp before it was rejected");
  plan->add_option("--out", options.output, "write the plan here (default: stdout)")->type_name("PLAN.json");

  CLI::App* server = app.add_subcommand("serve", "answer requests on stdin, one JSON object a line");
  addRobot(server);
  addCalibration(server);
  CLI::Option* record =
      server->add_option("--record", options.record, "write every request and answer here")->type_name("FILE");
  server->add_option("--replay", options.replay, "ask a record's requests again, say which answers differ")
      ->type_name("FILE")
      ->excludes(record);

  TaskCommand task;
  CLI::App* tasks = app.add_subcommand("task", "what to do with several objects, step by step, with all motions");
  addRobot(tasks);
  addCalibration(tasks);
  tasks->add_option("task", task.task, "the task file")->required()->type_name("TASK.yaml");
  tasks->add_option("--score", options.score, "the order of the grasps: paper or reach")->check(isScore);
  tasks->add_option("--seed", task.options.seed, "of poses, motions and random scenes (default 1)");
  CLI::Option* trials = tasks->add_option("--trials", task.trials, "draw and plan random scenes until N are feasible")
                            ->check(CLI::Range(1, 1'000'000))
                            ->type_name("N");
  tasks->add_option("--draw", task.draw, "plan random scene I instead of the file's")
      ->check(CLI::Range(0, 10'000'000))
      ->type_name("I")
      ->excludes(trials);
  tasks->add_option("--threads", task.threads, "of --trials (default: one a core)")
      ->check(CLI::Range(1, 1024))
      ->needs(trials);
  tasks->add_option("--out", task.output, "write the plan, or the trials, here")->type_name("FILE.json");

  ExperimentCommand experiment;
  CLI::App* bench = app.add_subcommand("bench", "how many grasps are tested until one works, against random order");
  bench->add_option("--robot", experiment.robots, "a robot's folder; may be given again")->required()->type_name("DIR");
  bench->add_option("--object", experiment.objectGlob, "only objects whose name matches")->type_name("GLOB");
  bench->add_option("--db", options.database, "the database folder (default: $HANDHOLD_DB, then ./db)");
  bench->add_option("--scenes", experiment.options.scenes, "random scenes of each robot and object (default 50)")
      ->check(CLI::Range(1, 1'000'000));
  bench->add_option("--seed", experiment.options.seed, "of the scenes and shuffles (default 1)");
  bench->add_option("--threads", experiment.threads, "default: one a core")->check(CLI::Range(1, 1024));
  bench->add_option("--order", experiment.order, "a JSON file {\"SCENE\": [GRASP, ...]}: this order is tested too")
      ->type_name("FILE");
  bench->add_option("--format", experiment.format, "table or json")->check(CLI::IsMember({"table", "json"}));
  bench->add_option("--out", experiment.output, "write scenes, cells, ablation, sweep and a box plot here")
      ->type_name("DIR");
  bench->add_option("--package", options.packages, "NAME=DIR: where package://NAME/ leads")->type_name("NAME=DIR");

  PlanReportCommand reporting;
  CLI::App* report = app.add_subcommand(
      "report", "a plan or task in one HTML file that a browser shows: scene, maps, ranking, motion");
  report->add_option("plan", reporting.plan, "what plan or task wrote")->required()->type_name("PLAN.json");
  report->add_option("--out", reporting.output, "the file to write")->required()->type_name("FILE.html");
  report->add_option("--robot", reporting.robot, "instead of the robot that the plan names")->type_name("DIR");
  report->add_option("--scene", reporting.scene, "instead of the scene or task that the plan names")->type_name("FILE");
  report->add_option("--db", reporting.database, "instead of the database that the plan names")->type_name("DIR");
  report->add_option("--package", options.packages, "NAME=DIR: where package://NAME/ leads")->type_name("NAME=DIR");

  CLI::App* robot = app.add_subcommand("robot", "check a robot, or write a first robot.yaml for a URDF");
  robot->add_option("robot", options.robot, "the robot's folder, or a URDF with --init")
      ->required()
      ->type_name("DIR|FILE.urdf");
  CLI::Option* init = robot->add_flag("--init", options.initialise, "print a robot.yaml to start from");
  robot->add_option("--srdf", options.srdf, "take pairs that may touch and the home from it")
      ->type_name("FILE")
      ->needs(init);
  robot->add_option("--package", options.packages, "NAME=DIR: where package://NAME/ leads")->type_name("NAME=DIR");

  if (const int exit = parseArguments(app, argc, argv); exit >= 0) return exit;
  if (options.top == 0) options.top = std::numeric_limits<std::size_t>::max();
  if (*rank) return runRank(options);
  if (*plan) return runPlan(options);
  if (*server) return runServe(options);
  if (*tasks) {
    task.robot = options.robot;
    task.database = options.database;
    task.packages = parsePackages(options.packages);
    task.options.score = *scoreOf(options.score);
    options.scene = task.task;
    task.source = sourceOf(options);
    return runTask(task);
  }
  if (*bench) {
    experiment.database = options.database;
    experiment.packages = parsePackages(options.packages);
    return runExperimentCommand(experiment);
  }
  if (*report) {
    reporting.packages = parsePackages(options.packages);
    return runPlanReport(reporting);
  }
  return runRobot(options);
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) { return handhold::runGuarded(handhold::runProgram, argc, argv); }
