#pragma once

#include "plan/experiment.h"

#include <string>
#include <vector>

namespace handhold {

struct ExperimentCommand {
  std::vector<std::string> robots;
  std::string objectGlob = "*", database, format = "table", output, order;
  PackagePaths packages;
  ExperimentOptions options;
  int threads = 0;  // 0: one a core
};

int runExperimentCommand(const ExperimentCommand& command);

}  // namespace handhold
