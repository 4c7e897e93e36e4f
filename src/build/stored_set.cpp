#include "build/stored_set.h"

#include "mesh/mass_properties.h"

namespace handhold {

ObjectModel storedObject(const GraspSet& set) {
  ObjectModel object;
  object.mesh = set.objectMesh;
  object.watertight = isWatertight(object.mesh);
  object.mass = massProperties(object.mesh, object.watertight);
  return object;
}

Hand storedHand(const GraspSet& set) {
  Hand hand = restoreHand(set.hand, set.urdf, set.config, set.linkNames, set.linkMeshes);
  choosePreshapes(hand, set.preshapeNames);
  return hand;
}

std::size_t trialOf(const GraspSet& set, std::size_t row) {
  const std::uint32_t* index = set.trial.data() + 3 * row;  // sample, roll, preshape
  return (index[0] * set.rolls + index[1]) * set.preshapes + index[2];
}

}  // namespace handhold
