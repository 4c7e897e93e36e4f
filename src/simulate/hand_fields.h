#pragma once

#include "core/job_system.h"
#include "simulate/closing_plan.h"
#include "simulate/collision_models.h"
#include "simulate/link_grid.h"
#include "simulate/object_shell.h"

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace handhold {

/// x' = rotation x + translation, row by row, in single precision.
struct Placement {
  std::array<float, 9> rotation;
  std::array<float, 3> translation;

  static Placement of(const Eigen::Isometry3d& X);
};

/// A moving joint of a motion. Its frame turns with the joint and has the joint's axis along z:
/// x = Z(-q) (fromParent x_parent), q = clamp(offset + rate s, lower, upper), Z turns about or slides along z.
struct MotionNode {
  int parent = -1;  // node, -1: the base
  Eigen::Isometry3d X_NP = Eigen::Isometry3d::Identity();
  Placement fromParent;  // X_NP
  bool turns = true;
  double offset = 0, rate = 0, lower = 0, upper = 0;
};

/// A link that moves along, fixed in a node's frame.
struct MotionLeaf {
  int node = 0;
  int link = 0;
  Eigen::Isometry3d X_LN = Eigen::Isometry3d::Identity();
  Placement fromNode;  // X_LN
};

/// For each lattice node the first and the last s at which a point within half a cell of the node (and within
/// ObjectShell::kBlockRadius of that in the coarse field) can be touched, in units of range / kLastUnit, packed as
/// first + (last << 16).
struct FirstTouch {
  Lattice<std::uint32_t> fine, coarse;
};

/// The motion of some links in a frame B that stands still while they move, by one parameter s in [0, range]. B is the
/// first node's frame at q = 0, so that fingers of one build share their fields.
struct Motion {
  static constexpr std::uint32_t kLastUnit = 0xFFFE;
  static constexpr std::uint32_t kNever = 0xFFFF;  // first = kNever, last = 0

  std::optional<Mover> mover;                              // nothing: the hand slides as a whole
  bool turns = true;                                       // the driver is revolute
  int baseLink = 0;                                        // B is fixed in this link
  Eigen::Isometry3d X_BP = Eigen::Isometry3d::Identity();  // of the base link
  double start = 0, direction = 1;                         // driver's position = start + direction s
  double range = 0;                                        // rad or m
  Eigen::Vector3d slideAxis = Eigen::Vector3d::Zero();     // in H, when the hand slides
  std::vector<std::pair<int, double>> heldJoints;          // that the fields take to be at these positions
  std::vector<MotionNode> nodes;
  std::vector<MotionLeaf> leaves;
  std::shared_ptr<const FirstTouch> field;
};

/// The intervals of z that the hand in one preshape covers above (x, y) of the palm frame, at most two, the higher one
/// first, for points within half a cell of a lattice node (fine) and for blocks within ObjectShell::kBlockRadius
/// (coarse).
struct ColumnField {
  static constexpr std::int32_t kNone = -0x7FFF8001;  // bottom > top: no interval

  /// Bottom in the low half, top in the high one, in units.
  Lattice<std::array<std::int32_t, 2>> intervals;
  float unit = 0;                                 // m
  std::array<std::vector<std::uint8_t>, 2> link;  // that ends the interval at its top
};

/// What a preshape fixes.
struct PreshapeFields {
  ColumnField fine, coarse;
  ColumnField inner;  // what is covered for sure, for all points within half a cell
  std::vector<Eigen::Isometry3d> X_HL;
  Eigen::Isometry3d X_GH;
  std::vector<Eigen::Isometry3d> X_LG;  // by link
  std::vector<Placement> fromPalm;      // X_LG
  /// Indices into HandFields::motions for each closing step; -1: none.
  struct Step {
    std::array<int, 4> motion = {-1, -1, -1, -1};  // by ClosingPart
    int counterpart = -1;
  };
  std::vector<Step> steps;
  std::vector<Eigen::Vector3d> partPoints;  // in H, one of each part of the hand that hangs together
  std::vector<std::pair<int, int>> apart;   // link pairs that are apart here and must stay so
};

/// What the fast policy knows of a hand before it sees an object: distances around each link, what each preshape
/// covers, what each closing motion touches when. Built once for a hand, for all objects and workers.
/// @note Immutable; safe from many threads.
class HandFields {
 public:
  /// @throws Cancelled  soon after `cancel` became true
  HandFields(const Hand& hand, const JobSystem& jobs, const std::atomic<bool>* cancel);

  std::vector<int> links;                              // with geometry
  std::vector<std::shared_ptr<const LinkGrid>> grids;  // by link, null without geometry; equal links share theirs
  std::vector<SphereTree> covers;                      // by link: spheres around its surface
  LinkModels models;
  std::vector<ClosingStep> steps;
  std::vector<Motion> motions;
  std::vector<PreshapeFields> preshapes;

 private:
  void makeGrids(const Hand& hand, const JobSystem& jobs, const std::atomic<bool>* cancel);
  /// The index of the motion; known ones are not added again.
  int addMotion(Motion motion, const Eigen::VectorXd& q);
  /// What needs no table: postures and motions.
  void addPreshape(const Hand& hand, const Preshape& shape);
};

}  // namespace handhold
