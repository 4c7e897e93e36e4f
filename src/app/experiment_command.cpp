#include "app/experiment_command.h"

#include "app/program.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "store/database.h"
#include "view/box_plot.h"

#include <filesystem>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// Objects that have a set with one of the robot's hands.
std::set<std::string> objectsOf(const Robot& robot, const ExperimentCommand& command) {
  std::set<std::string> objects;
  for (const SetFile& set : Database(command.database).sets(command.objectGlob)) {
    for (const Arm& arm : robot.arms) {
      if (arm.hand.name == set.hand) objects.insert(set.object);
    }
  }
  if (objects.empty()) {
    throw InputError(fmt::format("{} has no set that matches --object {} with a hand of {}, want one: handhold build",
                                 command.database, command.objectGlob, robot.name));
  }
  return objects;
}

/// {"SCENE": [grasp, ...]}
std::map<std::string, std::vector<std::uint32_t>> readOrder(const std::string& path) {
  std::map<std::string, std::vector<std::uint32_t>> order;
  if (path.empty()) return order;
  const auto json = nlohmann::json::parse(readFile(path), nullptr, false);
  if (!json.is_object()) throw InputError(fmt::format("{}: is no JSON object, want {{\"SCENE\": [GRASP, ...]}}", path));
  for (const auto& [scene, grasps] : json.items()) {
    for (const auto& grasp : grasps) {
      if (!grasp.is_number_unsigned()) {
        throw InputError(fmt::format("{}: {} has {}, want rows of the set", path, scene, grasp.dump()));
      }
      order[scene].push_back(grasp.get<std::uint32_t>());
    }
  }
  return order;
}

std::string table(const std::vector<ExperimentCell>& cells, std::uint64_t seed) {
  std::string text =
      fmt::format("{:<10} {:<20} {:<8} {:>8} {:>7} {:>17} {:>8} {:>6} {:>6} {:>8} {:>7} {:>8}\n", "robot", "object",
                  "order", "feasible", "ratio", "95 %", "of means", "won %", "hard %", "tested", "median", "naive");
  for (const ExperimentCell& cell : cells) {
    for (const char* order : {"paper", "reach", "external"}) {
      if (cell.scenes.empty() || (std::string_view(order) == "external" &&
                                  std::none_of(cell.scenes.begin(), cell.scenes.end(), [](const SceneTrial& trial) {
                                    return trial.tests.contains("external");
                                  }))) {
        continue;
      }
      const OrderSummary s = summarise(cell, order, seed);
      text += fmt::format(
          "{:<10} {:<20} {:<8} {:>8} {:>7.2f} {:>17} {:>8.2f} {:>6.0f} {:>6.0f} {:>8.2f} {:>7.1f} {:>8.2f}\n",
          cell.robot, cell.object, order, fmt::format("{}/{}", s.feasible, s.scenes), s.meanRatio,
          fmt::format("{:.2f} .. {:.2f}", s.ratioLow, s.ratioHigh), s.ratioOfMeans, 100 * s.shareWon,
          100 * s.shareWonHard, s.meanTested, s.medianTested, s.naiveMeanTested);
    }
  }
  return text +
         "  ratio     mean over feasible scenes of naive tests / tests in this order; of means: ratio of the means\n"
         "  won       scenes with fewer tests than the naive mean; hard: of those whose naive mean is above 2\n"
         "  tested    mean tests until the first grasp that works; naive: in random order, mean of the shuffles\n";
}

std::vector<BoxPlotGroup> groupsOf(const std::vector<ExperimentCell>& cells) {
  std::vector<BoxPlotGroup> groups;
  for (const ExperimentCell& cell : cells) {
    BoxPlotGroup group{fmt::format("{}, {}", cell.robot, cell.object),
                       {{"random order", {}}, {"paper", {}}, {"reach", {}}}};
    for (const SceneTrial& trial : cell.scenes) {
      if (trial.valid == 0) continue;
      group.series[0].values.push_back(trial.naive);
      group.series[1].values.push_back(static_cast<double>(trial.tests.at("paper")));
      group.series[2].values.push_back(static_cast<double>(trial.tests.at("reach")));
    }
    groups.push_back(std::move(group));
  }
  return groups;
}

void writeReports(const std::vector<ExperimentCell>& cells, const ExperimentCommand& command) {
  const fs::path folder = command.output;
  fs::create_directories(folder / "scenes");
  for (const ExperimentCell& cell : cells) {
    for (const SceneTrial& trial : cell.scenes) replaceContent(folder / "scenes" / (trial.name + ".yaml"), trial.yaml);
  }
  const std::uint64_t seed = command.options.seed;
  replaceContent(folder / "cells.json", cellsJson(cells, seed) + "\n");
  replaceContent(folder / "ablation.json", ablationJson(cells, seed) + "\n");
  replaceContent(folder / "sweep.json", sweepJson(cells) + "\n");
  replaceContent(folder / "scenes.json", scenesJson(cells) + "\n");
  replaceContent(
      folder / "tests.svg",
      boxPlotSvg("Grasps tested until one works",
                 fmt::format("grasps tested in a scene ({} scenes a cell)", command.options.scenes), groupsOf(cells)));
}

}  // namespace

int runExperimentCommand(const ExperimentCommand& command) {
  const auto order = readOrder(command.order);
  std::vector<ExperimentCell> cells;
  std::size_t infeasible = 0;
  for (const std::string& path : command.robots) {
    const Robot robot = loadRobot(path, command.packages);
    for (const std::string& object : objectsOf(robot, command)) {
      cells.push_back(runExperiment([&] { return Planner(command.database, robot); }, object, command.options,
                                    command.threads, order));
      const OrderSummary s = summarise(cells.back(), "paper", command.options.seed);
      infeasible += s.scenes - s.feasible;
      logInfo(fmt::format("{}, {}: {} of {} scenes have a grasp that works; ratio {:.2f}", robot.name, object,
                          s.feasible, s.scenes, s.meanRatio));
    }
  }
  if (!command.output.empty()) writeReports(cells, command);
  if (command.format == "json") {
    fmt::print("{}\n", cellsJson(cells, command.options.seed));
  } else {
    fmt::print("{}", table(cells, command.options.seed));
  }
  if (infeasible > 0) logInfo(fmt::format("{} scenes have no grasp that works; they are counted apart", infeasible));
  return kExitDone;
}

}  // namespace handhold
