#pragma once

// Private to src/robot.

#include "robot/inverse_kinematics.h"

namespace handhold {

/// Null when the geometry of the last six joints allows no closed form.
std::unique_ptr<InverseKinematics> makeClosedFormInverseKinematics(const ArmChain& chain, const IkSettings& settings);

}  // namespace handhold
