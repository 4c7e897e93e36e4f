#pragma once

#include "hand/hand.h"
#include "store/grasp_set.h"
#include "store/hold_calibration.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A stored grasp as the online stages need it. O is the object frame, H the root link of the hand.
struct StoredGrasp {
  Eigen::Isometry3d X_OH;
  Eigen::Vector3d targetPoint;  // P_t [m], in O
  Eigen::Vector3d approach;     // P_d, unit, towards the object, in O
  /// Where the hand comes from at the very end, unit or zero, in O: away from what those links touch that do not close
  /// (the fixed jaw of a gripper), across the approach. A hand that came straight in would scrape along it.
  Eigen::Vector3d sideways = Eigen::Vector3d::Zero();
  bool approachClear = false;  // the straight way in from outside is free of the object, as the set says
  double epsilon = 0;
  double quality = 0;  // Gq, 0 to 1: epsilon by the set's best, or the calibrated probability that the grasp holds
  std::array<std::uint32_t, 3> trial;               // sample, roll, preshape
  Eigen::VectorXd preshapePosition, finalPosition;  // (J) of the hand, rad or m
};

/// The grasps of one set, best first, with the surface points of the distance map. Immutable after reading.
struct GraspTable {
  std::string object, hand, path;
  int setVersion = 0;
  TriangleMesh objectMesh;
  bool watertight = false;
  Eigen::Vector3d centerOfMass = Eigen::Vector3d::Zero();  // in O
  std::vector<StoredGrasp> grasps;
  std::vector<float> mapPoint, mapNormal;  // (S,3), in O
  int neighbors = 0;                       // k
  std::vector<std::uint32_t> mapNeighbor;  // (n,k) into the map's points
  std::vector<float> mapWeight;            // (n,k), rows sum to 1
};

/// @param calibration  what the grasps' quality comes from; null: epsilon
/// @throws InputError  the set's hand has other joints than `hand`: it was built with another one; the calibration is
/// for other sets
GraspTable makeGraspTable(GraspSet set, const std::string& path, const Hand& hand,
                          const HoldCalibration* calibration = nullptr);

}  // namespace handhold
