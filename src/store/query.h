#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Which grasps are wanted: those that pass every filter that is given. Vectors are in the object frame.
struct GraspQuery {
  struct Cone {
    Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();  // any length but 0
    double halfAngle = std::numbers::pi;              // rad, 0 to pi
  };
  struct Ball {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();  // m
    double radius = 0;                                 // m
  };

  std::string object = "*", hand = "*";  // shell patterns of *, ? and [...]
  std::optional<int> setVersion;         // default: the newest of each object and hand
  std::optional<double> minEpsilon;      // of the epsilon as stored, which belongs to the set's own friction
  std::optional<double> friction;        // at most the set's own; keeps critical_friction <= friction
  std::optional<Cone> approach;          // holds approach_direction, which points from the palm to the object
  std::optional<Ball> near;              // holds target_point
  std::string preshape = "*";            // shell pattern of the preshape's name
  std::optional<double> minPhysics;      // share of the simulated directions survived, 0 to 1
  std::optional<std::size_t> top;        // at most so many of each set, from 1
  bool diverse = false;                  // with top: farthestPoses of those that pass, s = torque_scale; else the best
};

/// A row of a set's /grasps (db/FORMAT.md). Object frame; SI and radians.
struct FoundGrasp {
  std::size_t grasp = 0;                                                         // the row: 0 is the set's best
  std::array<std::uint32_t, 3> trial;                                            // sample, roll, preshape
  double epsilon = 0, epsilonLower = 0, epsilonUpper = 0, criticalFriction = 0;  // the last three: NaN when not known
  double loadMargin = 0;  // N; NaN: not known, +infinity: nothing known bounds it
  double robustness = 0, robustnessLower = 0, robustnessUpper = 0;  // NaN: not known
  std::array<double, 7> handPose;                                   // x y z qx qy qz qw, as stored
  Eigen::Isometry3d X_OH;                                // the same: pose of the hand's root link H in the object O
  Eigen::VectorXd jointPosition, preshapeJointPosition;  // by FoundSet::jointNames
  Eigen::Vector3d targetPoint, approachDirection;
  double roll = 0, backoff = 0;
  bool approachClear = false;
  std::size_t contacts = 0;
  double physics = std::numeric_limits<double>::quiet_NaN();  // share of the directions held; NaN: not asked for
};

/// A set in which something was found.
struct FoundSet {
  std::filesystem::path path;
  std::string object, hand;
  int setVersion = 0;
  double friction = 0;  // the set's own
  std::vector<std::string> jointNames, preshapeNames;
  std::size_t passed = 0;  // grasps that pass the filters; more than `grasps` with `top`
  /// m: each grasp that passed lies within it of one in `grasps`, by farthestPoses' distance; NaN without `diverse`.
  double coverRadius = std::numeric_limits<double>::quiet_NaN();
  std::vector<FoundGrasp> grasps;  // by falling epsilon
};

/// Grasps that each filter left out. One counts at the first filter, in this order, that it fails; when no grasp of a
/// set can pass minEpsilon or friction, the whole set counts there.
struct LeftOut {
  std::size_t notSimulated = 0;  // with minPhysics
  std::size_t minPhysics = 0;
  std::size_t minEpsilon = 0;
  std::size_t friction = 0;         // need more
  std::size_t unknownFriction = 0;  // their critical friction is not known
  std::size_t preshape = 0, approach = 0, near = 0;
};

struct QueryAnswer {
  std::vector<FoundSet> sets;   // by object, hand and version
  std::size_t setsAsked = 0;    // that object, hand and setVersion pick
  std::size_t graspsAsked = 0;  // in those of them that could be read
  LeftOut leftOut;
  std::vector<std::string> failures;  // a line for each set that could not be read: damaged, gone, newer
};

}  // namespace handhold
