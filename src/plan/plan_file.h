#pragma once

#include "plan/trajectory.h"

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// What a plan was made from, written with it so that it can be shown later. Paths are absolute.
struct PlanSource {
  std::string robot, database;
  std::string scene;  // of a plan: the scene file; of a task: the task file
  std::string score = "paper";
  std::vector<std::string> calibrations;  // files; none: the quality is epsilon
  std::map<std::string, std::string> packages;
  std::uint64_t seed = 1;            // of a task
  std::optional<std::int64_t> draw;  // of a task: the random scene
};

/// A motion of one arm as a plan file has it.
struct FiledMotion {
  std::string arm, object;  // object: as the task calls it, of a plan the target
  std::string step;         // of a task: the verb
  std::vector<std::string> jointNames;
  Trajectory trajectory;
  std::optional<Eigen::Isometry3d> X_WO_after;  // of a task: the object when the motion has ended
};

/// A step of a task.
struct FiledStep {
  std::string step, object, arm;  // no arm: it was not done
  std::map<std::string, std::size_t> rejected;
};

/// What `plan --out` or `task --out` wrote.
struct PlanFile {
  bool isTask = false;
  std::string status, reason;  // reason: in words, when not planned
  std::optional<PlanSource> source;
  std::vector<FiledMotion> motions;  // in the order of time
  std::vector<FiledStep> steps;      // of a task
  std::string hand, arm;             // of a plan, as is all below
  int setVersion = 0;
  std::uint32_t grasp = 0;
  std::size_t rank = 0;
};

/// @throws InputError  `PATH: ...` no plan: the key, what was found, what was wanted
PlanFile readPlanFile(const std::filesystem::path& path);

}  // namespace handhold
