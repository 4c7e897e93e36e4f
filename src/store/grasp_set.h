#pragma once

#include "mesh/triangle_mesh.h"

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// One grasp set: everything in one database file (db/FORMAT.md). Arrays are row-major; lengths are in elements.
struct GraspSet {
  // provenance
  std::string object, hand, inputHash, generator, job, policy;
  int setVersion = 0;
  int methodVersion = 0;  // of the method that computed it; 0: a set from before this was recorded
  double friction = 0, contactDistance = 0, torqueScale = 0, pitch = 0, mapPitch = 0;
  double torsionRadius = 0;                               // of soft fingers; 0: point contacts
  int robustnessTrials = 0;                               // of each grasp; 0: none
  double robustnessPosition = 0, robustnessRotation = 0;  // standard deviations [m], [rad] of each component
  int coneEdges = 0;
  std::uint64_t seed = 0;

  // object
  TriangleMesh objectMesh;
  bool watertight = false;
  Eigen::Vector3d centerOfMass = Eigen::Vector3d::Zero();
  std::vector<std::string> objectNotes;

  // hand
  std::vector<std::string> jointNames, linkNames, preshapeNames;
  std::string urdf, config;
  std::vector<TriangleMesh> linkMeshes;  // one per link name, link frame

  // trials
  std::size_t samples = 0, rolls = 0, preshapes = 0;
  std::vector<float> samplePoint, sampleNormal;  // (N,3)
  std::vector<std::string> outcomeNames;
  std::vector<std::uint8_t> outcome;  // (N,R,M)
  std::vector<float> trialEpsilon;    // (N,R,M)
  std::uint64_t trialsByReference = 0;

  // grasps, one row each
  std::vector<std::uint32_t> trial;            // (n,3) sample, roll, preshape
  std::vector<float> targetPoint;              // (n,3)
  std::vector<float> approachDirection;        // (n,3)
  std::vector<float> roll;                     // (n)
  std::vector<double> handPose;                // (n,7) x y z qx qy qz qw of the root link
  std::vector<float> jointPosition;            // (n,J)
  std::vector<float> preshapeJointPosition;    // (n,J)
  std::vector<double> epsilon;                 // (n)
  std::vector<float> backoff;                  // (n)
  std::vector<std::uint8_t> approachClear;     // (n)
  std::vector<double> epsilonLower;            // (n) on the true cone, as the two below; NaN: not known
  std::vector<double> epsilonUpper;            // (n)
  std::vector<float> criticalFriction;         // (n)
  std::vector<float> loadMargin;               // (n) [N]; NaN: not known, +infinity: no known limit bounds it
  std::vector<float> robustness;               // (n) probability of force closure under pose noise; NaN: not known
  std::vector<float> robustnessLower;          // (n) 95 % interval of it
  std::vector<float> robustnessUpper;          // (n)
  std::vector<std::uint32_t> contactBegin{0};  // (n+1)

  // contacts
  std::vector<float> contactPosition, contactNormal;  // (C,3)
  std::vector<std::uint16_t> contactLink;             // (C)

  // distance map
  std::vector<float> mapPoint, mapNormal;  // (S,3)
  int neighbors = 0;                       // k
  std::vector<std::uint32_t> mapNeighbor;  // (n,k)
  std::vector<float> mapWeight;            // (n,k)

  // timings: never compared
  std::map<std::string, double> seconds;  // per stage, of one core
  std::string host, created;

  std::size_t graspCount() const { return epsilon.size(); }
  std::size_t trialCount() const { return samples * rolls * preshapes; }
  /// Pose of the root link of grasp `row` in the object frame; the stored quaternion is normalised once more.
  Eigen::Isometry3d X_OH(std::size_t row) const {
    const double* p = handPose.data() + 7 * row;
    const Eigen::Quaterniond turn = Eigen::Quaterniond(p[6], p[3], p[4], p[5]).normalized();
    return Eigen::Translation3d(p[0], p[1], p[2]) * turn;
  }
};

}  // namespace handhold
