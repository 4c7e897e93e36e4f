#pragma once

#include "build/robustness.h"
#include "quality/contact.h"

#include <cstdint>
#include <limits>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A force-closed grasp on its way into the database.
struct KeptGrasp {
  std::size_t trial = 0;  // index into N*R*M
  double epsilon = 0;
  Eigen::Isometry3d X_OH;
  double backoff = 0;
  bool approachClear = false;
  Eigen::VectorXd jointPosition;
  std::vector<Contact> contacts;
  Eigen::Vector3d centering = Eigen::Vector3d::Zero();  // m, how far a self-centring jaw moved the hand, in O

  // Of grasps that are kept (kept_quality.h).
  double epsilonLower = 0, epsilonUpper = 0, criticalFriction = 0;  // on the true cone
  double loadMargin = std::numeric_limits<double>::quiet_NaN();     // N, of the best by epsilon
  Proportion robustness{0, 0};                                      // of the best by epsilon, when the job asks
};

/// Falling epsilon, ties by trial: the order of the database.
void sortGrasps(std::vector<KeptGrasp>& grasps);

/// Keeps at most `top` grasps of a sorted list (0: all): the best, or with `diverse` the best and then again and again
/// the one farthest from those kept: farthestPoses of the hand poses, s the object's radius [m]. Stays sorted.
void keepGrasps(std::vector<KeptGrasp>& grasps, std::size_t top, bool diverse, double radius);

}  // namespace handhold
