#include "build/robustness.h"

#include <cmath>

namespace handhold {

using Eigen::Isometry3d;
using Eigen::Vector3d;

Proportion::Proportion(int closed, int trials) {
  constexpr double z = 1.959964;  // standard normal, 97.5 %
  const double n = trials, p = closed / n;
  const double middle = (p + z * z / (2 * n)) / (1 + z * z / n);
  const double half = z / (1 + z * z / n) * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n));
  share = p;
  lower = trials > 0 && closed == 0 ? 0 : middle - half;  // as it is without rounding
  upper = trials > 0 && closed == trials ? 1 : middle + half;
}

namespace {

/// Three independent normal numbers at positions `counter` to `counter` + 2.
Vector3d normalVector(const RandomStream& stream, std::uint64_t counter) {
  return {stream.normal(counter), stream.normal(counter + 1), stream.normal(counter + 2)};
}

}  // namespace

Proportion forceClosureUnderNoise(GraspPolicy& policy, FrictionCones& cones, const Isometry3d& X_OH, int preshape,
                                  const Vector3d& centerOfMass, const PoseNoise& noise, const RandomStream& stream) {
  GraspTrial trial;
  int closed = 0;
  for (int i = 0; i < noise.trials; ++i) {
    const RandomStream mine = stream.child(static_cast<std::uint64_t>(i));
    const Vector3d turn = noise.rotation * normalVector(mine, 0);
    const Vector3d shift = noise.position * normalVector(mine, 3);
    const double angle = turn.norm();
    const Eigen::AngleAxisd R(angle, angle > 0 ? Vector3d(turn / angle) : Vector3d::UnitX());
    const Isometry3d X(Eigen::Translation3d(centerOfMass + shift) * R * Eigen::Translation3d(-centerOfMass));
    if (!policy.closeAt(X * X_OH, preshape, trial) || trial.outcome != GraspOutcome::notForceClosed) continue;
    closed += testForceClosure(cones.wrenches(trial.contacts)).verdict == ForceClosure::closed;
  }
  return {closed, noise.trials};
}

}  // namespace handhold
