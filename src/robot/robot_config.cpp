#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/yaml.h"
#include "hand/urdf_reader.h"
#include "robot/neighbours.h"
#include "robot/robot.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr double kLimitSlack = 1e-6;        // decimals in a YAML file may overstep a limit by their rounding
constexpr double kSameHand = 1e-4;          // m, and of directions: the hand's own URDF against the robot's
constexpr double kDefaultVelocity = 1;      // rad/s or m/s
constexpr double kDefaultAcceleration = 2;  // rad/s^2 or m/s^2

/// An arm as it is read, before the hands are put on.
struct ArmEntry {
  const YamlValue* yaml;
  bool putOn;  // the hand is no part of the URDF
};

template <typename Items>
int indexOf(const Items& items, const std::string& name) {
  const auto it = std::find_if(items.begin(), items.end(), [&](const auto& item) { return item.name == name; });
  return it == items.end() ? -1 : static_cast<int>(it - items.begin());
}

template <typename Items>
std::string namesOf(const Items& items) {
  std::vector<std::string> names;
  names.reserve(items.size());
  for (const auto& item : items) names.push_back(item.name);
  return fmt::format("{}", fmt::join(names, ", "));
}

int linkIndex(const Mechanism& body, const YamlValue& value) {
  const int index = indexOf(body.links, value.text());
  if (index < 0) value.refuse("a link of the robot: " + namesOf(body.links));
  return index;
}

int jointIndex(const Mechanism& body, const std::string& name, const YamlValue& value) {
  const int index = indexOf(body.joints, name);
  if (index < 0) value.fail("names no joint of the robot, want one of: " + namesOf(body.joints));
  return index;
}

/// The moving joints between two links, from base to tip.
std::vector<int> jointsBetween(const Mechanism& body, int base, int tip, const YamlValue& yaml) {
  std::vector<int> joints;
  for (int link = tip; link != base; link = body.links[link].parentLink) {
    if (link < 0) {
      yaml.require("tip_link")
          .refuse(fmt::format("a link that hangs on base_link {}", yaml.require("base_link").text()));
    }
    if (body.links[link].joint >= 0) joints.push_back(body.links[link].joint);
  }
  if (joints.empty()) {
    yaml.require("tip_link")
        .refuse(fmt::format("a link that joints move against base_link {}", yaml.require("base_link").text()));
  }
  for (const int joint : joints) {
    if (body.joints[joint].mimicOf < 0) continue;
    yaml.require("tip_link")
        .fail(fmt::format("hangs on the mimic joint {}, want an arm of joints that move by themselves",
                          body.joints[joint].name));
  }
  std::reverse(joints.begin(), joints.end());
  return joints;
}

bool hangsOn(const Mechanism& body, int link, int ancestor) {
  while (link > ancestor) link = body.links[link].parentLink;
  return link == ancestor;
}

/// The hand's links and joints where the URDF already has them, below the tip.
void findHand(const Mechanism& body, const YamlValue& yaml, int handRoot, Arm& arm) {
  const YamlValue& value = yaml.require("hand");
  if (const YamlValue* mount = yaml.find("mount")) {
    mount->fail(fmt::format("is given, but the URDF has the hand's root link {} below {}, want no mount",
                            arm.hand.links[0].name, body.links[arm.tipLink].name));
  }
  for (int link = handRoot; link != arm.tipLink; link = body.links[link].parentLink) {
    if (body.links[link].joint < 0) continue;
    value.fail(fmt::format("hangs on the joint {} beyond tip_link, want a hand that is fixed to it",
                           body.joints[body.links[link].joint].name));
  }
  for (const Link& link : arm.hand.links) {
    arm.handLinks.push_back(indexOf(body.links, link.name));
    if (arm.handLinks.back() < 0 || !hangsOn(body, arm.handLinks.back(), handRoot)) {
      value.fail(fmt::format("has a link {} that the URDF does not have below {}", link.name, arm.hand.links[0].name));
    }
  }
  for (const Joint& joint : arm.hand.joints) {
    arm.handJoints.push_back(indexOf(body.joints, joint.name));
    if (arm.handJoints.back() < 0 || !hangsOn(body, body.joints[arm.handJoints.back()].childLink, handRoot)) {
      value.fail(
          fmt::format("has a joint {} that the URDF does not have below {}", joint.name, arm.hand.links[0].name));
    }
  }
  const auto X_HL = forwardKinematics(arm.hand, Eigen::VectorXd::Zero(arm.handJoints.size()));
  const auto X_BL = forwardKinematics(body, Eigen::VectorXd::Zero(body.joints.size()));
  for (std::size_t i = 0; i < X_HL.size(); ++i) {
    if (((X_BL[handRoot] * X_HL[i]).matrix() - X_BL[arm.handLinks[i]].matrix()).cwiseAbs().maxCoeff() < kSameHand)
      continue;
    value.fail(
        fmt::format("has its link {} in another place than the URDF, want the same hand", arm.hand.links[i].name));
  }
  arm.X_TH = X_BL[arm.tipLink].inverse() * X_BL[handRoot];
}

ArmEntry readArm(const YamlValue& yaml, const fs::path& folder, const PackagePaths& packages, const Mechanism& body,
                 Arm& arm) {
  yaml.allowKeys({"name", "base_link", "tip_link", "hand", "mount"});
  arm.name = yaml.require("name").text();
  requireName(arm.name, yaml.require("name").where(), yaml.require("name").key());
  arm.baseLink = linkIndex(body, yaml.require("base_link"));
  arm.tipLink = linkIndex(body, yaml.require("tip_link"));
  arm.joints = jointsBetween(body, arm.baseLink, arm.tipLink, yaml);
  const YamlValue& hand = yaml.require("hand");
  const std::string path = (folder / expandEnvironment(hand.text(), hand.where())).lexically_normal();
  if (!fs::exists(path)) {
    hand.refuse(fmt::format("the folder of a hand, relative to the robot's file (looked for {})", path));
  }
  arm.hand = loadHand(path, packages);
  const int handRoot = indexOf(body.links, arm.hand.links[0].name);
  const bool included = handRoot >= 0 && hangsOn(body, handRoot, arm.tipLink);
  if (included) {
    findHand(body, yaml, handRoot, arm);
  } else if (const YamlValue* mount = yaml.find("mount")) {
    arm.X_TH = mount->pose();
  } else {
    yaml.fail(fmt::format("has no mount, and the URDF has no link {} at or below {}, want one of the two",
                          arm.hand.links[0].name, body.links[arm.tipLink].name));
  }
  return {&yaml, !included};
}

/// Appends the hand's links and joints to the body.
void putOn(const std::map<std::string, int>& uses, const YamlValue& yaml, Arm& arm, Mechanism& body) {
  const auto freeName = [&](const std::string& name, const auto& items) {
    const std::string result = uses.at(name) == 1 ? name : arm.name + "_" + name;
    if (indexOf(items, result) >= 0) {
      yaml.require("name").fail(fmt::format("would call a part of the hand {}, a name that the robot has", result));
    }
    return result;
  };
  const int firstLink = static_cast<int>(body.links.size()), firstJoint = static_cast<int>(body.joints.size());
  for (Link link : arm.hand.links) {
    arm.handLinks.push_back(static_cast<int>(body.links.size()));
    link.name = freeName(link.name, body.links);
    if (link.parentLink < 0) {
      link.parentLink = arm.tipLink;
      link.X_PL = arm.X_TH;
    } else {
      link.parentLink += firstLink;
    }
    if (link.joint >= 0) link.joint += firstJoint;
    body.links.push_back(std::move(link));
  }
  for (Joint joint : arm.hand.joints) {
    arm.handJoints.push_back(static_cast<int>(body.joints.size()));
    joint.name = freeName(joint.name, body.joints);
    joint.parentLink += firstLink;
    joint.childLink += firstLink;
    if (joint.mimicOf >= 0) joint.mimicOf += firstJoint;
    body.joints.push_back(std::move(joint));
  }
}

/// How often each name of a link or joint occurs in the URDF and in the hands that are put on.
std::map<std::string, int> countNames(const Robot& robot, const std::vector<ArmEntry>& entries) {
  std::map<std::string, int> uses;
  const auto count = [&](const Mechanism& mechanism) {
    std::set<std::string> names;  // a joint may be called as a link is
    for (const Link& link : mechanism.links) names.insert(link.name);
    for (const Joint& joint : mechanism.joints) names.insert(joint.name);
    for (const std::string& name : names) ++uses[name];
  };
  count(robot.body);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (entries[i].putOn) count(robot.arms[i].hand);
  }
  return uses;
}

void readArms(const YamlValue& list, const fs::path& folder, const PackagePaths& packages, Robot& robot) {
  std::vector<ArmEntry> entries;
  for (const YamlValue& yaml : list.items()) {
    robot.arms.emplace_back();
    entries.push_back(readArm(yaml, folder, packages, robot.body, robot.arms.back()));
    if (findArm(robot, robot.arms.back().name) + 1 < static_cast<int>(robot.arms.size())) {
      yaml.require("name").refuse("a name that no other arm has");
    }
  }
  if (robot.arms.empty()) list.refuse("at least one arm");
  for (std::size_t i = 0; i < robot.arms.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (robot.arms[i].tipLink == robot.arms[j].tipLink) {
        entries[i]
            .yaml->require("tip_link")
            .refuse(fmt::format("a link that carries no other hand (arm {} has it)", robot.arms[j].name));
      }
    }
  }
  const std::map<std::string, int> uses = countNames(robot, entries);
  for (std::size_t i = 0; i < robot.arms.size(); ++i) {
    if (entries[i].putOn) putOn(uses, *entries[i].yaml, robot.arms[i], robot.body);
  }
}

/// Joints that are not named stand at 0, or in the middle of limits that do not hold it.
void readHome(const YamlValue* home, Robot& robot) {
  const Mechanism& body = robot.body;
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.joints.size());
  for (std::size_t i = 0; i < body.joints.size(); ++i) {
    const Joint& joint = body.joints[i];
    if (joint.lower > 0 || joint.upper < 0) q[i] = (joint.lower + joint.upper) / 2;
  }
  if (home != nullptr) {
    for (const auto& [name, value] : home->entries()) {
      const int index = jointIndex(body, name, value);
      const Joint& joint = body.joints[index];
      if (joint.mimicOf >= 0) {
        value.fail(
            fmt::format("sets a mimic joint, want the joint that it follows: {}", body.joints[joint.mimicOf].name));
      }
      const double position = value.number();
      if (!(position >= joint.lower - kLimitSlack && position <= joint.upper + kLimitSlack)) {
        value.refuse(fmt::format("a position within the joint's limits {} .. {}", joint.lower, joint.upper));
      }
      q[index] = std::clamp(position, joint.lower, joint.upper);
    }
  }
  robot.home = followMimics(body, std::move(q));
}

/// One number for all joints, or one for each joint that is named.
Eigen::VectorXd readSpeeds(const YamlValue* value, double otherwise, const Mechanism& body) {
  Eigen::VectorXd speeds = Eigen::VectorXd::Constant(body.joints.size(), otherwise);
  if (value == nullptr) return speeds;
  if (value->kind() != YamlValue::Kind::map) {
    speeds.setConstant(value->positiveNumber());
    return speeds;
  }
  for (const auto& [name, speed] : value->entries()) speeds[jointIndex(body, name, speed)] = speed.positiveNumber();
  return speeds;
}

void readAllowedCollisions(const YamlValue* list, Robot& robot) {
  std::set<std::pair<int, int>> pairs;
  for (const auto& pair : neighbouringLinks(robot.body)) pairs.insert(pair);
  if (list != nullptr) {
    for (const YamlValue& entry : list->items()) {
      if (entry.kind() != YamlValue::Kind::sequence || entry.items().size() != 2) entry.refuse("two links [A, B]");
      const int a = linkIndex(robot.body, entry.items()[0]), b = linkIndex(robot.body, entry.items()[1]);
      if (a == b) entry.fail("names one link twice, want two links");
      pairs.emplace(std::min(a, b), std::max(a, b));
    }
  }
  robot.allowedCollisions.assign(pairs.begin(), pairs.end());
}

/// A range [low, high].
std::array<double, 2> readRange(const YamlValue& value) {
  if (value.items().size() != 2 || !(value.items()[0].number() <= value.items()[1].number())) {
    value.fail("is no range, want [low, high]");
  }
  return {value.items()[0].number(), value.items()[1].number()};
}

Workspace readWorkspace(const YamlValue& yaml, const Robot& robot) {
  yaml.allowKeys({"base", "table", "x", "y", "arm"});
  Workspace workspace;
  if (const YamlValue* base = yaml.find("base")) workspace.X_WB = base->pose();
  const YamlValue& table = yaml.require("table");
  table.allowKeys({"size", "position"});
  workspace.tableSize = table.require("size").vector3();
  if (!(workspace.tableSize.minCoeff() > 0)) table.require("size").refuse("three numbers > 0");
  workspace.tablePosition = table.require("position").vector3();
  workspace.x = readRange(yaml.require("x"));
  workspace.y = readRange(yaml.require("y"));
  if (const YamlValue* arm = yaml.find("arm")) {
    workspace.arm = arm->text();
    if (findArm(robot, workspace.arm) < 0) arm->refuse("an arm of the robot: " + namesOf(robot.arms));
  }
  return workspace;
}

void readScore(const YamlValue& score, ScoreCoefficients& result) {
  score.allowKeys({"c1", "c2", "c3", "far"});
  if (const YamlValue* c = score.find("c1")) result.c1 = c->numberAtLeast(0);
  if (const YamlValue* c = score.find("c2")) result.c2 = c->numberAtLeast(0);
  if (const YamlValue* c = score.find("c3")) result.c3 = c->numberAtLeast(0);
  if (const YamlValue* far = score.find("far")) result.far = far->positiveNumber();
}

std::string robotName(const fs::path& file) {
  const std::string folder = fs::absolute(file).lexically_normal().parent_path().filename().string();
  return file.stem() == "robot" ? folder : folder + "_" + file.stem().string();
}

void noteArms(Robot& robot) {
  robot.notes = robot.body.notes;
  for (const Arm& arm : robot.arms) {
    std::vector<std::string> joints;
    for (const int joint : arm.joints) joints.push_back(robot.body.joints[joint].name);
    robot.notes.push_back(
        fmt::format("arm {} moves {} with the hand {}", arm.name, fmt::join(joints, ", "), arm.hand.name));
  }
}

}  // namespace

Robot loadRobot(const std::string& path, const PackagePaths& packages) {
  const fs::path file = fs::is_directory(path) ? fs::path(path) / "robot.yaml" : fs::path(path);
  if (!fs::exists(file)) {
    throw InputError(fmt::format("{}: does not exist, want a robot's folder with robot.yaml", file.string()));
  }
  return parseRobot(readFile(file), file.string(), packages);
}

Robot parseRobot(const std::string& configText, const std::string& path, const PackagePaths& packages) {
  const fs::path file(path);
  Robot robot;
  const YamlValue top = YamlValue::parseText(configText, file.string());
  top.allowKeys({"urdf", "arms", "home", "max_velocity", "max_acceleration", "clearance", "allowed_collisions", "score",
                 "workspace"});
  robot.name = robotName(file);
  requireName(robot.name, file.string(), "the robot's folder");

  const YamlValue& urdf = top.require("urdf");
  const std::string urdfPath = (file.parent_path() / expandEnvironment(urdf.text(), urdf.where())).lexically_normal();
  if (!fs::exists(urdfPath)) {
    urdf.refuse(fmt::format("the path of a URDF file, relative to the robot's file (looked for {})", urdfPath));
  }
  readUrdf(urdfPath, "", {}, packages, robot.body);
  readArms(top.require("arms"), file.parent_path(), packages, robot);
  readHome(top.find("home"), robot);
  robot.maxVelocity = readSpeeds(top.find("max_velocity"), kDefaultVelocity, robot.body);
  for (std::size_t i = 0; i < robot.body.joints.size(); ++i) {
    const double limit = robot.body.joints[i].velocity;
    if (limit > 0) robot.maxVelocity[i] = std::min(robot.maxVelocity[i], limit);
  }
  robot.maxAcceleration = readSpeeds(top.find("max_acceleration"), kDefaultAcceleration, robot.body);
  if (const YamlValue* clearance = top.find("clearance")) robot.clearance = clearance->numberAtLeast(0);
  readAllowedCollisions(top.find("allowed_collisions"), robot);
  if (const YamlValue* score = top.find("score")) readScore(*score, robot.score);
  if (const YamlValue* workspace = top.find("workspace")) robot.workspace = readWorkspace(*workspace, robot);
  noteArms(robot);

  ContentHash hash;
  hash.addText(configText);
  hash.addText(robot.body.urdfText);
  hash.addText(robot.body.contentHash);  // of the meshes
  for (const Arm& arm : robot.arms) hash.addText(arm.hand.contentHash);
  robot.contentHash = hash.hex();
  return robot;
}

int findArm(const Robot& robot, const std::string& name) { return indexOf(robot.arms, name); }

}  // namespace handhold
