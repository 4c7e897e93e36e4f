#pragma once

#include "store/grasp_set.h"

#include <cstddef>

namespace handhold {

/// How the bytes of a set's file come about: bytes = fixed + samples * perSample + trials * perTrial + grasps *
/// perGrasp.
struct SetSize {
  double fixed = 0;                   // meshes, texts, HDF5's own
  double perSample = 0;               // the distance map's points included
  double perTrial = 0, perGrasp = 0;  // contacts and neighbours included; 0 in a set without any
};

SetSize sizeOf(const GraspSet& set, std::size_t fileBytes);

}  // namespace handhold
