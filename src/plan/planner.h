#pragma once

#include "plan/plan_file.h"
#include "plan/trajectory.h"
#include "plan/validate.h"
#include "rank/score.h"
#include "robot/robot.h"
#include "scene/scene.h"

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

enum class ScoreKind { paper, reach };
inline constexpr std::array<std::string_view, 2> kScoreNames = {"paper", "reach"};
/// None: the name is no score's.
std::optional<ScoreKind> scoreOf(std::string_view name);

struct PlannerOptions {
  ValidationSettings validation = {};
  std::uint64_t seed = 1;
  int maxChecksPerMotion = 60'000;  // postures asked for while one motion is searched
  int maxMotions = 20;              // valid grasps to which no motion was found, before giving up
  /// When there are any, Gq is the probability that a grasp holds, and every hand needs one.
  std::vector<HoldCalibration> calibrations = {};
};

/// With the calibrations in these files. @throws InputError  as readCalibration; two are for one hand
PlannerOptions withCalibrations(const std::vector<std::string>& paths);

/// A grasp in its place in the ranking.
struct RankedGrasp {
  GraspScore score;
  std::array<std::uint32_t, 3> trial;
  Eigen::Isometry3d X_WH;  // hand root in the world
};

struct Ranking {
  std::vector<RankedGrasp> grasps;         // best first
  std::map<std::string, double> timingMs;  // distance_map, score
};

/// What to do for one plan.
struct PlanRequest {
  ScoreKind score = ScoreKind::paper;
  bool trace = false;                        // list every rejected grasp
  std::optional<std::uint32_t> prefer = {};  // row of the set: goes first unless another scores 10 % more
  /// Asked between checks with their number so far; true ends the search. None: never.
  std::function<bool(std::uint64_t checks)> stop = {};
};

struct PlanResult {
  bool planned = false;
  std::string reason;  // in words, when not planned
  std::string object, hand, arm;
  int setVersion = 0;
  std::size_t rank = 0;    // of the grasp, from 1
  std::size_t tested = 0;  // grasps validated
  RankedGrasp grasp;
  std::map<std::string, std::size_t> rejected;  // by kRejectionNames
  struct Traced {
    std::size_t rank = 0;
    RankedGrasp grasp;
    std::string reason, detail;
  };
  std::vector<Traced> trace;
  std::vector<std::string> jointNames;
  Trajectory trajectory;
  double clearance = 0;      // m, kept in transit: robot.yaml's, or 0 where the robot starts closer to something
  std::uint64_t checks = 0;  // postures asked
  bool stopped = false;      // by PlanRequest::stop
  std::map<std::string, double> timingMs;
};

/// Ranks and plans grasps of one robot with the sets of one database, in a scene that may change between two questions.
/// Keeps sets, trees and maps in memory. Equal databases, robots, scenes and requests give equal answers, `timingMs`
/// and deadlines aside.
/// @note Not thread safe: one planner a thread.
class Planner {
 public:
  /// @throws InputError  no such database
  Planner(std::string databaseFolder, Robot robot, PlannerOptions options = {});
  ~Planner();
  Planner(Planner&&) noexcept;
  Planner& operator=(Planner&&) noexcept;

  const Robot& robot() const;
  const Scene& scene() const;

  /// Takes over a scene. The former one stays when this one is refused.
  /// @throws InputError  no set of the target with any of the arms' hands, an unknown arm, an unknown joint or one
  /// outside its limits; a hand without calibration, or one of another kind than its set, where there are calibrations
  void setScene(Scene scene);
  /// Reads a scene file (scene/scene.h) and takes it over.
  void loadScene(const std::string& path);

  /// @throws InputError  no scene was given
  Ranking rank(ScoreKind kind);
  /// @throws InputError  no scene was given, or it says nothing of the joints
  PlanResult plan(const PlanRequest& request);

  /// What the paper calls a test, of one grasp: policy in the scene, inverse kinematics, arm. None: it works.
  std::optional<Rejection> test(const GraspScore& grasp);

  /// Share of the stored grasps of all arms with inverse kinematics at the grasp, whatever stands in the way.
  double reachableShare();

  /// (J) Where the robot of the scene stands; home where the scene says nothing. @throws InputError  no scene was given
  const Eigen::VectorXd& posture() const;

  /// The newest set of an object with the hand of an arm, as rank() uses it; null when there is none.
  std::shared_ptr<const GraspTable> graspTable(const std::string& object, int arm);

  /// The mesh of a stored object: of the newest set that has it. @throws InputError  there is none
  TriangleMesh objectMesh(const std::string& object);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// `rank --format json` and `plan.json` (docs/online.md). @param top  0: all  @param source  written too, if not null
std::string rankingJson(const Planner& planner, const Ranking& ranking, std::size_t top);
std::string planJson(const PlanResult& result, bool pretty, const PlanSource* source = nullptr);

}  // namespace handhold
