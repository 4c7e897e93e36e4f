#pragma once

#include "build/robustness.h"
#include "hand/hand.h"
#include "mesh/object.h"
#include "quality/load_margin.h"
#include "simulate/grasp_policy.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace handhold {

/// One object of the catalog.
struct CatalogItem {
  std::string name;
  std::string mesh;  // path
  MeshUnit unit;
  double friction = 0.4;
  std::optional<double> mass;  // kg
  std::string where;           // FILE:LINE
};

/// Which implementation of the policy runs the trials.
enum class Simulation { fast, reference };

/// For which loads, and for how many grasps of a set, the load margin is computed.
struct LoadMarginSettings {
  int grasps = 200;                                       // the best by epsilon; 0: none
  int directions = 14;                                    // of the object's weight
  std::vector<Eigen::Matrix<double, 6, 1>> taskWrenches;  // beside them, as TaskWrenches has them
};

/// Under which noise, and for how many grasps of a set, the probability of force closure is estimated.
struct RobustnessSettings {
  int grasps = 200;  // the best by epsilon
  PoseNoise noise;   // without trials: none
};

/// What a job file says (contract in the README). Paths are made relative to the working folder.
struct Job {
  std::string path, text;
  std::vector<CatalogItem> catalog;  // by name
  std::vector<std::string> handPaths;
  std::vector<std::string> preshapes;  // empty: all
  PolicyKind policy = PolicyKind::surfaceNormal;
  Simulation simulation = Simulation::fast;
  std::size_t samples = 0;  // wanted N; 0 when the pitch is given
  double pitch = 0;         // m
  int rolls = 16;
  double friction = 0.4;
  int coneEdges = 8;
  double contactDistance = ReferenceSettings{}.contactDistance;  // m
  LoadMarginSettings loadMargin;
  RobustnessSettings robustness;
  int mapNeighbors = 8;
  std::size_t keepTop = 0;  // 0: all
  bool keepDiverse = false;
  std::uint64_t seed = 1;
  double timeout = 0;  // s of wall time for reading and sampling an object, and for each of its sets; 0: none
};

/// @throws InputError  FILE:LINE: KEY ..., for every unknown key, wrong value, repeated name or missing folder
Job loadJob(const std::string& path);

/// The same of a text; the paths in it are relative to `path`, of which only the name is used.
Job parseJob(const std::string& text, const std::string& path);

/// The settings in a job's text, as a set has it: everything but the catalog and the hands, whose files may be gone.
/// `name` begins messages. @throws InputError
Job parseJobSettings(const std::string& text, const std::string& name);

/// The settings of both policies with what the job says.
ReferenceSettings policySettings(const Job& job);

/// The weight in all directions, then the job's own wrenches.
TaskWrenches taskWrenches(const Job& job);

/// The hands of a job, by name, with the job's choice of preshapes. @throws InputError
std::vector<Hand> loadHands(const Job& job, const PackagePaths& packages = {});

}  // namespace handhold
