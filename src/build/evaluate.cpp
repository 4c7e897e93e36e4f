#include "build/evaluate.h"

#include "core/float_rounding.h"

#include <ctime>
#include <limits>

namespace handhold {
namespace {

/// Adds this thread's processor seconds since the last call to a stage: unlike the wall's they do not count waiting.
class StageClock {
 public:
  void addTo(double& seconds) {
    const double now = threadSeconds();
    seconds += now - last_;
    last_ = now;
  }

 private:
  static double threadSeconds() {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  }

  double last_ = threadSeconds();
};

constexpr double kNotEvaluated = std::numeric_limits<double>::quiet_NaN();

}  // namespace

void evaluate(GraspPolicy& policy, const GraspCandidate& candidate, const WrenchModel& model, Evaluation& result,
              StageSeconds& seconds) {
  StageClock clock;
  policy.run(candidate, result.trial);
  clock.addTo(seconds.policy);
  GraspTrial& trial = result.trial;
  result.approachClear = false;
  result.epsilon = trial.outcome == GraspOutcome::blockedCentering ? kNotEvaluated : 0;
  if (trial.outcome != GraspOutcome::notForceClosed) return;

  for (Contact& contact : trial.contacts) {
    for (double& x : contact.position) x = roundedToFloat(x);
    for (double& x : contact.normal) x = roundedToFloat(x);
  }
  const WrenchMatrix wrenches = frictionConeWrenches(trial.contacts, model);
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

}  // namespace handhold
