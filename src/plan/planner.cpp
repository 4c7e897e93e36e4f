#include "plan/planner.h"

#include "core/error.h"
#include "plan/check_plan.h"
#include "rank/reach.h"
#include "robot/inverse_kinematics.h"
#include "scene/distance_map.h"
#include "store/database.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kClearlyBetter = 1.1;  // a score that much higher replaces the preferred grasp
constexpr double kLimitSlack = 1e-6;    // decimals in a file may overstep a limit by their rounding

/// Adds the milliseconds of a scope to a map.
class Stopwatch {
 public:
  Stopwatch(std::map<std::string, double>& into, std::string stage) : into_(into), stage_(std::move(stage)) {}
  ~Stopwatch() {
    into_[stage_] += std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
  }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  std::map<std::string, double>& into_;
  std::string stage_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// What stays of an arm whatever the scene.
struct ArmTools {
  ArmChain chain;
  std::unique_ptr<InverseKinematics> ik;
  std::unique_ptr<ReachScorer> reach;  // made when asked for
};

/// An arm that may grasp the target of the present scene.
struct Candidate {
  int arm = 0;
  std::shared_ptr<const GraspTable> table;
  ArmSituation situation;
};

}  // namespace

struct Planner::Impl {
  Impl(std::string folder, Robot r, PlannerOptions o)
      : database(std::move(folder)), robot(std::move(r)), options(std::move(o)) {
    for (int arm = 0; arm < static_cast<int>(robot.arms.size()); ++arm) {
      ArmTools& tools = arms.emplace_back();
      tools.chain = makeChain(robot, arm);
      tools.ik = makeInverseKinematics(tools.chain);
    }
  }

  Database database;
  Robot robot;
  PlannerOptions options;
  std::vector<ArmTools> arms;
  std::map<std::pair<std::string, std::string>, std::shared_ptr<const GraspTable>> tables;  // by object and hand
  std::map<std::pair<const GraspTable*, int>, std::vector<bool>> waysIn;                    // by table and arm
  std::map<std::string, TriangleMesh> objectMeshes;
  std::map<const ObstacleShape*, std::pair<std::shared_ptr<const ObstacleShape>, std::shared_ptr<const SignedDistance>>>
      distances;

  std::optional<Scene> scene;
  std::vector<Candidate> candidates;  // of the scene
  SceneRays rays;
  bool raysAreCurrent = false;
  std::unique_ptr<CollisionWorld> world;
  bool worldIsCurrent = false;
  std::vector<std::unique_ptr<GraspValidator>> validators;  // by arm

  /// Null where epsilon is the quality.
  const HoldCalibration* calibrationOf(const Hand& hand) const {
    const auto& all = options.calibrations;
    const auto at = std::find_if(all.begin(), all.end(), [&](const auto& each) { return each.hand == hand.name; });
    if (at != all.end()) return &*at;
    if (all.empty()) return nullptr;
    throw InputError(fmt::format("{}: is for the hand {}, want a calibration for {} too", all.front().path,
                                 all.front().hand, hand.name));
  }

  /// The newest set of (object, hand); null when there is none.
  std::shared_ptr<const GraspTable> table(const std::string& object, const Hand& hand) {
    const auto key = std::pair(object, hand.name);
    if (const auto known = tables.find(key); known != tables.end()) return known->second;
    const int version = database.newestVersion(object, hand.name);
    if (version == 0) return nullptr;
    const auto path = database.setPath(object, hand.name, version);
    return tables[key] = std::make_shared<const GraspTable>(
               makeGraspTable(readGraspSet(path), path.string(), hand, calibrationOf(hand)));
  }

  VectorXd posture(const Scene& s) const {
    VectorXd q = robot.home;
    if (!s.joints) return q;
    const auto& joints = robot.body.joints;
    for (const auto& [name, value] : *s.joints) {
      const auto isNamed = [&wanted = name](const Joint& joint) { return joint.name == wanted; };
      const auto at = std::find_if(joints.begin(), joints.end(), isNamed);
      if (at == joints.end()) {
        std::vector<std::string> names;
        for (const Joint& joint : joints) {
          if (joint.mimicOf < 0) names.push_back(joint.name);
        }
        throw InputError(fmt::format("robot.joints.{} is no joint of the robot {}, want one of: {}", name, robot.name,
                                     fmt::join(names, ", ")));
      }
      if (at->mimicOf >= 0) {
        throw InputError(fmt::format("robot.joints.{} is a mimic joint, want the joint that it follows: {}", name,
                                     joints[at->mimicOf].name));
      }
      if (!(value >= at->lower - kLimitSlack && value <= at->upper + kLimitSlack)) {
        throw InputError(
            fmt::format("robot.joints.{} is {}, want it within {} .. {}", name, value, at->lower, at->upper));
      }
      q[at - joints.begin()] = std::clamp(value, at->lower, at->upper);
    }
    return followMimics(robot.body, q);
  }

  std::vector<Candidate> makeCandidates(const Scene& s) {
    if (!s.arm.empty() && findArm(robot, s.arm) < 0) {
      std::vector<std::string> names;
      for (const Arm& arm : robot.arms) names.push_back(arm.name);
      throw InputError(fmt::format("robot.arm is \"{}\", want an arm of the robot {}: {}", s.arm, robot.name,
                                   fmt::join(names, ", ")));
    }
    const VectorXd q = posture(s);
    const std::vector<Isometry3d> X_BL = forwardKinematics(robot.body, q);
    std::vector<Candidate> result;
    std::set<std::string> hands;
    for (int arm = 0; arm < static_cast<int>(robot.arms.size()); ++arm) {
      const Arm& description = robot.arms[arm];
      if (!s.arm.empty() && description.name != s.arm) continue;
      hands.insert(description.hand.name);
      auto grasps = table(s.target, description.hand);
      if (!grasps) continue;
      result.push_back({arm, std::move(grasps), {s.X_WB, s.X_WB * X_BL[description.baseLink], q, s.X_WO}});
    }
    if (result.empty()) {
      throw InputError(fmt::format("target.object: {} has no set of {} with the hand {}, want one: handhold build",
                                   database.folder().string(), s.target, fmt::join(hands, " or ")));
    }
    return result;
  }

  const Scene& requireScene() const {
    if (!scene) throw InputError("no scene was given, want one first");
    return *scene;
  }

  void updateRays() {
    if (!raysAreCurrent) rays.update(scene->obstacles);
    raysAreCurrent = true;
  }

  void updateWorld() {
    if (!world) {
      world = std::make_unique<CollisionWorld>(robot);
      for (int arm = 0; arm < static_cast<int>(robot.arms.size()); ++arm) {
        validators.push_back(
            std::make_unique<GraspValidator>(robot, arm, *world, *arms[arm].ik, arms[arm].chain, options.validation));
      }
    }
    if (worldIsCurrent) return;
    world->setObstacles(scene->obstacles);
    const GraspTable& target = *candidates.front().table;
    world->setTarget(target.objectMesh, target.watertight, target.object);
    worldIsCurrent = true;
  }

  std::vector<ObstacleDistance> obstacleDistances() {
    decltype(distances) kept;
    std::vector<ObstacleDistance> result;
    for (const Obstacle& obstacle : scene->obstacles) {
      auto& entry = kept[obstacle.shape.get()];
      if (!entry.second) {
        const auto known = distances.find(obstacle.shape.get());
        entry =
            known != distances.end()
                ? known->second
                : std::pair(obstacle.shape,
                            std::shared_ptr<const SignedDistance>(std::make_shared<SignedDistance>(obstacle.shape)));
      }
      result.push_back({entry.second, obstacle.X_WS});
    }
    distances = std::move(kept);
    return result;
  }

  /// By grasp: the hand comes in without meeting the target. Found once: no scene changes it.
  const std::vector<bool>& wayIn(const Candidate& candidate) {
    std::vector<bool>& free = waysIn[{candidate.table.get(), candidate.arm}];
    if (!free.empty()) return free;
    updateWorld();
    for (const StoredGrasp& grasp : candidate.table->grasps)
      free.push_back(validators[candidate.arm]->wayIsFree(grasp));
    return free;
  }

  Vector3d shoulder(const Candidate& candidate) const {
    return candidate.situation.X_WA * shoulderPoint(arms[candidate.arm].chain);
  }

  void scorePaperAll(Ranking& ranking, std::vector<GraspScore>& scores) {
    std::map<const GraspTable*, std::vector<float>> maps;  // two arms with one hand share a map
    {
      const Stopwatch watch(ranking.timingMs, "distance_map");
      updateRays();
      const DistanceMap map({.far = robot.score.far});
      for (const Candidate& candidate : candidates) {
        std::vector<float>& D = maps[candidate.table.get()];
        if (D.empty()) map.compute(rays, candidate.table->mapPoint, candidate.table->mapNormal, scene->X_WO, D);
      }
    }
    const Stopwatch watch(ranking.timingMs, "score");
    for (const Candidate& candidate : candidates) {
      scorePaper(*candidate.table, candidate.arm, scene->X_WO, shoulder(candidate), maps[candidate.table.get()],
                 robot.score, scores);
    }
    sortScores(scores);
  }

  void scoreReachAll(Ranking& ranking, std::vector<GraspScore>& scores) {
    std::vector<ObstacleDistance> obstacles;
    {
      const Stopwatch watch(ranking.timingMs, "distances");
      obstacles = obstacleDistances();
      ReachSettings settings;
      settings.pregrasp = options.validation.pregrasp;
      for (const Candidate& candidate : candidates) {
        auto& reach = arms[candidate.arm].reach;
        if (!reach) reach = std::make_unique<ReachScorer>(robot, candidate.arm, settings);
        wayIn(candidate);
      }
    }
    const Stopwatch watch(ranking.timingMs, "score");
    for (const Candidate& candidate : candidates) {
      const ArmTools& tools = arms[candidate.arm];
      const ArmSituation& situation = candidate.situation;
      tools.reach->score(*candidate.table, wayIn(candidate),
                         {situation.X_WB, situation.X_WA, tools.ik.get(), situation.posture}, scene->X_WO, obstacles,
                         scores);
    }
    sortScores(scores);
  }

  const Candidate& candidateOf(const GraspScore& score) const {
    return *std::find_if(candidates.begin(), candidates.end(),
                         [&](const Candidate& candidate) { return candidate.arm == score.arm; });
  }

  RankedGrasp ranked(const GraspScore& score) const {
    const StoredGrasp& grasp = candidateOf(score).table->grasps[score.grasp];
    return {score, grasp.trial, scene->X_WO * grasp.X_OH};
  }

  /// The preferred grasp goes first unless another is clearly better.
  static void prefer(std::uint32_t grasp, std::vector<RankedGrasp>& grasps) {
    const auto at = std::find_if(grasps.begin(), grasps.end(),
                                 [&](const RankedGrasp& candidate) { return candidate.score.grasp == grasp; });
    if (at == grasps.end() || grasps.front().score.score > kClearlyBetter * at->score.score) return;
    std::rotate(grasps.begin(), at, at + 1);
  }

  /// From the present posture to the pre-grasp, in active joints.
  std::optional<JointPath> transit(const Candidate& candidate, const VectorXd& goal, const PlanRequest& request,
                                   PlanResult& result) {
    const GraspValidator& validator = *validators[candidate.arm];
    const ActiveJoints& active = validator.active();
    const ArmSituation& situation = candidate.situation;
    const VectorXd start = active.pick(situation.posture);
    MotionSpace space{active.lower(), active.upper(), validator.reach(), {}};
    space.isFree = [&](const VectorXd& q) {
      return !world->robotTouches(candidate.arm, validator.linkPoses(q, situation), situation.X_WO, TargetRule::avoid,
                                  result.clearance);
    };
    MotionSettings settings;
    settings.seed = options.seed;
    settings.maxChecks = options.maxChecksPerMotion;
    settings.fineStep = std::max(2 * result.clearance, 0.002);
    if (request.stop) settings.stop = [&] { return request.stop(world->checks() - checksBefore); };
    return planMotion(space, start, goal, settings);
  }

  JointLimits limits(const ActiveJoints& active) const {
    return {active.pick(robot.maxVelocity), active.pick(robot.maxAcceleration)};
  }

  Trajectory timed(const JointPath& transit, const GraspMotion& motion, const ActiveJoints& active) const {
    Trajectory trajectory;
    const JointLimits l = limits(active);
    appendSegment("transit", transit, true, l, trajectory);
    appendSegment("approach", motion.approach, false, l, trajectory);
    appendSegment("close", motion.close, true, l, trajectory);
    if (motion.lift.size() > 1) appendSegment("lift", motion.lift, false, l, trajectory);
    return trajectory;
  }

  std::optional<std::string> recheck(const Candidate& candidate, const StoredGrasp& grasp, const Trajectory& trajectory,
                                     const ActiveJoints& active) const {
    CheckedMotion motion;
    motion.robot = &robot;
    motion.arm = candidate.arm;
    motion.trajectory = &trajectory;
    motion.joints = active.joints();
    motion.posture = candidate.situation.posture;
    motion.X_WB = scene->X_WB;
    motion.obstacles = &scene->obstacles;
    motion.target = &candidate.table->objectMesh;
    motion.targetWatertight = candidate.table->watertight;
    motion.X_WO = scene->X_WO;
    motion.X_OH = grasp.X_OH;
    motion.finalPosition = grasp.finalPosition;
    return findFault(motion);
  }

  /// The whole way of one grasp; the reason and its detail when there is none.
  std::optional<Rejection> planOne(const RankedGrasp& ranked, const PlanRequest& request, PlanResult& result,
                                   std::string& detail) {
    const Candidate& candidate = candidateOf(ranked.score);
    const GraspValidator& validator = *validators[candidate.arm];
    const StoredGrasp& grasp = candidate.table->grasps[ranked.score.grasp];
    Validation validation;
    {
      const Stopwatch watch(result.timingMs, "validate");
      validation = validator.validate(grasp, candidate.situation);
    }
    detail = validation.detail;
    if (!validation.motion) return validation.reason;
    std::optional<JointPath> path;
    {
      const Stopwatch watch(result.timingMs, "motion");
      path = transit(candidate, validation.motion->approach.front(), request, result);
    }
    if (!path) {
      detail = "no motion to the pre-grasp was found";
      return Rejection::noMotion;
    }
    {
      const Stopwatch watch(result.timingMs, "trajectory");
      result.trajectory = timed(*path, *validation.motion, validator.active());
    }
    const Stopwatch watch(result.timingMs, "recheck");
    if (const auto fault = recheck(candidate, grasp, result.trajectory, validator.active())) {
      result.trajectory = {};
      detail = *fault;
      return Rejection::recheckFailed;
    }
    result.jointNames = validator.active().names();
    return std::nullopt;
  }

  /// Where an arm stands now: in collision nothing can be planned, nearer than the clearance it is given up.
  struct Start {
    std::optional<std::string> fault;
    double clearance = 0;
  };
  Start judgeStart(const Candidate& candidate) const {
    const GraspValidator& validator = *validators[candidate.arm];
    const auto X_WL = validator.linkPoses(validator.active().pick(candidate.situation.posture), candidate.situation);
    const auto touch = [&](double margin) {
      return world->robotTouches(candidate.arm, X_WL, scene->X_WO, TargetRule::avoid, margin);
    };
    if (const auto met = touch(0)) {
      return {fmt::format("where the robot stands, {} meets {}", met->first, met->second), 0};
    }
    return {std::nullopt, touch(robot.clearance) ? 0 : robot.clearance};
  }

  std::uint64_t checksBefore = 0;
};

std::optional<ScoreKind> scoreOf(std::string_view name) {
  const auto at = std::find(kScoreNames.begin(), kScoreNames.end(), name);
  return at == kScoreNames.end() ? std::nullopt : std::optional(static_cast<ScoreKind>(at - kScoreNames.begin()));
}

PlannerOptions withCalibrations(const std::vector<std::string>& paths) {
  PlannerOptions options;
  for (const std::string& path : paths) {
    HoldCalibration calibration = readCalibration(path);
    for (const HoldCalibration& other : options.calibrations) {
      if (other.hand != calibration.hand) continue;
      throw InputError(fmt::format("{}: is for the hand {}, as {} is, want one", path, calibration.hand, other.path));
    }
    options.calibrations.push_back(std::move(calibration));
  }
  return options;
}

Planner::Planner(std::string databaseFolder, Robot robot, PlannerOptions options)
    : impl_(new Impl(std::move(databaseFolder), std::move(robot), std::move(options))) {
  impl_->database.requireFolder();
}

Planner::~Planner() = default;
Planner::Planner(Planner&&) noexcept = default;
Planner& Planner::operator=(Planner&&) noexcept = default;

const Robot& Planner::robot() const { return impl_->robot; }
const Scene& Planner::scene() const { return impl_->requireScene(); }

void Planner::setScene(Scene scene) {
  std::vector<Candidate> candidates = impl_->makeCandidates(scene);
  impl_->candidates = std::move(candidates);
  impl_->scene = std::move(scene);
  impl_->raysAreCurrent = impl_->worldIsCurrent = false;
}

void Planner::loadScene(const std::string& path) {
  Scene scene = handhold::loadScene(path, [this](const std::string& object) { return objectMesh(object); });
  try {
    setScene(std::move(scene));
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", path, error.what()));
  }
}

const VectorXd& Planner::posture() const {
  impl_->requireScene();
  return impl_->candidates.front().situation.posture;
}

std::shared_ptr<const GraspTable> Planner::graspTable(const std::string& object, int arm) {
  return impl_->table(object, impl_->robot.arms[arm].hand);
}

TriangleMesh Planner::objectMesh(const std::string& object) {
  if (const auto known = impl_->objectMeshes.find(object); known != impl_->objectMeshes.end()) return known->second;
  // The hands of the robot first: their sets are read anyway.
  for (const Arm& arm : impl_->robot.arms) {
    if (const auto table = impl_->table(object, arm.hand)) return impl_->objectMeshes[object] = table->objectMesh;
  }
  const std::vector<SetFile> sets = impl_->database.sets();
  const SetFile* newest = nullptr;
  std::set<std::string> objects;
  for (const SetFile& set : sets) {
    objects.insert(set.object);
    if (set.object == object && (newest == nullptr || set.version > newest->version)) newest = &set;
  }
  if (newest == nullptr) {
    const std::string wanted =
        objects.empty() ? "it holds no set" : fmt::format("want one of: {}", fmt::join(objects, ", "));
    throw InputError(
        fmt::format("the database {} has no object {}, {}", impl_->database.folder().string(), object, wanted));
  }
  return impl_->objectMeshes[object] = readGraspSet(newest->path).objectMesh;
}

Ranking Planner::rank(ScoreKind kind) {
  impl_->requireScene();
  Ranking ranking;
  std::vector<GraspScore> scores;
  if (kind == ScoreKind::paper) {
    impl_->scorePaperAll(ranking, scores);
  } else {
    impl_->scoreReachAll(ranking, scores);
  }
  ranking.grasps.reserve(scores.size());
  for (const GraspScore& score : scores) ranking.grasps.push_back(impl_->ranked(score));
  return ranking;
}

std::optional<Rejection> Planner::test(const GraspScore& score) {
  impl_->requireScene();
  impl_->updateWorld();
  const Candidate& candidate = impl_->candidateOf(score);
  return impl_->validators[candidate.arm]->testOnly(candidate.table->grasps[score.grasp], candidate.situation);
}

double Planner::reachableShare() {
  impl_->requireScene();
  std::size_t reached = 0, all = 0;
  std::vector<VectorXd> solutions;
  for (const Candidate& candidate : impl_->candidates) {
    const Arm& arm = impl_->robot.arms[candidate.arm];
    const ArmTools& tools = impl_->arms[candidate.arm];
    const Isometry3d X_AO = candidate.situation.X_WA.inverse() * candidate.situation.X_WO;
    const VectorXd posture = ActiveJoints(impl_->robot, candidate.arm).pick(candidate.situation.posture);
    for (const StoredGrasp& grasp : candidate.table->grasps) {
      tools.ik->solve(X_AO * grasp.X_OH * arm.X_TH.inverse(), posture.head(tools.chain.size()), solutions);
      reached += solutions.empty() ? 0 : 1;
    }
    all += candidate.table->grasps.size();
  }
  return all == 0 ? 0 : static_cast<double>(reached) / static_cast<double>(all);
}

PlanResult Planner::plan(const PlanRequest& request) {
  const Scene& scene = impl_->requireScene();
  if (!scene.joints) {
    throw InputError("robot.joints is missing, want the present joint positions, or the word home");
  }
  PlanResult result;
  result.object = scene.target;
  result.clearance = impl_->robot.clearance;
  Ranking ranking = rank(request.score);
  result.timingMs = ranking.timingMs;
  if (request.prefer) Impl::prefer(*request.prefer, ranking.grasps);
  {
    const Stopwatch watch(result.timingMs, "models");
    impl_->updateWorld();
  }
  impl_->checksBefore = impl_->world->checks();
  const auto checks = [&] { return impl_->world->checks() - impl_->checksBefore; };
  std::map<int, Impl::Start> starts;
  for (const Candidate& candidate : impl_->candidates) {
    const Impl::Start& start = starts[candidate.arm] = impl_->judgeStart(candidate);
    if (start.fault) result.reason = *start.fault;
  }
  int motionsFailed = 0;
  for (std::size_t i = 0; i < ranking.grasps.size() && !result.planned; ++i) {
    const RankedGrasp& ranked = ranking.grasps[i];
    if (starts[ranked.score.arm].fault) continue;
    result.clearance = starts[ranked.score.arm].clearance;
    if (request.stop && request.stop(checks())) {
      result.stopped = true;
      result.reason = "stopped before a plan was found";
      break;
    }
    if (motionsFailed >= impl_->options.maxMotions) {
      result.reason = fmt::format("no motion to any of the first {} grasps that would work", motionsFailed);
      break;
    }
    ++result.tested;
    std::string detail;
    const auto rejection = impl_->planOne(ranked, request, result, detail);
    if (rejection) {
      const std::string name(kRejectionNames[static_cast<std::size_t>(*rejection)]);
      ++result.rejected[name];
      motionsFailed += *rejection >= Rejection::noMotion ? 1 : 0;
      if (request.trace) result.trace.push_back({i + 1, ranked, name, detail});
      continue;
    }
    const Candidate& candidate = impl_->candidateOf(ranked.score);
    result.planned = true;
    result.reason.clear();
    result.rank = i + 1;
    result.grasp = ranked;
    result.hand = candidate.table->hand;
    result.setVersion = candidate.table->setVersion;
    result.arm = impl_->robot.arms[candidate.arm].name;
  }
  result.checks = checks();
  if (!result.planned && result.reason.empty()) {
    result.reason = fmt::format("none of the {} stored grasps works here", ranking.grasps.size());
  }
  return result;
}

}  // namespace handhold
