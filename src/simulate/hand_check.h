#pragma once

#include "simulate/grasp_policy.h"

#include <string>
#include <vector>

namespace handhold {

/// A preshape closed on nothing and on a sphere in front of the palm.
struct PreshapeCheck {
  std::string name;
  GraspTrial onNothing, onSphere;
  bool selfCollidesEmpty = false;
};

/// What `handhold hand` tells about a hand.
struct HandCheck {
  double sphereRadius = 0;  // m
  double palmHeight = 0;    // m, of the hand's surface over the palm point, along the approach; NaN: nothing there
  std::vector<PreshapeCheck> preshapes;
  std::vector<std::string> warnings;
};

/// Closes every preshape on nothing and on a sphere, and looks at the palm frame.
HandCheck checkHand(const Hand& hand, double sphereRadius);

}  // namespace handhold
