#pragma once

#include "hand/hand.h"
#include "mesh/object.h"
#include "store/grasp_set.h"

namespace handhold {

/// The object of a set as the build had it: repaired already, so that only what follows from the surface is computed.
ObjectModel storedObject(const GraspSet& set);

/// The hand of a set, with the preshapes of its job.
Hand storedHand(const GraspSet& set);

/// The trial that a grasp of a set came from: its index into N*R*M.
std::size_t trialOf(const GraspSet& set, std::size_t row);

}  // namespace handhold
