#pragma once

#include "store/grasp_set.h"
#include "store/physics_set.h"

#include <algorithm>
#include <limits>

namespace handhold {

/// Results of the first `count` grasps of a set: grasp i held in min(i, 6) of the six directions of the pull.
inline PhysicsSet physicsOf(const GraspSet& set, std::size_t count) {
  PhysicsSet physics;
  physics.object = set.object;
  physics.hand = set.hand;
  physics.inputHash = set.inputHash;
  physics.setVersion = set.setVersion;
  physics.settings = "version 1\n";
  physics.friction = 0.6;
  physics.outcomeNames = {"held", "moved"};
  physics.testNames = {"pull"};
  physics.directionNames = {"pull +x", "pull -x", "pull +y", "pull -y", "pull +z", "pull -z"};
  for (std::size_t i = 0; i < count; ++i) {
    physics.grasp.push_back(static_cast<std::uint32_t>(i));
    physics.settledClosed.push_back(i > 0 ? 1 : 0);
    physics.settledContacts.push_back(static_cast<std::uint16_t>(i));
    for (auto* column :
         {&physics.settledDisplacement, &physics.settledRotation, &physics.settledPenetration, &physics.squeeze}) {
      column->push_back(0.25f * static_cast<float>(i));
    }
    for (std::size_t k = 0; k < 6; ++k) {
      const bool held = k < i;
      physics.outcome.push_back(held ? 0 : 1);
      physics.displacement.push_back(held ? 0.001f : 0.07f);
      physics.rotation.push_back(0);
      physics.fallSeconds.push_back(held ? std::numeric_limits<float>::infinity() : 0.4f);
      physics.penetration.push_back(1e-4f);
    }
  }
  return physics;
}

}  // namespace handhold
