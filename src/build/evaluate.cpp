#include "build/evaluate.h"

#include "core/float_rounding.h"
#include "simulate/actuation.h"

#include <chrono>
#include <limits>

namespace handhold {
namespace {

/// Adds the seconds since the last call to a stage. Reading the wall's clock takes some 20 ns, the processor's ten
/// times as much: a trial may take no more than some 30 us.
class StageClock {
 public:
  void addTo(double& seconds) {
    const auto now = std::chrono::steady_clock::now();
    seconds += std::chrono::duration<double>(now - last_).count();
    last_ = now;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

constexpr double kNotEvaluated = std::numeric_limits<double>::quiet_NaN();

}  // namespace

void evaluate(GraspPolicy& policy, const GraspCandidate& candidate, Cones& cones, Evaluation& result,
              StageSeconds& seconds) {
  StageClock clock;
  policy.run(candidate, result.trial);
  clock.addTo(seconds.policy);
  judge(policy, candidate, cones, result, seconds);
}

void judge(GraspPolicy& policy, const GraspCandidate& candidate, Cones& cones, Evaluation& result,
           StageSeconds& seconds) {
  StageClock clock;
  GraspTrial& trial = result.trial;
  if (trial.outcome == GraspOutcome::notForceClosed && trial.contacts.size() < cones.fewestContacts) {
    trial.outcome = GraspOutcome::tooFewContacts;
  }
  result.approachClear = false;
  result.epsilon = trial.outcome == GraspOutcome::blockedCentering ? kNotEvaluated : 0;
  if (trial.outcome != GraspOutcome::notForceClosed) return;

  for (Contact& contact : trial.contacts) {
    for (double& x : contact.position) x = roundedToFloat(x);
    for (double& x : contact.normal) x = roundedToFloat(x);
  }
  const WrenchView wrenches = cones.linearised.wrenches(trial.contacts);
  result.forceClosure = testForceClosure(wrenches);
  clock.addTo(seconds.forceClosure);
  if (result.forceClosure.verdict == ForceClosure::notClosed) return;
  if (result.forceClosure.verdict == ForceClosure::closed)
    result.epsilon = epsilonMetric(wrenches, result.forceClosure);
  clock.addTo(seconds.epsilon);
  if (result.forceClosure.verdict == ForceClosure::failed || !(result.epsilon > 0)) {
    trial.outcome = GraspOutcome::solveFailed;
    result.epsilon = kNotEvaluated;
    return;
  }
  trial.outcome = policy.selfCollides(candidate, trial) ? GraspOutcome::selfCollision : GraspOutcome::forceClosed;
  if (trial.outcome == GraspOutcome::forceClosed) result.approachClear = policy.approachIsClear(candidate, trial);
  clock.addTo(seconds.approach);
}

LoadMargin evaluateLoad(LoadMarginSolver& solver, const Hand& hand, const Eigen::VectorXd& jointPosition,
                        const Eigen::Isometry3d& X_OH, std::span<const Contact> contacts,
                        const Eigen::Vector3d& centerOfMass, const TaskWrenches& tasks) {
  Eigen::VectorXd q = jointPosition;
  for (double& position : q) position = roundedToFloat(position);
  return solver.solve(contacts, actuationOf(hand, q, X_OH, contacts, centerOfMass), tasks);
}

}  // namespace handhold
