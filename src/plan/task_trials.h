#pragma once

#include "plan/task_planner.h"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace handhold {

/// A random scene of a task: its objects in the regions of `trials`, blocks (4 to 10 cm wide, 8 to 25 cm tall) about
/// them that leave objects, obstacles and regions of places free. Scene i is drawn from a stream keyed by seed and i.
/// @throws InputError  the task file has no trials, or no scene could be drawn
Task drawTask(const Task& task, const ObjectMeshes& objectMeshes, std::uint64_t seed, int index);

struct TaskTrial {
  int index = 0;
  TaskResult result;    // without motions
  double duration = 0;  // s, of all motions
  double seconds = 0;   // of planning
};

/// Draws and plans scenes until `feasible` of them are feasible, in the order of their index, at most ten times as
/// many. One planner a thread; any number of threads (0: one for each core) gives the same trials.
std::vector<TaskTrial> runTaskTrials(const std::function<Planner()>& makePlanner, const TaskOptions& options,
                                     const Task& task, int feasible, int threads);

/// `task --trials --out`
std::string trialsJson(const Task& task, const std::vector<TaskTrial>& trials, std::uint64_t seed);

}  // namespace handhold
