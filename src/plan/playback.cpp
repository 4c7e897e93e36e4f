#include "plan/playback.h"

#include "core/error.h"
#include "plan/active_joints.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::VectorXd;

bool holdsObject(const std::string& segment) { return segment == "lift" || segment == "carry" || segment == "lower"; }

std::size_t objectOf(const FiledMotion& motion, const std::vector<PlayedObject>& objects) {
  const auto found = std::find_if(objects.begin(), objects.end(),
                                  [&](const PlayedObject& object) { return object.name == motion.object; });
  if (found == objects.end()) throw InputError(fmt::format("the scene has no object {}", motion.object));
  return static_cast<std::size_t>(found - objects.begin());
}

/// The arm of a motion, whose joints must be those that the file has columns for.
int armOf(const FiledMotion& motion, const Robot& robot) {
  const int arm = findArm(robot, motion.arm);
  if (arm < 0) throw InputError(fmt::format("robot {} has no arm {}", robot.name, motion.arm));
  const std::vector<std::string> names = ActiveJoints(robot, arm).names();
  if (names != motion.jointNames) {
    throw InputError(fmt::format("arm {} of {} moves the joints {}, the trajectory {}", motion.arm, robot.name,
                                 fmt::join(names, " "), fmt::join(motion.jointNames, " ")));
  }
  return arm;
}

/// Plays motion after motion into one Playback.
class Player {
 public:
  Player(const Robot& robot, const Isometry3d& X_WB, VectorXd posture, const std::vector<PlayedObject>& objects,
         double step)
      : robot_(robot), X_WB_(X_WB), posture_(std::move(posture)), objects_(objects), step_(step) {
    for (const PlayedObject& object : objects) X_WO_.push_back(object.X_WO);
    playback_.droppedAt.resize(objects.size());
    addFrame(0, linkPoses(posture_));
  }

  void play(const FiledMotion& motion) {
    const int arm = armOf(motion, robot_);
    const std::size_t object = objectOf(motion, objects_);
    const ActiveJoints active(robot_, arm);
    const auto& points = motion.trajectory.points;
    const double start = playback_.time.back();
    for (const TrajectorySegment& segment : motion.trajectory.segments) {
      const auto tip = static_cast<std::size_t>(robot_.arms[static_cast<std::size_t>(arm)].tipLink);
      const auto X_WL = linkPoses(active.posture(points[segment.begin].position, posture_));
      const Isometry3d X_LO = X_WL[tip].inverse() * X_WO_[object];
      if (segment.name == "drop") playback_.droppedAt[object] = start + points[segment.begin].time;
      const double begin = points[segment.begin].time, duration = points[segment.end].time - begin;
      const auto frames = std::max(1.0, std::ceil(duration / step_));
      for (double k = 1; k <= frames && duration > 0; ++k) {
        const double t = k == frames ? points[segment.end].time : begin + duration * k / frames;
        const auto poses = linkPoses(active.posture(at(motion.trajectory, segment, t), posture_));
        if (holdsObject(segment.name)) X_WO_[object] = poses[tip] * X_LO;
        addFrame(start + t, poses);
      }
      playback_.segments.push_back(
          {segment.name, motion.step, motion.object, motion.arm, start + begin, start + points[segment.end].time});
    }
    posture_ = active.posture(points.back().position, posture_);
    if (motion.X_WO_after) X_WO_[object] = *motion.X_WO_after;
  }

  Playback take() { return std::move(playback_); }

 private:
  static VectorXd at(const Trajectory& trajectory, const TrajectorySegment& segment, double t) {
    std::size_t i = segment.begin;
    while (i + 1 < segment.end && trajectory.points[i + 1].time < t) ++i;
    return positionAt(trajectory, i, t);
  }

  std::vector<Isometry3d> linkPoses(const VectorXd& posture) const {
    std::vector<Isometry3d> poses = forwardKinematics(robot_.body, posture);
    for (Isometry3d& pose : poses) pose = X_WB_ * pose;
    return poses;
  }

  void addFrame(double time, std::vector<Isometry3d> X_WL) {
    playback_.time.push_back(time);
    playback_.X_WL.push_back(std::move(X_WL));
    playback_.X_WO.push_back(X_WO_);
  }

  const Robot& robot_;
  Isometry3d X_WB_;
  VectorXd posture_;
  const std::vector<PlayedObject>& objects_;
  double step_;  // s, between frames, at most
  std::vector<Isometry3d> X_WO_;
  Playback playback_;
};

}  // namespace

Playback playBack(const Robot& robot, const Isometry3d& X_WB, VectorXd posture,
                  const std::vector<PlayedObject>& objects, const std::vector<FiledMotion>& motions, double rate,
                  std::size_t mostFrames) {
  double duration = 0;
  for (const FiledMotion& motion : motions) duration += motion.trajectory.points.back().time;
  Player player(robot, X_WB, std::move(posture), objects,
                std::max(1 / rate, duration / static_cast<double>(mostFrames)));
  for (const FiledMotion& motion : motions) player.play(motion);
  return player.take();
}

}  // namespace handhold
