#pragma once

#include "quality/force_closure.h"

#include <vector>

namespace handhold::testing {

/// Columns of the contacts' friction cones: torques about the origin, divided by 1 m.
inline WrenchMatrix wrenchesOf(const std::vector<Contact>& contacts, double friction = 0.4, int coneEdges = 8) {
  return frictionConeWrenches(contacts, {{0, 0, 0}, 1, friction, coneEdges});
}

}  // namespace handhold::testing
