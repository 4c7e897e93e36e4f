#pragma once

#include "simulate/grasp_policy.h"

#include <memory>

namespace handhold {

/// makeReferencePolicy without centerCoupledJaws: for a policy that asks the reference and is centred as a whole.
std::unique_ptr<GraspPolicy> makeUncenteredReference(const Hand& hand, const ObjectModel& object, PolicyKind kind,
                                                     const ReferenceSettings& settings);

}  // namespace handhold
