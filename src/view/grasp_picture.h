#pragma once

#include "store/grasp_set.h"
#include "view/renderer.h"

#include <vector>

namespace handhold {

/// Grasp number `grasp` (by rank, from 0) of a set, in the object frame: the object in a warm colour, the links of the
/// hand in cool ones, and for each contact a red sphere with a cone that points along the contact normal, into the
/// object. Everything is taken from the set itself, the link poses from its URDF text.
/// @throws InputError  no such grasp (with the number that there are), or the stored URDF does not fit the set
std::vector<ScenePart> graspScene(const GraspSet& set, std::size_t grasp);

/// A direction from the object to the camera, never from below: of a fixed list the one that shows most of the
/// contacts, all links and the object, sideways to the approach direction where that is equal.
/// @note Deterministic.
Eigen::Vector3d graspView(const GraspSet& set, std::size_t grasp, const std::vector<ScenePart>& scene);

/// graspScene seen from graspView. @throws InputError as graspScene
Image graspPicture(const GraspSet& set, std::size_t grasp, const RenderSettings& settings = {});

}  // namespace handhold
