#include "plan/task.h"

#include "core/error.h"
#include "core/yaml.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

constexpr double kPi = std::numbers::pi;

/// A uniform rotation from three uniform numbers (Shoemake 1992).
Eigen::Quaterniond uniformRotation(double u, double v, double w) {
  const double a = std::sqrt(1 - u), b = std::sqrt(u);
  return {b * std::cos(2 * kPi * w), a * std::sin(2 * kPi * v), a * std::cos(2 * kPi * v), b * std::sin(2 * kPi * w)};
}

/// Index of the word among those that are allowed.
std::size_t choose(const YamlValue& value, const std::vector<std::string>& words, std::string_view wanted) {
  const auto at = std::find(words.begin(), words.end(), value.text());
  if (at == words.end()) {
    value.fail(fmt::format("is \"{}\", want {}: {}", value.text(), wanted, fmt::join(words, ", ")));
  }
  return static_cast<std::size_t>(at - words.begin());
}

Region readRegion(const YamlValue& value) {
  value.allowKeys({"position", "size", "orientation", "turn"});
  Region region;
  region.X_WR.translation() = value.require("position").vector3();
  if (const YamlValue* size = value.find("size")) {
    region.size = size->vector3();
    if (region.size.minCoeff() < 0) size->refuse("full extents [x, y, z] in metres >= 0");
  }
  if (const YamlValue* orientation = value.find("orientation")) {
    region.X_WR.linear() = orientation->rotation().toRotationMatrix();
  }
  if (const YamlValue* turn = value.find("turn")) {
    region.turn = static_cast<Region::Turn>(choose(*turn, {"none", "yaw", "any"}, "one of"));
  }
  return region;
}

class TaskReader {
 public:
  TaskReader(const YamlValue& top, const std::filesystem::path& file, const Robot& robot,
             const ObjectMeshes& objectMeshes)
      : top_(top), file_(file), robot_(robot), objectMeshes_(objectMeshes) {
    for (const Arm& arm : robot.arms) arms_.push_back(arm.name);
  }

  Task read() {
    top_.allowKeys({"robot", "obstacles", "objects", "steps", "trials"});
    task_.surroundings = readSurroundings(top_, file_, objectMeshes_);
    if (!task_.surroundings.joints) {
      top_.fail("has no robot.joints, want the present joint positions, or the word home");
    }
    if (!task_.surroundings.arm.empty()) {
      top_.require("robot").require("arm").fail("is given, want the arm with each pick");
    }
    for (const Obstacle& obstacle : task_.surroundings.obstacles) obstacles_.push_back(obstacle.name);
    for (const YamlValue& entry : top_.require("objects").items()) readObject(entry);
    const YamlValue& steps = top_.require("steps");
    for (const YamlValue& entry : steps.items()) readStep(entry);
    if (task_.steps.empty()) steps.fail("has no step, want some");
    if (held_) steps.fail(fmt::format("end with {} in a hand, want a place or drop of it", names_[*held_]));
    if (const YamlValue* trials = top_.find("trials")) readTrials(*trials);
    return std::move(task_);
  }

 private:
  void readObject(const YamlValue& entry) {
    entry.allowKeys({"name", "object", "pose"});
    TaskObject object;
    const YamlValue& stored = entry.require("object");
    const YamlValue* name = entry.find("name");
    object.object = stored.text();
    object.name = name != nullptr ? name->text() : object.object;
    object.X_WO = entry.require("pose").pose();
    for (const auto* known : {&names_, &obstacles_}) {
      if (std::find(known->begin(), known->end(), object.name) != known->end()) {
        (name != nullptr ? *name : stored)
            .fail(fmt::format("is \"{}\" for the second time, want every name once", object.name));
      }
    }
    try {
      objectMeshes_(object.object);
    } catch (const InputError& error) {
      stored.fail(fmt::format("is \"{}\": {}", object.object, error.what()));
    }
    names_.push_back(object.name);
    task_.objects.push_back(std::move(object));
  }

  /// The one key that says what is done.
  static TaskVerb verbOf(const YamlValue& entry) {
    std::optional<TaskVerb> verb;
    for (std::size_t i = 0; i < kVerbNames.size(); ++i) {
      const YamlValue* value = entry.find(std::string(kVerbNames[i]));
      if (value == nullptr) continue;
      if (verb) {
        value->fail(fmt::format("is given beside {}, want one a step", kVerbNames[static_cast<std::size_t>(*verb)]));
      }
      verb = static_cast<TaskVerb>(i);
    }
    if (!verb) entry.fail(fmt::format("says nothing to do, want one of: {}", fmt::join(kVerbNames, ", ")));
    return *verb;
  }

  static void allowKeys(const YamlValue& entry, TaskVerb verb) {
    switch (verb) {
      case TaskVerb::pick:
        return entry.allowKeys({"pick", "arm"});
      case TaskVerb::carry:
        return entry.allowKeys({"carry", "region"});
      case TaskVerb::handOver:
        return entry.allowKeys({"hand_over", "to", "region"});
      case TaskVerb::place:
        return entry.allowKeys({"place", "region"});
      case TaskVerb::drop:
        return entry.allowKeys({"drop", "into", "release_height"});
    }
  }

  void readStep(const YamlValue& entry) {
    TaskStep step;
    step.verb = verbOf(entry);
    allowKeys(entry, step.verb);
    const YamlValue& object = entry.require(std::string(kVerbNames[static_cast<std::size_t>(step.verb)]));
    step.object = choose(object, names_, "one of the objects");
    if (step.verb == TaskVerb::pick) {
      if (held_) object.fail(fmt::format("comes while {} is in a hand, want a place or drop first", names_[*held_]));
      if (gone_.contains(step.object)) object.fail(fmt::format("is \"{}\", which was dropped before", object.text()));
      held_ = step.object;
      if (const YamlValue* arm = entry.find("arm")) step.arm = static_cast<int>(choose(*arm, arms_, "an arm"));
      holder_ = step.arm;
    } else if (held_ != step.object) {
      object.fail(fmt::format("is \"{}\", which is in no hand there, want a pick of it first", object.text()));
    }
    if (step.verb == TaskVerb::handOver) {
      step.arm = static_cast<int>(choose(entry.require("to"), arms_, "an arm"));
      if (holder_ < 0) entry.fail("hands over from any arm, want the pick to say which");
      refuseSharedJoints(entry.require("to"), robot_.arms[holder_], robot_.arms[step.arm]);
      holder_ = step.arm;
    }
    if (step.verb == TaskVerb::drop) {
      step.into = choose(entry.require("into"), obstacles_, "one of the obstacles");
      step.releaseHeight = entry.require("release_height").numberAtLeast(0);
      gone_.insert(step.object);
    } else if (step.verb != TaskVerb::pick) {
      step.region = readRegion(entry.require("region"));
    }
    if (step.verb == TaskVerb::place || step.verb == TaskVerb::drop) held_.reset();
    task_.steps.push_back(step);
  }

  /// One arm moves at a time: what it moves may not move the other's hand.
  void refuseSharedJoints(const YamlValue& value, const Arm& giver, const Arm& taker) const {
    for (const int joint : giver.joints) {
      if (std::find(taker.joints.begin(), taker.joints.end(), joint) == taker.joints.end()) continue;
      value.fail(fmt::format("is \"{}\", which shares {} with {}, want arms that share no joint", taker.name,
                             robot_.body.joints[joint].name, giver.name));
    }
  }

  void readTrials(const YamlValue& value) {
    value.allowKeys({"objects", "blocks"});
    TaskTrialsSettings trials;
    for (const auto& [name, region] : value.require("objects").entries()) {
      const auto at = std::find(names_.begin(), names_.end(), name);
      if (at == names_.end()) region.fail(fmt::format("is none of the objects: {}", fmt::join(names_, ", ")));
      trials.objects[at - names_.begin()] = readRegion(region);
    }
    const YamlValue& blocks = value.require("blocks");
    blocks.allowKeys({"on", "fewest", "most", "circle"});
    trials.on = choose(blocks.require("on"), obstacles_, "one of the obstacles");
    if (const YamlValue* fewest = blocks.find("fewest")) trials.fewestBlocks = fewest->integer(0, 100);
    if (const YamlValue* most = blocks.find("most")) trials.mostBlocks = most->integer(0, 100);
    if (const YamlValue* circle = blocks.find("circle")) trials.circle = circle->positiveNumber();
    if (trials.mostBlocks < trials.fewestBlocks) {
      blocks.fail(fmt::format("want at least {} and at most {}", trials.fewestBlocks, trials.mostBlocks));
    }
    task_.trials = std::move(trials);
  }

  const YamlValue& top_;
  const std::filesystem::path& file_;
  const Robot& robot_;
  const ObjectMeshes& objectMeshes_;
  std::vector<std::string> arms_, obstacles_, names_;
  std::optional<std::size_t> held_;  // object in a hand so far
  int holder_ = -1;                  // arm of that hand; -1: any
  std::set<std::size_t> gone_;
  Task task_;
};

}  // namespace

Eigen::Isometry3d Region::sample(const RandomStream& stream) const {
  const auto u = [&](std::uint64_t i) { return stream.uniform(i); };
  Eigen::Isometry3d X = X_WR;
  X.translation() += size.cwiseProduct(Eigen::Vector3d(u(0) - 0.5, u(1) - 0.5, u(2) - 0.5));
  if (turn == Turn::yaw) {
    X.linear() = Eigen::AngleAxisd(2 * kPi * u(3), Eigen::Vector3d::UnitZ()).toRotationMatrix() * X_WR.linear();
  } else if (turn == Turn::any) {
    X.linear() = uniformRotation(u(3), u(4), u(5)).toRotationMatrix();
  }
  return X;
}

Task loadTask(const std::string& path, const Robot& robot, const ObjectMeshes& objectMeshes) {
  return TaskReader(YamlValue::parseFile(path), path, robot, objectMeshes).read();
}

Task parseTask(const std::string& text, const std::string& file, const Robot& robot, const ObjectMeshes& objectMeshes) {
  return TaskReader(YamlValue::parseText(text, file), file, robot, objectMeshes).read();
}

}  // namespace handhold
