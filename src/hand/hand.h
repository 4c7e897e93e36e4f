#pragma once

#include "mesh/triangle_mesh.h"

#include <map>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

enum class JointType { revolute, prismatic };

/// A moving joint. Its frame J is fixed in the parent link; the child link turns about or slides along `axis`.
struct HandJoint {
  std::string name;
  JointType type = JointType::revolute;
  int parentLink = -1;
  int childLink = -1;
  Eigen::Isometry3d X_PJ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // unit, in J
  double lower = 0, upper = 0;                      // rad or m
  double effort = 0;                                // N m or N, 0 when the URDF gives none
  int mimicOf = -1;                                 // index of the independent joint followed, -1: independent
  double mimicMultiplier = 1, mimicOffset = 0;      // q = multiplier * q_mimicOf + offset
};

/// A rigid body. Links without collision geometry have no triangles.
struct HandLink {
  std::string name;
  int parentLink = -1;                                     // -1 for the root
  int joint = -1;                                          // moving joint to the parent; -1: fixed (or the root)
  Eigen::Isometry3d X_PL = Eigen::Isometry3d::Identity();  // of a fixed link in its parent
  TriangleMesh mesh;                                       // all collision geometry, in the link frame
  std::vector<Eigen::Vector3d> piecePoints;                // one point of each connected piece, for containment tests
  bool contactAllowed = true;
};

struct Preshape {
  std::string name;
  Eigen::VectorXd jointPosition;  // (J), mimic joints included
  double standoff = 0;            // m, added to the back-off
};

/// One step of closing: `joint` moves in `direction` until something that it moves touches, or to its limit.
struct ClosingJoint {
  int joint = -1;
  int direction = 1;
  int breakawayJoint = -1;  // goes on alone when only links before it touched
  /// The object may slide in the hand, or the arm yields. With one prismatic follower: the two jaws close one by one,
  /// then the hand moves so that they are coupled again. Without: the hand first slides against its closing axis until
  /// what the joint does not move touches.
  bool selfCentering = false;
};

/// A hand read from URDF and hand.yaml. Links and joints stand in an order in which parents come first; link 0 is the
/// root H, whose pose is the hand pose. Immutable after loading; safe from many threads.
struct Hand {
  std::string name;
  std::vector<HandLink> links;
  std::vector<HandJoint> joints;
  int palmLink = 0;
  Eigen::Isometry3d X_LG = Eigen::Isometry3d::Identity();  // palm frame G in the palm link: +z approach, +x closing
  int tcpLink = 0;
  Eigen::Vector3d p_LT = Eigen::Vector3d::Zero();  // tool centre point in the tcp link
  std::vector<Preshape> preshapes;
  std::vector<ClosingJoint> closing;
  double torsionRadius = 0;          // e [m] of soft fingers; 0: point contacts
  std::string urdfText, configText;  // as read, for the database
  std::string contentHash;           // of both texts and every mesh
  std::vector<std::string> notes;    // what was found, a sentence each
};

/// How `package://NAME/...` becomes a path: NAME=DIR of the caller first, then AMENT_PREFIX_PATH (share/NAME) and
/// ROS_PACKAGE_PATH, then the folders above the URDF that are called NAME.
using PackagePaths = std::map<std::string, std::string>;

/// Reads `FOLDER/hand.yaml` (or the file itself). @throws InputError naming file, line or element
Hand loadHand(const std::string& path, const PackagePaths& packages = {});

/// The hand in a database record: the texts of its two files, and each link's name and geometry. Equal to the hand that
/// loadHand read from the files, `notes` aside. @throws InputError  naming the stored text, its line or element
Hand restoreHand(const std::string& name, const std::string& urdfText, const std::string& configText,
                 const std::vector<std::string>& linkNames, const std::vector<TriangleMesh>& linkMeshes);

/// Leaves the preshapes of these names, in their order; names that the hand does not have are passed over.
void choosePreshapes(Hand& hand, const std::vector<std::string>& names);

/// Joint positions (J) with every mimic joint following: q = multiplier * q_master + offset.
Eigen::VectorXd followMimics(const Hand& hand, Eigen::VectorXd jointPosition);

/// Pose of every link in the root link H, for joint positions (J) that are taken as they are (a distal joint whose
/// clutch has opened no longer follows).
std::vector<Eigen::Isometry3d> forwardKinematics(const Hand& hand, const Eigen::VectorXd& jointPosition);

/// The same into `X_HL`, which keeps its memory.
void forwardKinematics(const Hand& hand, const Eigen::VectorXd& jointPosition, std::vector<Eigen::Isometry3d>& X_HL);

/// For every link, whether it moves when `joint` moves; `withFollowers`: together with all that mimic it.
std::vector<bool> linksMovedBy(const Hand& hand, int joint, bool withFollowers);

/// The joints that mimic `joint`, directly or through others, in order.
std::vector<int> followersOf(const Hand& hand, int joint);

/// A hand.yaml to start from for a URDF: the joints that close listed, the palm to be filled in.
std::string initialHandConfig(const std::string& urdfPath, const PackagePaths& packages = {});

}  // namespace handhold
