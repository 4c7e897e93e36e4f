#pragma once

#include "hand/mechanism.h"
#include "plan/task_planner.h"

#include <string>

namespace handhold {

struct TaskCommand {
  std::string robot, database, task, output;
  PackagePaths packages;
  TaskOptions options;
  PlanSource source;  // written with the plan
  int trials = 0;     // > 0: so many feasible random scenes
  int draw = -1;      // >= 0: that random scene instead of the file's
  int threads = 0;
};

int runTask(const TaskCommand& command);

}  // namespace handhold
