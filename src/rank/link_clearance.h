#pragma once

#include "hand/mechanism.h"
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

/// Distance from links to obstacles, by points on their surfaces at most `spacing` apart: what lies between two points
/// is not seen, so this ranks and does not decide.
/// @note Immutable; safe from many threads.
class LinkClearance {
 public:
  /// Of the links that `included` names (by link; all when empty).
  LinkClearance(const Mechanism& mechanism, double spacing, const std::vector<bool>& included = {});

  /// The least distance [m] of any point to any obstacle, cut at `far`; the first value <= 0 found, when a link reaches
  /// into one. @param X_WH  pose of the root link  @param X_HL  pose of every link in it (forwardKinematics)
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
