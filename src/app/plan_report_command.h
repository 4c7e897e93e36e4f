#pragma once

#include "hand/mechanism.h"

#include <string>

namespace handhold {

struct PlanReportCommand {
  std::string plan, output;
  std::string robot, scene, database;  // in the place of what the plan names; empty: that
  PackagePaths packages;
};

/// `handhold-plan report`: a plan or task and what it was made from as one HTML file.
int runPlanReport(const PlanReportCommand& command);

}  // namespace handhold
