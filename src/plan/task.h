#pragma once

#include "core/random.h"
#include "robot/robot.h"
#include "scene/scene.h"

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Poses of an object: the origin of its frame in a box, its orientation turned.
struct Region {
  enum class Turn { none, yaw, any };                      // yaw: about the world's z; any: every orientation
  Eigen::Isometry3d X_WR = Eigen::Isometry3d::Identity();  // centre of the box; the orientation that is turned
  Eigen::Vector3d size = Eigen::Vector3d::Zero();          // m, full extents along the world's axes
  Turn turn = Turn::none;

  /// Uniform in box and turn, from the first numbers of a stream.
  Eigen::Isometry3d sample(const RandomStream& stream) const;
};

enum class TaskVerb { pick, carry, handOver, place, drop };
inline constexpr std::array<std::string_view, 5> kVerbNames = {"pick", "carry", "hand_over", "place", "drop"};

struct TaskStep {
  TaskVerb verb = TaskVerb::pick;
  std::size_t object = 0;    // of Task::objects
  int arm = -1;              // pick: -1 for any; hand over: the one that takes the object
  Region region;             // carry, hand over, place
  std::size_t into = 0;      // drop: obstacle of the scene, into which the object falls straight down, whole
  double releaseHeight = 0;  // drop: m, of the object's lowest point above the highest of `into`
};

/// Something that the robot handles.
struct TaskObject {
  std::string name, object;  // in the task, in the database
  Eigen::Isometry3d X_WO = Eigen::Isometry3d::Identity();
};

/// What `task --trials` draws anew for each scene.
struct TaskTrialsSettings {
  std::map<std::size_t, Region> objects;  // where an object stands, by its index
  std::size_t on = 0;                     // obstacle on which blocks stand
  int fewestBlocks = 3, mostBlocks = 5;
  double circle = 0.2;  // m, radius about an object on which their centres lie
};

/// Steps over a scene, as a task file says them. Every object is picked, carried and handed over as often as wanted,
/// and placed or dropped, in successive steps.
struct Task {
  Scene surroundings;  // without a target
  std::vector<TaskObject> objects;
  std::vector<TaskStep> steps;
  std::optional<TaskTrialsSettings> trials;
};

/// Reads a task file (jobs/tasks has two, explained). Meshes and clouds are relative to it.
/// @throws InputError  naming file, line and key
Task loadTask(const std::string& path, const Robot& robot, const ObjectMeshes& objectMeshes);

/// The same from a text; `file` is what messages name and relative paths belong to.
Task parseTask(const std::string& text, const std::string& file, const Robot& robot, const ObjectMeshes& objectMeshes);

}  // namespace handhold
