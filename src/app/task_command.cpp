#include "app/task_command.h"

#include "app/program.h"
#include "core/error.h"
#include "core/file.h"
#include "core/job_system.h"
#include "core/log.h"
#include "plan/task_trials.h"

#include <algorithm>

#include <fmt/format.h>

namespace handhold {
namespace {

std::string stepName(const Task& task, std::size_t i) {
  return fmt::format("{} {}", kVerbNames[static_cast<std::size_t>(task.steps[i].verb)],
                     task.objects[task.steps[i].object].name);
}

/// A line a step.
std::string summary(const Task& task, const Robot& robot, const TaskResult& result) {
  std::string text =
      result.done ? fmt::format("planned by {}: {} steps\n", robot.name, result.steps.size())
                  : fmt::format("{} by {}: {}\n", result.feasible ? "failed" : "infeasible", robot.name, result.reason);
  for (std::size_t i = 0; i < result.steps.size(); ++i) {
    const TaskStepResult& step = result.steps[i];
    text += fmt::format("  {:<24}", stepName(task, i));
    if (result.done) {
      text += fmt::format(" {:>6.2f} s  {}, grasp {}", step.seconds(), armText(robot.arms[step.arm].name), step.grasp);
    }
    if (!step.rejected.empty()) text += fmt::format("  rejected: {}", counted(step.rejected));
    text += "\n";
  }
  return text;
}

int runTrials(const TaskCommand& command, const Robot& robot, const PlannerOptions& planning, const Task& task) {
  const int threads = JobSystem(command.threads).threads();
  const std::vector<TaskTrial> trials = runTaskTrials([&] { return Planner(command.database, robot, planning); },
                                                      command.options, task, command.trials, threads);
  std::map<std::string, std::size_t> reasons;
  std::vector<std::map<std::string, std::size_t>> rejected(task.steps.size());
  std::size_t feasible = 0, done = 0;
  double seconds = 0, slowest = 0, duration = 0;
  for (const TaskTrial& trial : trials) {
    seconds += trial.seconds;
    slowest = std::max(slowest, trial.seconds);
    feasible += trial.result.feasible ? 1 : 0;
    done += trial.result.done ? 1 : 0;
    if (trial.result.done) {
      duration += trial.duration;
      continue;
    }
    ++reasons[(trial.result.feasible ? "failed: " : "infeasible: ") + trial.result.reason];
    for (std::size_t i = 0; i < task.steps.size(); ++i) {
      for (const auto& [reason, count] : trial.result.steps[i].rejected) rejected[i][reason] += count;
    }
  }
  if (!command.output.empty()) replaceContent(command.output, trialsJson(task, trials, command.options.seed) + "\n");
  fmt::print("{} by {}: {} scenes drawn, {} feasible, {} planned ({:.0f} %)\n", command.task, robot.name, trials.size(),
             feasible, done, feasible > 0 ? 100.0 * static_cast<double>(done) / static_cast<double>(feasible) : 0.0);
  for (const auto& [reason, count] : reasons) fmt::print("  {:>4} {}\n", count, reason);
  if (trials.size() > done) fmt::print("rejected in the scenes that were not planned:\n");
  for (std::size_t i = 0; i < task.steps.size() && trials.size() > done; ++i) {
    fmt::print("  {:<24} {}\n", stepName(task, i), counted(rejected[i]));
  }
  if (done > 0) fmt::print("motion: {:.1f} s a scene\n", duration / static_cast<double>(done));
  if (!trials.empty()) {
    fmt::print("time: {:.1f} s a scene, at most {:.1f} s, {} threads\n", seconds / static_cast<double>(trials.size()),
               slowest, threads);
  }
  return feasible == static_cast<std::size_t>(command.trials) && done == feasible ? kExitDone : kExitItemFailed;
}

}  // namespace

int runTask(const TaskCommand& command) {
  const Robot robot = loadRobot(command.robot, command.packages);
  const PlannerOptions planning = withCalibrations(command.source.calibrations);
  Planner planner(command.database, robot, planning);
  const ObjectMeshes meshes = [&](const std::string& object) { return planner.objectMesh(object); };
  Task task = loadTask(command.task, robot, meshes);
  for (const std::string& note : task.surroundings.notes) logInfo(fmt::format("{}: {}", command.task, note));
  try {
    if (command.trials > 0) return runTrials(command, robot, planning, task);
    if (command.draw >= 0) task = drawTask(task, meshes, command.options.seed, command.draw);
    const TaskResult result = TaskPlanner(planner, command.options).plan(task);
    PlanSource source = command.source;
    source.seed = command.options.seed;
    if (command.draw >= 0) source.draw = command.draw;
    if (!command.output.empty()) replaceContent(command.output, taskJson(task, robot, result, true, &source) + "\n");
    fmt::print("{}", summary(task, robot, result));
    return result.done ? kExitDone : kExitItemFailed;
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", command.task, error.what()));
  }
}

}  // namespace handhold
