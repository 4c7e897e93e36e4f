#pragma once

#include "hand/mechanism.h"

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

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
  /// The object may slide in the hand, or the arm yields. Two jaws that slide (isSlidingPair) close one by one, then
  /// the hand moves so that they are coupled again. Without a follower: the hand first slides against its closing axis
  /// until what the joint does not move touches. Other coupled jaws: the hand moves along its closing axis to where
  /// both sides touch together.
  bool selfCentering = false;
};

/// A hand read from URDF and hand.yaml; its root link H is link 0, whose pose is the hand pose. Immutable after
/// loading; safe from many threads.
struct Hand : Mechanism {
  std::string name;
  int palmLink = 0;
  Eigen::Isometry3d X_LG = Eigen::Isometry3d::Identity();  // palm frame G in the palm link: +z approach, +x closing
  int tcpLink = 0;
  Eigen::Vector3d p_LT = Eigen::Vector3d::Zero();  // tool centre point in the tcp link
  std::vector<Preshape> preshapes;
  std::vector<ClosingJoint> closing;
  double torsionRadius = 0;  // e [m] of soft fingers; 0: point contacts
  std::string configText;    // as read, for the database
};

/// Reads `FOLDER/hand.yaml` (or the file itself). @throws InputError naming file, line or element
Hand loadHand(const std::string& path, const PackagePaths& packages = {});

/// The hand in a database record: the texts of its two files, and each link's name and geometry. Equal to the hand that
/// loadHand read from the files, `notes` aside. @throws InputError  naming the stored text, its line or element
Hand restoreHand(const std::string& name, const std::string& urdfText, const std::string& configText,
                 const std::vector<std::string>& linkNames, const std::vector<TriangleMesh>& linkMeshes);

/// Leaves the preshapes of these names, in their order; names that the hand does not have are passed over.
void choosePreshapes(Hand& hand, const std::vector<std::string>& names);

/// The joints that fix a hand's posture: the independent ones, then those mimic joints that go on alone when a finger
/// is stopped (breakaway).
std::vector<int> fixingJoints(const Hand& hand);

/// Does one joint alone mimic `joint`, so that two jaws slide by the same way?
bool isSlidingPair(const Mechanism& mechanism, int joint);

/// On which side of the palm each link is that a closing joint moves, in the first preshape: 1 or -1 along the closing
/// axis, 0 for links that it does not move, or without geometry.
std::vector<int> jawSides(const Hand& hand, const ClosingJoint& closing);

/// A first hand.yaml for a URDF, with what was guessed in its comments (README.md says how): root, palm, tool centre
/// point, what closes and which way, preshapes.
/// @param rootLink  empty: where the fingers branch off
/// @throws InputError  naming the file and the element; the URDF has no such link, or nothing that moves below it
std::string initialHandConfig(const std::string& urdfPath, const std::string& rootLink = "",
                              const PackagePaths& packages = {});

}  // namespace handhold
