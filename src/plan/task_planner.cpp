#include "plan/task_planner.h"

#include "core/error.h"
#include "plan/check_plan.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kSamePosture = 1e-4;     // rad or m
constexpr std::size_t kAlternatives = 3;  // ways to end a task that are kept for one grasp
constexpr int kEndPoses = 48;             // of a place, tried for one grasp
constexpr int kDropPoses = 4000;          // of a drop: they need no ground, so all orientations are looked at
constexpr double kFallStep = 0.01;        // m, between two poses of a falling object
constexpr int kEndLooks = 24;             // of poses with inverse kinematics at the end, looked at for one grasp
constexpr int kChainsOfAGrasp = 6;        // ways without motions, before the next grasp is picked

/// A stored grasp in the hand of an arm.
struct Grip {
  int arm = 0;
  std::uint32_t row = 0;
  const StoredGrasp* grasp = nullptr;
};

/// Where one step leads, without the motions between goals.
struct Goal {
  Grip grip;            // holds the object after a pick or hand over, before a place or drop
  Isometry3d X_WO;      // the object at the end; dropped: where it is let go
  VectorXd held;        // (n) active joints of the arm that brings it there; not of a pick or place
  GraspMotion grasp;    // pick, hand over, place (backwards); drop: its `close` backwards
  GraspMotion release;  // hand over (backwards)
};

/// The attempt that came farthest gives the reason. Here inverse kinematics is asked for first.
void keepFarthest(Rejection& reason, Rejection other) {
  if (reason == Rejection::unreachable || (other != Rejection::unreachable && other > reason)) reason = other;
}

JointPath reversed(JointPath path) {
  std::reverse(path.begin(), path.end());
  return path;
}

/// What stays whatever the task. None of it is the planner's, which ranks for other poses and arms while a task is
/// searched: its collision world would be filled anew each time, and its validators lift what hangs in another hand.
struct Tools {
  Tools(Planner& p, const TaskOptions& o) : planner(p), robot(p.robot()), options(o), world(robot) {
    ValidationSettings inTheAir = options.validation;
    inTheAir.lift = 0;
    for (int arm = 0; arm < static_cast<int>(robot.arms.size()); ++arm) {
      chains.push_back(std::make_unique<ArmChain>(makeChain(robot, arm)));
      ik.push_back(makeInverseKinematics(*chains.back()));
    }
    for (int arm = 0; arm < static_cast<int>(robot.arms.size()); ++arm) {
      grounded.emplace_back(robot, arm, world, *ik[arm], *chains[arm], options.validation);
      aloft.emplace_back(robot, arm, world, *ik[arm], *chains[arm], inTheAir);
    }
  }

  Planner& planner;
  const Robot& robot;
  TaskOptions options;
  CollisionWorld world;
  std::vector<std::unique_ptr<ArmChain>> chains;
  std::vector<std::unique_ptr<InverseKinematics>> ik;
  std::vector<GraspValidator> grounded, aloft;  // by arm: the object stands on something; is in another hand
};

/// One object from its pick until it leaves the hands: goals first (a search in depth), then motions.
class Handling {
 public:
  Handling(Tools& tools, const Task& task, std::size_t first, std::size_t last,
           const std::vector<std::optional<Isometry3d>>& X_WO, TaskResult& result);

  /// Fills the steps' results and moves the object (none: dropped).
  bool run(std::vector<std::optional<Isometry3d>>& X_WO);
  bool feasible() const { return chainsFailed_ > 0; }
  /// What an arm meets where the robot stands; nothing can be planned then.
  std::optional<std::string> startFault() const;

 private:
  // Goals.
  bool pick();
  bool follow(std::size_t step);
  bool carry(std::size_t step);
  bool handOver(std::size_t step);
  bool finish(std::size_t step);
  bool descend(Goal goal, std::size_t step);
  const std::vector<Goal>& endings(std::size_t step, const Grip& grip);
  std::optional<Goal> placing(const Grip& grip, const Isometry3d& X_WO, Rejection& reason) const;
  std::optional<Goal> dropping(const Grip& grip, const Isometry3d& X_WO, Rejection& reason) const;
  const std::vector<Grip>& reaching(std::size_t step);
  std::vector<Grip> takersFrom(const Grip& giver, std::size_t step);
  std::optional<VectorXd> hold(const Grip& grip, const Isometry3d& X_WO, Rejection& reason) const;
  std::optional<Goal> exchange(const Grip& giver, const Grip& receiver, const VectorXd& held, const Isometry3d& X_WO,
                               Rejection& reason) const;
  const std::vector<Isometry3d>& posesOf(std::size_t step);
  Eigen::AlignedBox3d boxAt(const Isometry3d& X_WO) const;
  bool fallsIn(std::size_t step, std::size_t pose);
  std::optional<Isometry3d> poseAbove(const TaskStep& step, const RandomStream& sample) const;
  bool reaches(const Grip& grip, const Isometry3d& X_WO, std::vector<VectorXd>& q) const;
  std::vector<RankedGrasp> ranked(int arm, const Isometry3d& X_WO);
  Grip gripOf(int arm, std::uint32_t row);

  // Motions.
  bool move();
  std::optional<Rejection> moveStep(std::size_t step, const Goal* before, VectorXd& posture, Isometry3d& X_WO);
  enum class Carrying { notYet, yes, gone };  // the object: stands somewhere; in the moving hand; not looked at
  std::optional<JointPath> connect(int arm, const ArmSituation& situation, const VectorXd& from, const VectorXd& to,
                                   Carrying carrying, const Grip* grip);
  std::optional<Rejection> seal(std::size_t step, TaskMotion motion, const Grip& grip, bool holds, VectorXd& posture,
                                Isometry3d& X_WO);

  ArmSituation situation(int arm, const VectorXd& posture, const Isometry3d& X_WO) const;
  const Arm& armOf(const Grip& grip) const { return robot_.arms[grip.arm]; }
  const ActiveJoints& active(int arm) const { return tools_.grounded[arm].active(); }
  VectorXd closed(const Grip& grip, const VectorXd& arm) const {
    return active(grip.arm).join(arm, grip.grasp->finalPosition);
  }
  void count(std::size_t step, Rejection reason) {
    ++result_.steps[step].rejected[std::string(kRejectionNames[static_cast<std::size_t>(reason)])];
  }
  bool gaveUp() const { return chainsFailed_ >= tools_.options.maxChains; }
  /// Does nothing more come of the grasp that was picked?
  bool hopeless() const { return gaveUp() || chainsFailed_ - chainsBefore_ >= kChainsOfAGrasp || pickFailed_; }

  Tools& tools_;
  const Robot& robot_;
  const Task& task_;
  std::size_t first_, last_;  // steps
  const TaskObject& object_;
  Isometry3d X_WO_;  // at the pick
  TaskResult& result_;
  Scene scene_;                                                // without target: the other objects are obstacles
  VectorXd rest_;                                              // (J)
  std::vector<Isometry3d> X_AW_;                               // by arm: the world in its base, at rest
  std::map<int, std::shared_ptr<const GraspTable>> tables_;    // by arm
  std::vector<Goal> goals_;                                    // of steps first_ ..
  std::map<std::size_t, std::vector<Isometry3d>> poses_;       // by step
  std::map<std::pair<std::size_t, std::size_t>, bool> falls_;  // by step and pose
  std::map<std::size_t, std::vector<Grip>> reaching_;          // by step: grasps to take, whatever the giver
  std::map<std::tuple<std::size_t, int, std::uint32_t>, std::vector<Goal>> endings_;
  std::vector<TaskMotion> pickMotions_;  // of the present grasp, once they were found
  int chainsFailed_ = 0;
  int chainsBefore_ = 0;     // failed before the present grasp was picked
  bool pickFailed_ = false;  // there is no motion to it
};

Handling::Handling(Tools& tools, const Task& task, std::size_t first, std::size_t last,
                   const std::vector<std::optional<Isometry3d>>& X_WO, TaskResult& result)
    : tools_(tools),
      robot_(tools.robot),
      task_(task),
      first_(first),
      last_(last),
      object_(task.objects[task.steps[first].object]),
      X_WO_(*X_WO[task.steps[first].object]),
      result_(result),
      scene_(task.surroundings) {
  for (std::size_t i = 0; i < task.objects.size(); ++i) {
    if (i == task.steps[first].object || !X_WO[i]) continue;
    scene_.obstacles.push_back(
        {task.objects[i].name, makeMeshShape(tools.planner.objectMesh(task.objects[i].object)), *X_WO[i]});
  }
  scene_.target = object_.object;
  scene_.X_WO = X_WO_;
  scene_.arm.clear();
  tools_.planner.setScene(scene_);
  rest_ = tools_.planner.posture();
  for (int arm = 0; arm < static_cast<int>(robot_.arms.size()); ++arm) {
    X_AW_.push_back(situation(arm, rest_, X_WO_).X_WA.inverse());
    if (auto table = tools_.planner.graspTable(object_.object, arm)) tables_[arm] = std::move(table);
  }
  tools_.world.setObstacles(scene_.obstacles);
  const GraspTable& any = *tables_.begin()->second;
  tools_.world.setTarget(any.objectMesh, any.watertight, object_.name);
}

Grip Handling::gripOf(int arm, std::uint32_t row) { return {arm, row, &tables_.at(arm)->grasps[row]}; }

ArmSituation Handling::situation(int arm, const VectorXd& posture, const Isometry3d& X_WO) const {
  const std::vector<Isometry3d> X_BL = forwardKinematics(robot_.body, posture);
  return {scene_.X_WB, scene_.X_WB * X_BL[robot_.arms[arm].baseLink], posture, X_WO};
}

/// Inverse kinematics with the joints of other arms at rest.
bool Handling::reaches(const Grip& grip, const Isometry3d& X_WO, std::vector<VectorXd>& q) const {
  const ActiveJoints& joints = active(grip.arm);
  tools_.ik[grip.arm]->solve(X_AW_[grip.arm] * X_WO * grip.grasp->X_OH * armOf(grip).X_TH.inverse(),
                             joints.pick(rest_).head(joints.armSize()), q);
  return !q.empty();
}

std::vector<RankedGrasp> Handling::ranked(int arm, const Isometry3d& X_WO) {
  Scene scene = scene_;
  scene.X_WO = X_WO;
  if (arm >= 0) scene.arm = robot_.arms[arm].name;
  tools_.planner.setScene(std::move(scene));
  return tools_.planner.rank(tools_.options.score).grasps;
}

/// Poses to try for the object at the end of a step: from a stream of their own, whatever the grasp.
const std::vector<Isometry3d>& Handling::posesOf(std::size_t step) {
  const auto [at, isNew] = poses_.try_emplace(step);
  if (!isNew) return at->second;
  const TaskStep& description = task_.steps[step];
  const RandomStream stream = RandomStream(tools_.options.seed).child(step);
  const bool places = description.verb == TaskVerb::place, drops = description.verb == TaskVerb::drop;
  const int count = places ? kEndPoses : drops ? kDropPoses : tools_.options.poses;
  for (int i = 0; i < count; ++i) {
    const RandomStream sample = stream.child(static_cast<std::uint64_t>(i));
    if (!drops) {
      at->second.push_back(description.region.sample(sample));
    } else if (const auto X = poseAbove(description, sample)) {
      at->second.push_back(*X);
    }
  }
  return at->second;
}

Eigen::AlignedBox3d Handling::boxAt(const Isometry3d& X_WO) const {
  Eigen::AlignedBox3d box;
  for (const Vector3d& p : tables_.begin()->second->objectMesh.vertices) box.extend(X_WO * p);
  return box;
}

/// Any orientation in which the object fits between the sides of the box around `into`; there, above it.
std::optional<Isometry3d> Handling::poseAbove(const TaskStep& step, const RandomStream& sample) const {
  const Obstacle& into = task_.surroundings.obstacles[step.into];
  const Eigen::AlignedBox3d opening = boundingBox(into.shape->mesh).transformed(into.X_WS);
  Region anywhere;
  anywhere.turn = Region::Turn::any;
  Isometry3d X = anywhere.sample(sample);
  const Eigen::AlignedBox3d box = boxAt(X);
  const Vector3d room = opening.sizes() - box.sizes();
  if (room.head<2>().minCoeff() < 0) return std::nullopt;
  X.translation() += opening.center() - box.center();
  for (int axis = 0; axis < 2; ++axis) {
    X.translation()[axis] += room[axis] * (sample.uniform(6 + static_cast<std::uint64_t>(axis)) - 0.5);
  }
  X.translation().z() += opening.max().z() + step.releaseHeight - boxAt(X).min().z();
  return X;
}

/// Does the object, let go, meet nothing on its way straight down until it is wholly below the rim?
bool Handling::fallsIn(std::size_t step, std::size_t pose) {
  const auto [at, isNew] = falls_.try_emplace({step, pose}, true);
  if (!isNew) return at->second;
  const Isometry3d& X_WO = posesOf(step)[pose];
  const double depth = task_.steps[step].releaseHeight + boxAt(X_WO).sizes().z();
  const int parts = std::max(1, static_cast<int>(std::ceil(depth / kFallStep)));
  for (int i = 1; i <= parts && at->second; ++i) {
    const std::vector<bool> met =
        tools_.world.obstaclesNearTarget(Eigen::Translation3d(0, 0, -depth * i / parts) * X_WO, 0);
    at->second = std::find(met.begin(), met.end(), true) == met.end();
  }
  return at->second;
}

std::optional<std::string> Handling::startFault() const {
  for (int arm = 0; arm < static_cast<int>(robot_.arms.size()); ++arm) {
    const auto X_WL = tools_.grounded[arm].linkPoses(active(arm).pick(rest_), situation(arm, rest_, X_WO_));
    if (const auto met = tools_.world.robotTouches(arm, X_WL, X_WO_, TargetRule::avoid, 0)) {
      return fmt::format("where the robot stands, {} meets {}", met->first, met->second);
    }
  }
  return std::nullopt;
}

bool Handling::run(std::vector<std::optional<Isometry3d>>& X_WO) {
  if (!pick()) return false;
  const bool dropped = task_.steps[last_].verb == TaskVerb::drop;
  auto& object = X_WO[task_.steps[first_].object];
  object = dropped ? std::nullopt : std::optional(goals_.back().X_WO);
  return true;
}

bool Handling::descend(Goal goal, std::size_t step) {
  goals_.push_back(std::move(goal));
  if (step == last_ ? move() : follow(step + 1)) return true;
  goals_.pop_back();
  return false;
}

bool Handling::pick() {
  const TaskStep& next = task_.steps[first_ + 1];
  std::vector<VectorXd> q;
  for (const RankedGrasp& candidate : ranked(task_.steps[first_].arm, X_WO_)) {
    if (gaveUp()) return false;
    const Grip grip = gripOf(candidate.score.arm, candidate.score.grasp);
    if (!reaches(grip, X_WO_, q)) {
      count(first_, Rejection::unreachable);
      continue;
    }
    // What is tested once a grasp costs less than its way: can it end the task?
    if (next.verb == TaskVerb::place || next.verb == TaskVerb::drop) {
      if (endings(first_ + 1, grip).empty()) continue;
    }
    Validation validation = tools_.grounded[grip.arm].validate(*grip.grasp, situation(grip.arm, rest_, X_WO_));
    if (!validation.motion) {
      count(first_, validation.reason);
      continue;
    }
    Goal goal;
    goal.grip = grip;
    goal.X_WO = X_WO_;
    if (validation.motion->lift.size() > 1)
      goal.X_WO = Eigen::Translation3d(0, 0, tools_.options.validation.lift) * X_WO_;
    goal.grasp = std::move(*validation.motion);
    chainsBefore_ = chainsFailed_;
    pickFailed_ = false;
    pickMotions_.clear();
    if (descend(std::move(goal), first_)) return true;
  }
  return false;
}

bool Handling::follow(std::size_t step) {
  switch (task_.steps[step].verb) {
    case TaskVerb::carry:
      return carry(step);
    case TaskVerb::handOver:
      return handOver(step);
    default:
      return finish(step);
  }
}

/// The arm with the object in its hand at a pose, free by the clearance.
std::optional<VectorXd> Handling::hold(const Grip& grip, const Isometry3d& X_WO, Rejection& reason) const {
  std::vector<VectorXd> solutions;
  if (!reaches(grip, X_WO, solutions)) return std::nullopt;
  keepFarthest(reason, Rejection::armCollision);
  const std::vector<bool> none(scene_.obstacles.size(), false);
  const ArmSituation here = situation(grip.arm, rest_, X_WO);
  for (const VectorXd& arm : solutions) {
    const VectorXd q = closed(grip, arm);
    const auto X_WL = tools_.grounded[grip.arm].linkPoses(q, here);
    if (!tools_.world.robotTouches(grip.arm, X_WL, X_WO, TargetRule::ignore, robot_.clearance) &&
        !tools_.world.targetTouches(grip.arm, X_WL, X_WO, none, robot_.clearance)) {
      return q;
    }
  }
  return std::nullopt;
}

bool Handling::carry(std::size_t step) {
  const Grip grip = goals_.back().grip;
  Rejection reason = Rejection::unreachable;
  std::vector<VectorXd> q;
  int looks = 0;
  for (const Isometry3d& X_WO : posesOf(step)) {
    if (looks >= tools_.options.closerLooks || hopeless()) break;
    if (!reaches(grip, X_WO, q)) continue;
    ++looks;
    auto held = hold(grip, X_WO, reason);
    if (!held) continue;
    Goal goal;
    goal.grip = grip;
    goal.X_WO = X_WO;
    goal.held = std::move(*held);
    const int failedBefore = chainsFailed_;
    if (descend(std::move(goal), step)) return true;
    // The goals that follow do not depend on where the object was carried in between; motions do.
    if (chainsFailed_ == failedBefore) return false;
  }
  count(step, reason);
  return false;
}

/// Grasps of the taking hand that reach where the object is put down, best first.
const std::vector<Grip>& Handling::reaching(std::size_t step) {
  const auto [at, isNew] = reaching_.try_emplace(step);
  if (!isNew) return at->second;
  const TaskVerb next = task_.steps[step + 1].verb;
  const bool ends = next == TaskVerb::place || next == TaskVerb::drop;
  std::vector<VectorXd> q;
  for (const RankedGrasp& candidate :
       ranked(task_.steps[step].arm, next == TaskVerb::place ? task_.steps[step + 1].region.X_WR : X_WO_)) {
    const Grip grip = gripOf(candidate.score.arm, candidate.score.grasp);
    const std::vector<Isometry3d>& poses = posesOf(step + 1);
    if (!ends || std::any_of(poses.begin(), poses.end(), [&](const Isometry3d& X) { return reaches(grip, X, q); })) {
      at->second.push_back(grip);
    }
  }
  return at->second;
}

/// Those of them that leave room for the giving hand.
std::vector<Grip> Handling::takersFrom(const Grip& giver, std::size_t step) {
  const auto handAt = [&](const Grip& grip, const VectorXd& fingers) {
    std::vector<Isometry3d> X = forwardKinematics(armOf(grip).hand, fingers);
    for (Isometry3d& x : X) x = grip.grasp->X_OH * x;
    return X;
  };
  const auto giving = handAt(giver, giver.grasp->finalPosition);
  std::vector<Grip> result;
  for (const Grip& grip : reaching(step)) {
    if (!tools_.world.handsTouch(giver.arm, giving, grip.arm, handAt(grip, grip.grasp->preshapePosition))) {
      result.push_back(grip);
    }
  }
  return result;
}

/// The taking hand comes and closes about the object in the giving one, which then lets go.
std::optional<Goal> Handling::exchange(const Grip& giver, const Grip& receiver, const VectorXd& held,
                                       const Isometry3d& X_WO, Rejection& reason) const {
  const VectorXd giving = active(giver.arm).posture(held, rest_);
  Validation taken = tools_.aloft[receiver.arm].validate(*receiver.grasp, situation(receiver.arm, giving, X_WO));
  if (!taken.motion) {
    keepFarthest(reason, taken.reason);
    return std::nullopt;
  }
  const VectorXd both = active(receiver.arm).posture(taken.motion->close.back(), giving);
  Validation left = tools_.aloft[giver.arm].validate(*giver.grasp, situation(giver.arm, both, X_WO));
  if (!left.motion || (left.motion->close.back() - held).cwiseAbs().maxCoeff() > kSamePosture) {
    keepFarthest(reason, left.motion ? Rejection::approachBroken : left.reason);
    return std::nullopt;
  }
  Goal goal;
  goal.grip = receiver;
  goal.X_WO = X_WO;
  goal.held = held;
  goal.grasp = std::move(*taken.motion);
  goal.release = std::move(*left.motion);
  return goal;
}

bool Handling::handOver(std::size_t step) {
  const Grip giver = goals_.back().grip;
  const std::vector<Grip> takers = takersFrom(giver, step);
  Rejection reason = Rejection::unreachable;
  std::vector<VectorXd> q;
  int looks = 0;
  for (const Isometry3d& X_WO : posesOf(step)) {
    if (takers.empty() || looks >= tools_.options.closerLooks || hopeless()) break;
    const auto held = hold(giver, X_WO, reason);
    if (!held) continue;
    for (const Grip& taker : takers) {
      if (looks >= tools_.options.closerLooks || hopeless()) break;
      if (!reaches(taker, X_WO, q)) continue;
      ++looks;
      auto goal = exchange(giver, taker, *held, X_WO, reason);
      if (goal && descend(std::move(*goal), step)) return true;
    }
  }
  count(step, reason);
  return false;
}

std::optional<Goal> Handling::placing(const Grip& grip, const Isometry3d& X_WO, Rejection& reason) const {
  const Isometry3d raised = Eigen::Translation3d(0, 0, kResting) * X_WO;
  const std::vector<bool> met = tools_.world.obstaclesNearTarget(raised, 0);
  if (std::find(met.begin(), met.end(), true) != met.end()) {
    keepFarthest(reason, Rejection::targetCollision);
    return std::nullopt;
  }
  Validation validation = tools_.grounded[grip.arm].validate(*grip.grasp, situation(grip.arm, rest_, X_WO));
  if (!validation.motion) {
    keepFarthest(reason, validation.reason);
    return std::nullopt;
  }
  Goal goal;
  goal.grip = grip;
  goal.X_WO = X_WO;
  goal.grasp = std::move(*validation.motion);
  return goal;
}

std::optional<Goal> Handling::dropping(const Grip& grip, const Isometry3d& X_WO, Rejection& reason) const {
  const auto held = hold(grip, X_WO, reason);
  if (!held) return std::nullopt;
  const ActiveJoints& joints = active(grip.arm);
  const VectorXd open = joints.join(held->head(joints.armSize()), grip.grasp->preshapePosition);
  const ArmSituation here = situation(grip.arm, rest_, X_WO);
  for (int i = 1; i <= tools_.options.validation.closingSteps; ++i) {
    const VectorXd q = *held + (open - *held) * i / tools_.options.validation.closingSteps;
    if (tools_.world.robotTouches(grip.arm, tools_.grounded[grip.arm].linkPoses(q, here), X_WO, TargetRule::ignore,
                                  robot_.clearance)) {
      return std::nullopt;
    }
  }
  Goal goal;
  goal.grip = grip;
  goal.X_WO = X_WO;
  goal.held = *held;
  goal.grasp.close = {open, *held};
  return goal;
}

/// Ways to put the object down or to drop it with a grasp, with the other arms at rest; known once, counted once.
const std::vector<Goal>& Handling::endings(std::size_t step, const Grip& grip) {
  const auto [at, isNew] = endings_.try_emplace({step, grip.arm, grip.row});
  if (!isNew) return at->second;
  const bool places = task_.steps[step].verb == TaskVerb::place;
  Rejection reason = Rejection::unreachable;
  std::vector<VectorXd> q;
  const std::vector<Isometry3d>& poses = posesOf(step);
  int looks = 0;
  for (std::size_t i = 0; i < poses.size() && looks < kEndLooks && at->second.size() < kAlternatives; ++i) {
    if (!reaches(grip, poses[i], q)) continue;
    if (!places && !fallsIn(step, i)) {
      keepFarthest(reason, Rejection::targetCollision);
      continue;
    }
    ++looks;
    if (auto goal = places ? placing(grip, poses[i], reason) : dropping(grip, poses[i], reason)) {
      at->second.push_back(std::move(*goal));
    }
  }
  if (at->second.empty()) count(step, reason);
  return at->second;
}

bool Handling::finish(std::size_t step) {
  const std::vector<Goal> ways = endings(step, goals_.back().grip);
  for (const Goal& way : ways) {
    if (hopeless()) return false;
    if (descend(way, step)) return true;
  }
  return false;
}

/// A motion of one arm between two postures: the hand empty, or with the object in it; its fingers move straight.
std::optional<JointPath> Handling::connect(int arm, const ArmSituation& here, const VectorXd& from, const VectorXd& to,
                                           Carrying carrying, const Grip* grip) {
  const GraspValidator& validator = tools_.grounded[arm];
  const ActiveJoints& joints = validator.active();
  const std::size_t hand = static_cast<std::size_t>(robot_.arms[arm].handLinks[0]);
  const std::vector<bool> none(scene_.obstacles.size(), false);
  const Isometry3d X_HO = grip != nullptr ? grip->grasp->X_OH.inverse() : Isometry3d::Identity();
  double margin = robot_.clearance;
  MotionSpace space{joints.lower(), joints.upper(), validator.reach(), {}};
  const Eigen::Index fingers = joints.size() - joints.armSize();
  space.lower.tail(fingers) = from.cwiseMin(to).tail(fingers);
  space.upper.tail(fingers) = from.cwiseMax(to).tail(fingers);
  space.isFree = [&](const VectorXd& q) {
    const std::vector<Isometry3d> X_WL = validator.linkPoses(q, here);
    if (carrying == Carrying::yes) {
      const Isometry3d X_WO = X_WL[hand] * X_HO;
      return !tools_.world.robotTouches(arm, X_WL, X_WO, TargetRule::ignore, margin) &&
             !tools_.world.targetTouches(arm, X_WL, X_WO, none, margin);
    }
    const TargetRule rule = carrying == Carrying::gone ? TargetRule::ignore : TargetRule::avoid;
    return !tools_.world.robotTouches(arm, X_WL, here.X_WO, rule, margin);
  };
  if (!space.isFree(from) || !space.isFree(to)) margin = 0;
  MotionSettings settings;
  settings.seed = tools_.options.seed;
  settings.maxChecks = tools_.options.maxChecksPerMotion;
  settings.fineStep = std::max(2 * margin, 0.002);
  return planMotion(space, from, to, settings);
}

/// Holds a finished motion against its promises, keeps it and moves on to where it ends.
std::optional<Rejection> Handling::seal(std::size_t step, TaskMotion motion, const Grip& grip, bool holds,
                                        VectorXd& posture, Isometry3d& X_WO) {
  const GraspTable& table = *tables_.at(grip.arm);
  const ActiveJoints& joints = active(grip.arm);
  CheckedMotion checked;
  checked.robot = &robot_;
  checked.arm = grip.arm;
  checked.trajectory = &motion.trajectory;
  checked.joints = joints.joints();
  checked.posture = posture;
  checked.X_WB = scene_.X_WB;
  checked.obstacles = &scene_.obstacles;
  checked.target = &table.objectMesh;
  checked.targetWatertight = table.watertight;
  checked.X_WO = X_WO;
  checked.X_OH = grip.grasp->X_OH;
  checked.finalPosition = grip.grasp->finalPosition;
  checked.holds = holds;
  checked.X_WO_after = motion.X_WO_after;
  if (findFault(checked)) return Rejection::recheckFailed;
  motion.arm = grip.arm;
  motion.jointNames = joints.names();
  motion.posture = posture;
  motion.X_WO = X_WO;
  X_WO = motion.X_WO_after;
  posture = joints.posture(motion.trajectory.points.back().position, posture);
  result_.steps[step].motions.push_back(std::move(motion));
  return std::nullopt;
}

/// The motions of one step. @param before  the step's predecessor; null for a pick
std::optional<Rejection> Handling::moveStep(std::size_t step, const Goal* before, VectorXd& posture, Isometry3d& X_WO) {
  const Goal& goal = goals_[step - first_];
  const TaskVerb verb = task_.steps[step].verb;
  const auto limits = [&](int arm) {
    return JointLimits{active(arm).pick(robot_.maxVelocity), active(arm).pick(robot_.maxAcceleration)};
  };
  const auto append = [&](const char* name, const JointPath& path, bool corners, int arm, TaskMotion& motion) {
    appendSegment(name, path, corners, limits(arm), motion.trajectory);
  };
  // A way between postures as a segment; false when there is none.
  const auto go = [&](const char* name, int arm, const VectorXd& from, const VectorXd& to, Carrying carrying,
                      const Grip* grip, TaskMotion& motion) {
    const auto path = connect(arm, situation(arm, posture, motion.X_WO_after), from, to, carrying, grip);
    if (path) append(name, *path, true, arm, motion);
    return path.has_value();
  };
  const auto take = [&](const Grip& grip, const GraspMotion& grasp, TaskMotion& motion) {
    if (!go("transit", grip.arm, active(grip.arm).pick(posture), grasp.approach.front(), Carrying::notYet, nullptr,
            motion)) {
      return false;
    }
    append("approach", grasp.approach, false, grip.arm, motion);
    append("close", grasp.close, true, grip.arm, motion);
    return true;
  };
  const auto leave = [&](const Grip& grip, const GraspMotion& grasp, TaskMotion& motion) {
    append("open", reversed(grasp.close), true, grip.arm, motion);
    append("retreat", reversed(grasp.approach), false, grip.arm, motion);
    return go("return", grip.arm, grasp.approach.front(), active(grip.arm).pick(rest_), Carrying::notYet, nullptr,
              motion);
  };
  TaskMotion motion;
  motion.X_WO_after = X_WO;
  if (verb == TaskVerb::pick) {
    if (!take(goal.grip, goal.grasp, motion)) return Rejection::noMotion;
    if (goal.grasp.lift.size() > 1) append("lift", goal.grasp.lift, false, goal.grip.arm, motion);
    motion.X_WO_after = goal.X_WO;
    return seal(step, std::move(motion), goal.grip, false, posture, X_WO);
  }
  const Grip& giver = before->grip;
  const bool places = verb == TaskVerb::place;
  const VectorXd& end = places ? goal.grasp.lift.back() : goal.held;
  if (!go("carry", giver.arm, active(giver.arm).pick(posture), end, Carrying::yes, &giver, motion)) {
    return Rejection::noMotion;
  }
  motion.X_WO_after = goal.X_WO;
  if (places) {
    if (goal.grasp.lift.size() > 1) append("lower", reversed(goal.grasp.lift), false, giver.arm, motion);
    if (!leave(giver, goal.grasp, motion)) return Rejection::noMotion;
  } else if (verb == TaskVerb::drop) {
    append("drop", reversed(goal.grasp.close), true, giver.arm, motion);
    if (!go("return", giver.arm, goal.grasp.close.front(), active(giver.arm).pick(rest_), Carrying::gone, nullptr,
            motion)) {
      return Rejection::noMotion;
    }
  }
  if (const auto fault = seal(step, std::move(motion), giver, true, posture, X_WO)) return fault;
  if (verb != TaskVerb::handOver) return std::nullopt;
  TaskMotion taking;
  taking.X_WO_after = X_WO;
  if (!take(goal.grip, goal.grasp, taking)) return Rejection::noMotion;
  if (const auto fault = seal(step, std::move(taking), goal.grip, false, posture, X_WO)) return fault;
  TaskMotion leaving;
  leaving.X_WO_after = X_WO;
  if (!leave(giver, goal.release, leaving)) return Rejection::noMotion;
  return seal(step, std::move(leaving), giver, true, posture, X_WO);
}

/// Motions for all goals, or the count of what was missing.
bool Handling::move() {
  VectorXd posture = rest_;
  Isometry3d X_WO = X_WO_;
  for (std::size_t step = first_; step <= last_; ++step) {
    const Goal& goal = goals_[step - first_];
    TaskStepResult& result = result_.steps[step];
    result.motions.clear();
    if (step == first_ && !pickMotions_.empty()) {
      result.motions = pickMotions_;
      posture = active(goal.grip.arm).posture(result.motions.back().trajectory.points.back().position, posture);
      X_WO = goal.X_WO;
    } else if (const auto reason =
                   moveStep(step, step == first_ ? nullptr : &goals_[step - first_ - 1], posture, X_WO)) {
      count(step, *reason);
      ++chainsFailed_;
      pickFailed_ = step == first_;
      return false;
    }
    if (step == first_) pickMotions_ = result.motions;
    result.arm = goal.grip.arm;
    result.grasp = goal.grip.row;
    result.trial = goal.grip.grasp->trial;
  }
  return true;
}

}  // namespace

double TaskStepResult::seconds() const {
  double sum = 0;
  for (const TaskMotion& motion : motions) sum += motion.trajectory.points.back().time;
  return sum;
}

struct TaskPlanner::Impl : Tools {
  using Tools::Tools;
};

TaskPlanner::TaskPlanner(Planner& planner, const TaskOptions& options) : impl_(new Impl(planner, options)) {}
TaskPlanner::~TaskPlanner() = default;

TaskResult TaskPlanner::plan(const Task& task) {
  TaskResult result;
  result.steps.resize(task.steps.size());
  result.feasible = true;
  const std::uint64_t before = impl_->world.checks();
  std::vector<std::optional<Isometry3d>> X_WO;
  for (const TaskObject& object : task.objects) X_WO.emplace_back(object.X_WO);
  for (std::size_t first = 0; first < task.steps.size() && result.reason.empty();) {
    std::size_t last = first;
    while (task.steps[last].verb != TaskVerb::place && task.steps[last].verb != TaskVerb::drop) ++last;
    Handling handling(*impl_, task, first, last, X_WO, result);
    if (const auto fault = handling.startFault()) {
      result.feasible = false;
      result.reason = *fault;
    } else if (!handling.run(X_WO)) {
      result.feasible = handling.feasible();
      result.reason = fmt::format(
          "{}: {}", task.objects[task.steps[first].object].name,
          handling.feasible() ? "motions were found for none of the ways to do it" : "no stored grasp does it here");
    }
    first = last + 1;
  }
  result.done = result.reason.empty();
  if (!result.done) {
    for (TaskStepResult& step : result.steps) step.motions.clear();
  }
  result.checks = impl_->world.checks() - before;
  return result;
}

}  // namespace handhold
