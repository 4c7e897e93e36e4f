#pragma once

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
  double epsilonLower = 0, epsilonUpper = 0, criticalFriction = 0;  // on the true cone
  Eigen::VectorXd jointPosition;
  std::vector<Contact> contacts;
  double loadMargin = std::numeric_limits<double>::quiet_NaN();  // N, of the best by epsilon
};

/// Falling epsilon, ties by trial: the order of the database.
void sortGrasps(std::vector<KeptGrasp>& grasps);

/// Keeps at most `top` grasps of a sorted list: the best, or with `diverse` the best and then again and again the one
/// farthest from those kept, where the distance of two hand poses is |p - p'| + s * angle(R, R') with the object's
/// radius s [m]. The result is sorted again.
void keepGrasps(std::vector<KeptGrasp>& grasps, std::size_t top, bool diverse, double radius);

}  // namespace handhold
