#pragma once

#include "exchange/grasp_frame.h"
#include "hand/given_grasp.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace handhold {

/// A grasp as another program's file has it.
struct FileGrasp {
  std::string name;                                               // where in the file, for messages
  Eigen::Isometry3d X_OF = Eigen::Isometry3d::Identity();         // of the file's gripper frame F in the object frame O
  std::map<std::string, double> jointPosition, pregraspPosition;  // by joint; empty where the file has none
};

/// A file of grasps of one object.
struct GraspFile {
  std::string path, format;            // acronym, isaac_grasp or graspgen
  RootAxes rootAxes = RootAxes::link;  // of the frame at the root that the format means
  std::string gripperFrame;            // as the file calls it; may be empty
  std::optional<double> objectScale;   // metres per unit of the object's mesh
  std::size_t failed = 0;              // grasps that the file itself marks as failed: not among `grasps`
  std::vector<FileGrasp> grasps;
};

/// Reads ACRONYM (.h5, .hdf5), isaac_grasp (.yaml, .yml) or GraspGen (.json).
/// @throws InputError  `PATH: WHERE is FOUND, want WANTED`, also for a file without any grasp that did not fail
GraspFile readGraspFile(const std::string& path);

struct GivenGraspOptions {
  GraspFrame frame = GraspFrame::root;  // what the file's poses are of
  std::string preshape;                 // in which the hand arrives; empty: the one nearest to the file's pregrasp,
                                        // the hand's first where there is none
  bool close = false;                   // pass over the file's joint positions: the policy closes
};

struct GivenGrasps {
  std::vector<GivenGrasp> grasps;
  std::size_t otherPregrasp = 0;  // whose pregrasp in the file is that of no preshape of the hand
};

/// The grasps of a file as those of our hand. Joint positions are taken when they fix the whole posture: all joints
/// that mimic no other, and those with a breakaway.
/// @throws InputError  a joint that the hand does not have or that cannot be there, no such preshape
GivenGrasps givenGrasps(const GraspFile& file, const Hand& hand, const GivenGraspOptions& options);

/// Leaves the preshapes in which any of the grasps arrives; the grasps' indices follow.
void keepUsedPreshapes(Hand& hand, std::vector<GivenGrasp>& grasps);

}  // namespace handhold
