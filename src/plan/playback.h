#pragma once

#include "plan/plan_file.h"
#include "robot/robot.h"

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Something that the robot handles, before anything moves.
struct PlayedObject {
  std::string name;
  Eigen::Isometry3d X_WO = Eigen::Isometry3d::Identity();
};

/// Where everything is while motions run one after another.
struct Playback {
  struct Segment {
    std::string name, step, object, arm;
    double begin = 0, end = 0;  // s
  };
  std::vector<double> time;                          // (F) [s], from 0, rising
  std::vector<std::vector<Eigen::Isometry3d>> X_WL;  // (F, links of the robot)
  std::vector<std::vector<Eigen::Isometry3d>> X_WO;  // (F, objects)
  std::vector<std::optional<double>> droppedAt;      // (objects) [s]; from then on the object is not known
  std::vector<Segment> segments;
};

/// Plays the motions of a file: joint positions are the cubics between its points; an object moves with the tip link of
/// the arm in the segments lift, carry and lower, and stands where the file says when a motion has ended.
/// @param posture  (J) of the whole robot before the first motion
/// @param rate     frames a second, at most; fewer where more than `mostFrames` would be needed. Every point at which
///                 a segment ends is a frame
/// @throws InputError  an arm, joint or object that the robot or `objects` do not have
Playback playBack(const Robot& robot, const Eigen::Isometry3d& X_WB, Eigen::VectorXd posture,
                  const std::vector<PlayedObject>& objects, const std::vector<FiledMotion>& motions, double rate = 25,
                  std::size_t mostFrames = 3000);

}  // namespace handhold
