#pragma once

#include "core/random.h"
#include "quality/force_closure.h"
#include "simulate/grasp_policy.h"

namespace handhold {

/// How far the object may be from where it is thought to be: it is turned about its centre of mass by a rotation
/// vector, then shifted, both normally distributed, each component with this standard deviation.
struct PoseNoise {
  double position = 0;  // m
  double rotation = 0;  // rad
  int trials = 0;
};

/// A probability known from `closed` of `trials`, and its 95 % interval (Wilson 1927, "Probable inference, the law of
/// succession, and statistical inference"). NaN without trials.
struct Proportion {
  Proportion(int closed, int trials);
  double share, lower, upper;
};

/// How often closing the hand ends force closed when the pose is off: the hand, in its preshape, arrives at X_OH, moved
/// by the noise; a hand that touches the object there counts as not closed. Trial i draws from stream.child(i).
/// @param X_OH   of the hand before it closes and centres itself
/// @param cones  of the object; linearised friction cones, as the verdicts of the database
Proportion forceClosureUnderNoise(GraspPolicy& policy, FrictionCones& cones, const Eigen::Isometry3d& X_OH,
                                  int preshape, const Eigen::Vector3d& centerOfMass, const PoseNoise& noise,
                                  const RandomStream& stream);

}  // namespace handhold
