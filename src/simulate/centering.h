#pragma once

#include "simulate/grasp_policy.h"

#include <memory>

namespace handhold {

/// The policy for a hand whose jaws are coupled and centre themselves (ClosingJoint::selfCentering of a joint that is
/// no sliding pair and has followers): where one side alone stops the closing, the hand moves along its closing axis,
/// away from the side that is still free, to where both touch together; then it closes there. Other hands: `policy`
/// itself. The hand stays where it was when it would have to move more than 0.2 m, or into the object.
/// @param policy  of `hand`, which must outlive the result
std::unique_ptr<GraspPolicy> centerCoupledJaws(const Hand& hand, std::unique_ptr<GraspPolicy> policy);

}  // namespace handhold
