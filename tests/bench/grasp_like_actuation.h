#pragma once

#include "bench/grasp_like_contacts.h"
#include "quality/load_margin.h"

#include <cmath>
#include <cstdint>
#include <numbers>

#include <Eigen/Geometry>

namespace handhold::bench {

/// Eight limits of a hand that holds graspLikeContacts: three fingers that bend about the bottle's axis, each with a
/// proximal joint (2.4 N m) and a distal one (1.1 N m) that moves every second of its contacts, and a spread joint (2 N
/// m) that moves two fingers, one of them as a follower with a limit of its own. The palm is not moved.
inline Actuation graspLikeActuation(const std::vector<Contact>& contacts, std::uint64_t seed) {
  constexpr double kBaseDegrees[] = {220, 255, 285};     // where the fingers leave the palm
  constexpr double kKnuckleDegrees[] = {130, 245, 295};  // thumb, two fingers
  constexpr double kEffort[] = {2.4, 1.1, 2.4, 1.1, 2.4, 1.1, 2, 2};
  const RandomStream stream = RandomStream(seed).child(contacts.size()).child(1);
  Actuation actuation;
  actuation.motion = Eigen::MatrixXd::Zero(6 * static_cast<Eigen::Index>(contacts.size()), 8);
  actuation.effort = Eigen::Map<const Eigen::VectorXd>(kEffort, 8);
  for (int d = 0; d < 8; ++d) {
    const int finger = d < 6 ? d / 2 : d - 5;  // of the spread: 1 and 2
    const bool isDistal = d < 6 && d % 2 == 1;
    const double degrees = isDistal ? kKnuckleDegrees[finger] : kBaseDegrees[finger];
    const double angle = degrees * std::numbers::pi / 180;
    const Eigen::Vector3d origin = (isDistal ? 0.05 : 0.07) * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0);
    const Eigen::Vector3d along = d < 6 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
    const std::uint64_t own = 10 * static_cast<std::uint64_t>(d);
    const Eigen::Vector3d axis = (along + 0.1 * testing::randomUnitVector(stream, own)).normalized();
    for (std::size_t i = 0; i < contacts.size(); ++i) {
      const int link = static_cast<int>(i % 4);  // 3: the palm
      const bool moves = link == finger && (!isDistal || i / 4 % 2 == 0);
      const bool follows = d == 6 && link == 2;
      if (!moves && !follows) continue;
      actuation.motion.block<3, 1>(6 * static_cast<Eigen::Index>(i), d) = (follows ? -1 : 1) * axis.cross(-origin);
      actuation.motion.block<3, 1>(6 * static_cast<Eigen::Index>(i) + 3, d) = (follows ? -1 : 1) * axis;
    }
  }
  return actuation;
}

/// The same with a limit of each contact's normal force [N], which is a joint that pushes along the normal.
inline Actuation withNormalLimits(Actuation actuation, const std::vector<Contact>& contacts, double limit) {
  const Eigen::Index joints = actuation.motion.cols(), n = static_cast<Eigen::Index>(contacts.size());
  actuation.motion.conservativeResize(6 * n, joints + n);
  actuation.motion.rightCols(n).setZero();
  actuation.effort.conservativeResize(joints + n);
  actuation.effort.tail(n).setConstant(limit);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Contact& contact = contacts[static_cast<std::size_t>(i)];
    actuation.motion.block<3, 1>(6 * i, joints + i) = contact.normal;
    actuation.motion.block<3, 1>(6 * i + 3, joints + i) = contact.position.cross(contact.normal);
  }
  return actuation;
}

}  // namespace handhold::bench
