#pragma once

#include "rank/grasp_table.h"
#include "robot/robot.h"

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A grasp of one arm with what speaks for it. Higher is better.
struct GraspScore {
  int arm = 0;
  std::uint32_t grasp = 0;       // row of the set
  float gq = 0, gb = 0, ge = 0;  // each 0 to 1 (gb of the paper's score: -1 to 1)
  double score = 0;
};

/// The score of Berenson et al. 2007, III:
///
///     G = exp(c1 Gq) exp(c2 Gb) exp(c3 Ge)                                                                     (1)
///     Gq = epsilon / largest epsilon of the set, or the probability that the grasp holds (GraspTable)
///     Gb = cos angle(P_d, c_O - s)                                                                             (2)
///     Ge = sum over the k neighbours of P_t of weight_i D_i / far                                              (3)
///
/// s is the arm's shoulder and c_O the object's centre of mass: from the shoulder Gb helps, from the robot's base it
/// hurts (measured). D is the distance map, clamped at `far`.
///
/// @param X_WO      pose of the target
/// @param p_WS      the arm's shoulder
/// @param D         (S) distance map of the table's points [m]
/// @param scores    one is appended for every grasp, in the table's order
/// @note  Const; safe from many threads.
void scorePaper(const GraspTable& table, int arm, const Eigen::Isometry3d& X_WO, const Eigen::Vector3d& p_WS,
                std::span<const float> D, const ScoreCoefficients& coefficients, std::vector<GraspScore>& scores);

/// Best first; equal scores keep the order of arms and of the stored grasps.
void sortScores(std::vector<GraspScore>& scores);

}  // namespace handhold
