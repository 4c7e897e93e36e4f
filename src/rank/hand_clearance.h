#pragma once

#include "hand/hand.h"
#include "scene/signed_distance.h"

#include <memory>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// An obstacle as distances see it.
struct ObstacleDistance {
  std::shared_ptr<const SignedDistance> distance;
  Eigen::Isometry3d X_WS = Eigen::Isometry3d::Identity();
};

/// Distance from a whole hand to obstacles, by points on its surface at most `spacing` apart: what lies between two
/// points is not seen, so this ranks and does not decide.
/// @note Immutable; safe from many threads.
class HandClearance {
 public:
  HandClearance(const Hand& hand, double spacing);

  /// The least distance [m] of any point of the hand to any obstacle, cut at `far`; the first value <= 0 found, when
  /// the hand reaches into one. @param X_HL  pose of every link in H (forwardKinematics)
  double operator()(const Eigen::Isometry3d& X_WH, const std::vector<Eigen::Isometry3d>& X_HL,
                    const std::vector<ObstacleDistance>& obstacles, double far) const;

 private:
  struct LinkPoints {
    int link = 0;
    Eigen::Vector3d center;  // of a ball around the points, in the link
    double radius = 0;       // m
    std::vector<Eigen::Vector3d> points;
  };
  std::vector<LinkPoints> links_;
};

}  // namespace handhold
