#pragma once

#include "hand/hand.h"

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Coefficients of the grasp score (Berenson et al. 2007, equation 1), and what a ray that meets nothing counts.
struct ScoreCoefficients {
  double c1 = 1, c2 = 1, c3 = 2;
  double far = 0.5;  // m
};

/// An arm: a chain of joints of the robot, with a hand at its end.
struct Arm {
  std::string name;
  int baseLink = -1, tipLink = -1;  // links of the robot
  std::vector<int> joints;          // of the robot, from base to tip: the independent moving joints of the chain
  Hand hand;
  Eigen::Isometry3d X_TH = Eigen::Isometry3d::Identity();  // hand root H in the tip link T
  std::vector<int> handLinks;                              // the robot's link for each link of `hand`
  std::vector<int> handJoints;                             // the robot's joint for each joint of `hand`
};

/// Where the robot is known to reach things, for experiments: a table in front of it.
struct Workspace {
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();  // of the robot's root
  Eigen::Vector3d tableSize, tablePosition;                // m: full extents of a box, and its centre
  std::array<double, 2> x{}, y{};                          // m: where objects stand, in W
  std::string arm;                                         // empty: any
};

/// A robot read from URDF and robot.yaml: the URDF's tree with every arm's hand put in its place (a hand that is part
/// of the URDF is used where it stands). Frame B is the root link. A joint or link of a hand that is put on keeps its
/// name where that is free in the robot, and is called ARM_NAME where it is not, or where two arms carry such a hand.
/// Immutable after loading; safe from many threads.
struct Robot {
  std::string name;
  Mechanism body;  // arms and hands; joints that belong to no arm stand still
  std::vector<Arm> arms;
  Eigen::VectorXd home;                                // (J) of all joints of `body`, mimic joints included
  Eigen::VectorXd maxVelocity, maxAcceleration;        // (J) rad/s, rad/s^2 (m for prismatic joints)
  double clearance = 0.005;                            // m, kept by planned motions
  std::vector<std::pair<int, int>> allowedCollisions;  // links, lower index first: touching is no collision
  ScoreCoefficients score;
  std::optional<Workspace> workspace;
  std::string contentHash;         // of all texts and meshes
  std::vector<std::string> notes;  // what was found, a sentence each
};

/// Reads `FOLDER/robot.yaml` (or the file itself) with its URDF and hands. The robot is called as its folder, and
/// FOLDER_FILE when the file is not robot.yaml.
/// Pairs of links that are neighbours in the tree (links without geometry passed over), or that no joint moves against
/// each other, are always allowed to touch. Joints that `home` does not name stand at 0, or in the middle of limits
/// that do not hold it. Where nothing is given, joints may move with 1 rad/s and 2 rad/s^2 (m for prismatic joints);
/// the URDF's velocity limits hold as well.
/// @throws InputError  naming file, line, key or element
Robot loadRobot(const std::string& path, const PackagePaths& packages = {});
/// The same from the text of a robot.yaml; `path` is where it would lie.
Robot parseRobot(const std::string& configText, const std::string& path, const PackagePaths& packages = {});

/// Index of the arm called `name`, -1 when there is none.
int findArm(const Robot& robot, const std::string& name);

/// A robot.yaml to start from for a URDF (`robot FILE.urdf --init`): the longest chain of moving joints as the arm,
/// limits, and the pairs of links that always or never touch, found by sampling postures within the limits (streams
/// keyed by the sample). An SRDF adds its disable_collisions and, as home, its first group_state.
/// @param srdfPath  empty: none
/// @throws InputError  naming the file and the element
std::string initialRobotConfig(const std::string& urdfPath, const std::string& srdfPath, const PackagePaths& packages);

}  // namespace handhold
