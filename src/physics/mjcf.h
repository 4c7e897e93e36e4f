#pragma once

#include "physics/convex_pieces.h"
#include "physics/drives.h"

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// What an object weighs: its closed mesh, of even density.
struct ObjectMass {
  double mass = 0.1;                                       // kg
  Eigen::Vector3d centerOfMass = Eigen::Vector3d::Zero();  // m, in O
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();       // kg m^2 about it, for that mass
};

/// What the hand stands on.
enum class HandBase {
  fixed,    // its root link is the world
  carried,  // welded to a body that is moved (`carrier`), above a table (`table`) that it passes through
};

/// Numbers of the world, as DexGraspBench has them where it says them (PHYSICS in docs/physics.md).
struct WorldSettings {
  double timeStep = 0.004;                                               // s
  double friction = 0.6, torsionFriction = 0.02, rollFriction = 0.0001;  // 1, m, m
};

/// A box in a link's or the object's frame, for the engine's search for pairs that may touch.
struct BroadShape {
  Eigen::Vector3d center = Eigen::Vector3d::Zero(), halfSize = Eigen::Vector3d::Zero();
};

/// The shapes of a scene. Without pieces the boxes are stand-ins (a box a link, an ellipsoid for the object): what
/// touches is computed by our own function. With them MuJoCo collides the convex pieces.
struct SceneShapes {
  std::vector<BroadShape> links;  // an empty size is a link without geometry
  BroadShape object;
  std::vector<std::vector<ConvexPiece>> linkPieces;  // of each link; empty: no pieces
  std::vector<ConvexPiece> objectPieces;
};

/// The scene as MJCF for MuJoCo 2.2: bodies `link_<i>` with joints `joint_<i>`, actuators `drive_<i>`, the free body
/// `object`. Links touch the object alone, not each other.
std::string graspMjcf(const Hand& hand, const std::vector<Drive>& drives, const SceneShapes& shapes,
                      const ObjectMass& mass, HandBase base, double tableHeight, const WorldSettings& settings);

}  // namespace handhold
