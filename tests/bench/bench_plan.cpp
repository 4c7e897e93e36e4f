// Times what happens online: distance map, scores, inverse kinematics, validation and whole plans, in the random scenes
// of the experiment (plan/experiment.h), for each robot; and the same search in random order as the baseline of the
// run.
//
//     bench_plan --database DIR [--object NAME] [--scenes N] [--json]
#include "bench/timings.h"
#include "core/random.h"
#include "plan/experiment.h"

#include <algorithm>
#include <cstdio>
#include <numeric>
#include <string>
#include <string_view>

#include <fmt/core.h>

namespace handhold {
namespace {

using bench::timed;
using bench::Timings;
using nlohmann::ordered_json;

struct Options {
  std::string database, object = "mug";
  int scenes = 50;
  bool json = false;
};

constexpr int kValidated = 20;  // grasps of a scene that are validated for the time of one

/// Until a grasp works: time of validating in an order.
double searchTime(Planner& planner, const std::vector<GraspScore>& order) {
  const double before = bench::microsecondsNow();
  for (const GraspScore& score : order) {
    if (!planner.test(score)) break;
  }
  return bench::microsecondsNow() - before;
}

std::vector<GraspScore> scoresOf(const Ranking& ranking) {
  std::vector<GraspScore> scores;
  for (const RankedGrasp& grasp : ranking.grasps) scores.push_back(grasp.score);
  return scores;
}

std::vector<GraspScore> shuffled(std::vector<GraspScore> scores, const RandomStream& stream) {
  for (std::size_t i = scores.size() - 1; i > 0; --i) std::swap(scores[i], scores[stream.bits(i) % (i + 1)]);
  return scores;
}

struct Results {
  Timings map, score, reach, ik, validate, plan, searchPaper, searchReach, searchRandom;
  std::size_t grasps = 0;
  int planned = 0;
  double trajectory = 0;  // s, of all plans
};

void measureScene(Planner& planner, int scene, Results& results) {
  for (Timings* timings : {&results.map, &results.score, &results.reach, &results.ik, &results.validate, &results.plan,
                           &results.searchPaper, &results.searchReach, &results.searchRandom}) {
    timings->startRepeat();
  }
  Ranking paper = planner.rank(ScoreKind::paper);
  results.grasps = paper.grasps.size();
  results.map.add(1000 * paper.timingMs.at("distance_map"));
  results.score.add(1000 * paper.timingMs.at("score"));
  const Ranking reach = planner.rank(ScoreKind::reach);
  results.reach.add(1000 * reach.timingMs.at("score"));
  const double before = bench::microsecondsNow();
  planner.reachableShare();
  results.ik.add((bench::microsecondsNow() - before) / static_cast<double>(paper.grasps.size()));
  const std::vector<GraspScore> byPaper = scoresOf(paper), byReach = scoresOf(reach);
  for (int i = 0; i < std::min<int>(kValidated, static_cast<int>(byPaper.size())); ++i) {
    timed(results.validate, [&] { return planner.test(byPaper[static_cast<std::size_t>(i)]); });
  }
  results.searchPaper.add(searchTime(planner, byPaper));
  results.searchReach.add(searchTime(planner, byReach));
  results.searchRandom.add(searchTime(planner, shuffled(byPaper, RandomStream(static_cast<std::uint64_t>(scene)))));
  PlanRequest request;
  request.score = ScoreKind::reach;
  const PlanResult plan = timed(results.plan, [&] { return planner.plan(request); });
  if (!plan.planned) return;
  ++results.planned;
  results.trajectory += plan.trajectory.points.back().time;
}

ordered_json measure(const std::string& robotPath, const Options& options) {
  Planner planner(options.database, loadRobot(std::string(HANDHOLD_SOURCE_DIR) + "/robots/" + robotPath));
  ExperimentOptions experiment;
  experiment.seed = 2001;  // no reported experiment's
  Results results;
  for (int i = 0; i < options.scenes; ++i) {
    takeRandomScene(planner, options.object, i, experiment);
    measureScene(planner, i, results);
  }
  const auto row = [](const Timings& timings) {
    const ordered_json json = timings.json();
    return ordered_json{{"median_us", timings.median()}, {"p95_us", timings.at(0.95)}, {"calls", json["calls"]}};
  };
  return {{"robot", planner.robot().name},
          {"grasps", results.grasps},
          {"scenes", options.scenes},
          {"distance_map", row(results.map)},
          {"score_paper", row(results.score)},
          {"score_reach", row(results.reach)},
          {"inverse_kinematics", row(results.ik)},
          {"validation", row(results.validate)},
          {"plan_reach", row(results.plan)},
          {"planned", results.planned},
          {"mean_trajectory_s", results.planned > 0 ? results.trajectory / results.planned : 0},
          {"first_valid_paper", row(results.searchPaper)},
          {"first_valid_reach", row(results.searchReach)},
          {"first_valid_random", row(results.searchRandom)},
          {"random_over_paper", results.searchRandom.mean() / results.searchPaper.mean()},
          {"random_over_reach", results.searchRandom.mean() / results.searchReach.mean()}};
}

void print(const ordered_json& robot) {
  fmt::print("{}: {} grasps, {} scenes, {} planned, mean trajectory {:.2f} s\n", robot["robot"].get<std::string>(),
             robot["grasps"].get<int>(), robot["scenes"].get<int>(), robot["planned"].get<int>(),
             robot["mean_trajectory_s"].get<double>());
  for (const char* stage : {"distance_map", "score_paper", "score_reach", "inverse_kinematics", "validation",
                            "first_valid_paper", "first_valid_reach", "first_valid_random", "plan_reach"}) {
    fmt::print("  {:<20} median {:>10.4f} ms   95 % {:>10.4f} ms\n", stage,
               robot[stage]["median_us"].get<double>() / 1000, robot[stage]["p95_us"].get<double>() / 1000);
  }
  fmt::print(
      "  until a grasp works, random order takes {:.1f} times as long as paper's, {:.1f} times as long as reach's\n",
      robot["random_over_paper"].get<double>(), robot["random_over_reach"].get<double>());
}

int run(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word == "--json") {
      options.json = true;
    } else if (i + 1 < argc && word == "--database") {
      options.database = argv[++i];
    } else if (i + 1 < argc && word == "--object") {
      options.object = argv[++i];
    } else if (i + 1 < argc && word == "--scenes") {
      options.scenes = std::max(1, std::atoi(argv[++i]));
    } else {
      options.database.clear();
      break;
    }
  }
  if (options.database.empty()) {
    fmt::print(stderr, "usage: bench_plan --database DIR [--object NAME] [--scenes N] [--json]\n");
    return 2;
  }
  ordered_json report = {{"machine", bench::cpuModel()}, {"build", HANDHOLD_BUILD_TYPE}, {"object", options.object}};
  if (!options.json) fmt::print("{}, {} build, object {}\n", bench::cpuModel(), HANDHOLD_BUILD_TYPE, options.object);
  for (const char* robot : {"puma560", "hrp2", "panda"}) {
    report["robots"].push_back(measure(robot, options));
    if (!options.json) print(report["robots"].back());
  }
  if (options.json) fmt::print("{}\n", report.dump(1));
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) {
  try {
    return handhold::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
