#pragma once

#include "plan/planner.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace handhold {

/// The experiment of Berenson et al. 2007, IV-A: how many grasps must be tested in a random scene before one works, in
/// the order of a score against random order.
struct ExperimentOptions {
  int scenes = 50;
  std::uint64_t seed = 1;
  int shuffles = 10;  // of the naive order, a scene
  int fewestObstacles = 5, mostObstacles = 6;
  double circle = 0.2;         // m, radius on which the obstacles' centres lie
  double minReachable = 0.03;  // share of the stored grasps with inverse kinematics: "a region known to be reachable"
};

/// The orders that are compared: both scores, and the paper's without each of its terms and with each alone.
inline constexpr std::array<std::string_view, 8> kOrderNames = {"paper",   "reach",      "only_gq",    "only_gb",
                                                                "only_ge", "without_gq", "without_gb", "without_ge"};

/// One scene of a cell.
struct SceneTrial {
  std::string name, yaml;                    // the scene file
  std::size_t grasps = 0, valid = 0;         // stored, working here; no valid one: the scene is infeasible
  double naive = 0;                          // mean tests in random order, until the first valid one
  std::map<std::string, std::size_t> tests;  // by order; tests until the first valid grasp
  std::vector<GraspScore> paper;             // the terms, for sweeps; by grasp
  std::vector<bool> works;                   // by the same index
};

/// One robot and object.
struct ExperimentCell {
  std::string robot, object;
  std::vector<SceneTrial> scenes;
};

/// What one order did in a cell, over its feasible scenes.
struct OrderSummary {
  std::size_t scenes = 0, feasible = 0;
  double meanRatio = 0, ratioLow = 0, ratioHigh = 0;  // mean of naive / tests, 95 % by bootstrap over scenes
  double ratioOfMeans = 0;
  double shareWon = 0;      // tests < naive; ties are not won
  double shareWonHard = 0;  // of the scenes whose naive mean is above 2
  std::size_t hard = 0;
  double meanTested = 0, medianTested = 0, naiveMeanTested = 0;
};

/// Runs one cell. Scene i is drawn from a stream keyed by seed, robot, object and i: the others do not matter to it.
/// @param makePlanner  one planner a thread
/// @param threads  0: one for each core
/// @param externalOrder  grasps of a scene in an order from outside, by the scene's name; none: empty
/// @throws InputError  the robot has no workspace, or no scene could be drawn
ExperimentCell runExperiment(const std::function<Planner()>& makePlanner, const std::string& object,
                             const ExperimentOptions& options, int threads,
                             const std::map<std::string, std::vector<std::uint32_t>>& externalOrder = {});

/// Puts the planner in front of scene `index` of a cell, and returns its file.
std::string takeRandomScene(Planner& planner, const std::string& object, int index, const ExperimentOptions& options);

OrderSummary summarise(const ExperimentCell& cell, const std::string& order, std::uint64_t seed);

/// Tests until the first valid grasp of a scene when the paper's score has other coefficients.
std::size_t testsWith(const SceneTrial& trial, double c1, double c2, double c3);

/// The reports as JSON: cells (`bench --format json`), and by order; a sweep of the coefficients.
std::string cellsJson(const std::vector<ExperimentCell>& cells, std::uint64_t seed);
std::string ablationJson(const std::vector<ExperimentCell>& cells, std::uint64_t seed);
std::string sweepJson(const std::vector<ExperimentCell>& cells);
std::string scenesJson(const std::vector<ExperimentCell>& cells);

}  // namespace handhold
