#pragma once

#include "hand/hand.h"
#include "view/renderer.h"

#include <vector>

namespace handhold {

/// A hand with its palm frame as pins that shine through: blue towards the object (approach), red along the closing
/// axis, both from the palm point. The approach is up.
/// @param jointPosition  (J)
/// @param held           parts in the frame of the hand's root link, as what it holds
Image handPicture(const Hand& hand, const Eigen::VectorXd& jointPosition, const std::vector<ScenePart>& held = {},
                  const RenderSettings& settings = {});

}  // namespace handhold
