#pragma once

#include "mesh/triangle_mesh.h"

#include <map>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

enum class JointType { revolute, prismatic };

/// A moving joint. Its frame J is fixed in the parent link; the child link turns about or slides along `axis`.
struct Joint {
  std::string name;
  JointType type = JointType::revolute;
  int parentLink = -1;
  int childLink = -1;
  Eigen::Isometry3d X_PJ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // unit, in J
  double lower = 0, upper = 0;                      // rad or m
  double effort = 0;                                // N m or N, 0 when the URDF gives none
  double velocity = 0;                              // rad/s or m/s, 0 when the URDF gives none
  int mimicOf = -1;                                 // index of the independent joint followed, -1: independent
  double mimicMultiplier = 1, mimicOffset = 0;      // q = multiplier * q_mimicOf + offset
};

/// A rigid body. Links without collision geometry have no triangles.
struct Link {
  std::string name;
  int parentLink = -1;                                     // -1 for the root
  int joint = -1;                                          // moving joint to the parent; -1: fixed (or the root)
  Eigen::Isometry3d X_PL = Eigen::Isometry3d::Identity();  // of a fixed link in its parent
  TriangleMesh mesh;                                       // all collision geometry, in the link frame
  std::vector<Eigen::Vector3d> piecePoints;                // one point of each connected piece, for containment tests
  bool contactAllowed = true;
};

/// A tree of links and joints read from a URDF: a hand, or an arm with what it stands on. Links and joints stand in an
/// order in which parents come first; link 0 is the root. Immutable after loading; safe from many threads.
struct Mechanism {
  std::vector<Link> links;
  std::vector<Joint> joints;
  std::string urdfText;            // as read
  std::string contentHash;         // of every mesh; a Hand's also of its texts
  std::vector<std::string> notes;  // what was found, a sentence each
};

/// How `package://NAME/...` becomes a path: NAME=DIR of the caller first, then AMENT_PREFIX_PATH (share/NAME) and
/// ROS_PACKAGE_PATH, then the folders above the URDF that are called NAME.
using PackagePaths = std::map<std::string, std::string>;

/// Joint positions (J) with every mimic joint following: q = multiplier * q_master + offset.
Eigen::VectorXd followMimics(const Mechanism& mechanism, Eigen::VectorXd jointPosition);

/// Pose of every link in the root link H, for joint positions (J) that are taken as they are (a distal joint whose
/// clutch has opened no longer follows).
std::vector<Eigen::Isometry3d> forwardKinematics(const Mechanism& mechanism, const Eigen::VectorXd& jointPosition);

/// The same into `X_HL`, which keeps its memory.
void forwardKinematics(const Mechanism& mechanism, const Eigen::VectorXd& jointPosition,
                       std::vector<Eigen::Isometry3d>& X_HL);

/// Brings `links`, ascending, in `X_HL` up to date; the other links must be.
void updateKinematics(const Mechanism& mechanism, const Eigen::VectorXd& jointPosition, std::span<const int> links,
                      std::vector<Eigen::Isometry3d>& X_HL);

/// For every link, whether it moves when `joint` moves; `withFollowers`: together with all that mimic it.
std::vector<bool> linksMovedBy(const Mechanism& mechanism, int joint, bool withFollowers);

/// For every link, whether it moves when any of `joints` does, together with all that mimic it.
std::vector<bool> linksMovedBy(const Mechanism& mechanism, const std::vector<int>& joints);

/// The joints that mimic no other, in order.
std::vector<int> independentJoints(const Mechanism& mechanism);

/// The joints that mimic `joint`, directly or through others, in order.
std::vector<int> followersOf(const Mechanism& mechanism, int joint);

}  // namespace handhold
