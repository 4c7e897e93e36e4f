#pragma once

#include "quality/force_closure.h"
#include "quality/load_margin.h"
#include "simulate/grasp_policy.h"

#include <cstdint>
#include <span>

namespace handhold {

/// One trial from candidate to verdict.
struct Evaluation {
  GraspTrial trial;                 // contacts rounded as stored
  double epsilon = 0;               // > 0 force closed, 0 not, NaN not evaluated
  ForceClosureResult forceClosure;  // meaningful when there were contacts enough
  bool approachClear = false;       // of force-closed grasps
};

/// What a worker makes of contacts.
struct Cones {
  explicit Cones(const WrenchModel& model) : fewestContacts(model.fewestContacts()), linearised(model) {}
  std::size_t fewestContacts;  // contacts, below which nothing is asked
  FrictionCones linearised;
};

/// Seconds by stage.
struct StageSeconds {
  double policy = 0, forceClosure = 0, epsilon = 0, approach = 0;

  void add(const StageSeconds& other, double factor) {
    policy += factor * other.policy;
    forceClosure += factor * other.forceClosure;
    epsilon += factor * other.epsilon;
    approach += factor * other.approach;
  }
};

/// Policy, force closure, epsilon, and for a force-closed grasp the hand against itself and the approach. Contacts are
/// rounded to 32-bit floats first, so that a stored grasp can be recomputed from its record. Adds wall-clock seconds.
/// `cones` and `result` are a worker's: with them, what follows the policy allocates nothing once it has seen as many
/// contacts.
void evaluate(GraspPolicy& policy, const GraspCandidate& candidate, Cones& cones, Evaluation& result,
              StageSeconds& seconds);

/// The same for a trial whose contacts are gathered already: `result.trial` is what the policy left.
void judge(GraspPolicy& policy, const GraspCandidate& candidate, Cones& cones, Evaluation& result,
           StageSeconds& seconds);

/// The load margin of a grasp. Joint positions are rounded to 32-bit floats first, as the contacts were, for the same
/// reason.
LoadMargin evaluateLoad(LoadMarginSolver& solver, const Hand& hand, const Eigen::VectorXd& jointPosition,
                        const Eigen::Isometry3d& X_OH, std::span<const Contact> contacts,
                        const Eigen::Vector3d& centerOfMass, const TaskWrenches& tasks);

}  // namespace handhold
