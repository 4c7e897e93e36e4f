#pragma once

#include "quality/force_closure.h"
#include "simulate/grasp_policy.h"

#include <cstdint>

namespace handhold {

/// One trial from candidate to verdict.
struct Evaluation {
  GraspTrial trial;                 // contacts rounded as stored
  double epsilon = 0;               // > 0 force closed, 0 not, NaN not evaluated
  ForceClosureResult forceClosure;  // meaningful when there were contacts enough
  bool approachClear = false;       // of force-closed grasps
};

/// Seconds of one worker by stage; where they are added up only totals count.
struct StageSeconds {
  double policy = 0, forceClosure = 0, epsilon = 0, approach = 0;
};

/// Policy, force closure, epsilon, and for a force-closed grasp the hand against itself and the approach. Contacts are
/// rounded to 32-bit floats first, so that a stored grasp can be recomputed from its record.
void evaluate(GraspPolicy& policy, const GraspCandidate& candidate, const WrenchModel& model, Evaluation& result,
              StageSeconds& seconds);

}  // namespace handhold
