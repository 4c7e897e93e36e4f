#pragma once

#include "hand/hand.h"
#include "quality/load_margin.h"

#include <span>

namespace handhold {

/// What the hand's joints limit in a grasp, one column a limit:
/// - a joint that drives itself and those that follow it, its own motion plus the multiplier times each follower's,
///   against the driver's effort (the drive's virtual work);
/// - a follower with an effort of its own, against that: what its transmission bears.
/// A `breakaway` joint whose position is not the one it would follow to (clutch open) is a driver: the policy moved it
/// on alone and the joint before it is held by its own drive, so each has its own limit. A joint without an effort
/// limit (0) limits nothing, nor does one that moves no contact.
/// @param q  (J) joint positions of the grasp
Actuation actuationOf(const Hand& hand, const Eigen::VectorXd& q, const Eigen::Isometry3d& X_OH,
                      std::span<const Contact> contacts, const Eigen::Vector3d& centerOfMass);

/// Is the effort of any joint known?
bool hasEffortLimits(const Hand& hand);

}  // namespace handhold
