#pragma once

#include "robot/robot.h"

#include <string>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// The joints that a plan of one arm moves: the arm's from base to tip, then those that fix its hand's posture. All
/// other joints of the robot stand still, mimic joints follow.
class ActiveJoints {
 public:
  ActiveJoints(const Robot& robot, int arm);

  Eigen::Index size() const { return static_cast<Eigen::Index>(joints_.size()); }
  Eigen::Index armSize() const { return armSize_; }
  const std::vector<int>& joints() const { return joints_; }  // of robot.body
  std::vector<std::string> names() const;

  /// The active part of a posture of the whole robot.
  Eigen::VectorXd pick(const Eigen::VectorXd& posture) const;
  /// The posture of the whole robot (J) with active joints at `q`, the others as in `rest`.
  Eigen::VectorXd posture(const Eigen::VectorXd& q, const Eigen::VectorXd& rest) const;
  /// The arm at `arm`, the hand's joints (of the hand, J of it) as given.
  Eigen::VectorXd join(const Eigen::VectorXd& arm, const Eigen::VectorXd& handPosition) const;
  /// All joints of the hand in their order, of a posture of the whole robot.
  Eigen::VectorXd handPosition(const Eigen::VectorXd& posture) const;

  Eigen::VectorXd lower() const;  // rad or m
  Eigen::VectorXd upper() const;

 private:
  const Robot& robot_;
  const Arm& arm_;
  Eigen::Index armSize_ = 0;
  std::vector<int> joints_;
  std::vector<int> inHand_;  // of the active joints behind the arm's: joint of the hand
};

}  // namespace handhold
