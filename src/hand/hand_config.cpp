#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/yaml.h"
#include "hand/hand.h"
#include "hand/urdf_reader.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr double kLimitSlack = 1e-6;  // decimals in a YAML file may overstep a limit by their rounding

int linkIndex(const Hand& hand, const YamlValue& value) {
  const std::string name = value.text();
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    if (hand.links[i].name == name) return static_cast<int>(i);
  }
  std::vector<std::string> names;
  for (const Link& link : hand.links) names.push_back(link.name);
  value.refuse(fmt::format("a link of the hand: {}", fmt::join(names, ", ")));
}

int jointIndex(const Hand& hand, const std::string& name, const YamlValue& value) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    if (hand.joints[i].name == name) return static_cast<int>(i);
    names.push_back(hand.joints[i].name);
  }
  value.fail(fmt::format("names the joint \"{}\", want a moving joint of the hand: {}", name, fmt::join(names, ", ")));
}

/// How far a joint may be from 0 where the hand moves it, whatever its limits. [rad or m]
double farthest(const Joint& joint) {
  constexpr double kMostTurn = 100;
  return joint.type == JointType::prismatic ? kFarthest : kMostTurn;
}

Eigen::Vector3d readPoint(const YamlValue& value) {
  const Eigen::Vector3d point = value.vector3();
  if (point.cwiseAbs().maxCoeff() > kFarthest) {
    value.refuse(fmt::format("three numbers of metres from {} to {}", -kFarthest, kFarthest));
  }
  return point;
}

void readPalm(const YamlValue& palm, Hand& hand) {
  palm.allowKeys({"link", "position", "approach", "closing"});
  hand.palmLink = linkIndex(hand, palm.require("link"));
  const Eigen::Vector3d approach = palm.require("approach").direction();
  const Eigen::Vector3d closing = palm.require("closing").direction();
  if (std::abs(approach.dot(closing)) > 1e-3) palm.fail("has approach and closing that are not perpendicular");
  hand.X_LG.linear().col(2) = approach;
  hand.X_LG.linear().col(1) = approach.cross(closing).normalized();
  hand.X_LG.linear().col(0) = hand.X_LG.linear().col(1).cross(approach);
  hand.X_LG.translation() = readPoint(palm.require("position"));
}

/// Every independent joint that is not named is at 0, which must be inside its limits.
Preshape readPreshape(const YamlValue& entry, const Hand& hand) {
  entry.allowKeys({"name", "joints", "standoff"});
  Preshape preshape;
  preshape.name = entry.require("name").text();
  if (const YamlValue* standoff = entry.find("standoff")) {
    preshape.standoff = standoff->numberAtLeast(0);
    if (preshape.standoff > kFarthest) standoff->refuse(fmt::format("at most {} m", kFarthest));
  }
  Eigen::VectorXd q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(hand.joints.size()));
  std::vector<bool> given(hand.joints.size(), false);
  for (const auto& [name, value] : entry.require("joints").entries()) {
    const int joint = jointIndex(hand, name, value);
    if (hand.joints[joint].mimicOf >= 0) {
      value.fail(fmt::format("sets a mimic joint, want the joint that it follows: {}",
                             hand.joints[hand.joints[joint].mimicOf].name));
    }
    q[joint] = value.number();
    given[joint] = true;
  }
  preshape.jointPosition = followMimics(hand, q);
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    const Joint& joint = hand.joints[i];
    const double position = preshape.jointPosition[i];
    const double lower = std::max(joint.lower, -farthest(joint)), upper = std::min(joint.upper, farthest(joint));
    if (position >= lower - kLimitSlack && position <= upper + kLimitSlack) continue;
    entry.fail(fmt::format("{} {} at {}, want it within {} .. {}",
                           joint.mimicOf >= 0 ? "puts the mimic joint"
                           : given[i]         ? "puts the joint"
                                              : "leaves the joint",
                           joint.name, position, lower, upper));
  }
  return preshape;
}

void readBreakaway(const YamlValue& value, const Hand& hand, ClosingJoint& closing) {
  closing.breakawayJoint = jointIndex(hand, value.text(), value);
  const std::vector<int> followers = followersOf(hand, closing.joint);
  const bool follows = std::find(followers.begin(), followers.end(), closing.breakawayJoint) != followers.end();
  if (!follows || !linksMovedBy(hand, closing.joint, false)[hand.joints[closing.breakawayJoint].childLink]) {
    value.refuse(fmt::format("a joint further out on the finger that mimics {}", hand.joints[closing.joint].name));
  }
}

ClosingJoint readClosing(const YamlValue& entry, const Hand& hand) {
  entry.allowKeys({"joint", "direction", "breakaway", "self_centering"});
  ClosingJoint closing;
  closing.joint = jointIndex(hand, entry.require("joint").text(), entry.require("joint"));
  const Joint& joint = hand.joints[closing.joint];
  if (joint.mimicOf >= 0) {
    entry.require("joint").fail(fmt::format("\"{}\" is a mimic joint, want the joint that it follows: {}", joint.name,
                                            hand.joints[joint.mimicOf].name));
  }
  closing.direction = entry.require("direction").integer(-1, 1);
  if (closing.direction == 0) entry.require("direction").refuse("1 or -1");
  const double limit = closing.direction > 0 ? joint.upper : joint.lower;
  if (!std::isfinite(limit)) {
    entry.fail(
        fmt::format("closes the joint {}, which has no limit in that direction, want one in the URDF", joint.name));
  }
  if (std::abs(limit) > farthest(joint)) {
    entry.fail(
        fmt::format("closes the joint {}, whose limit in that direction is {}, want one from {} to {} in the URDF",
                    joint.name, limit, -farthest(joint), farthest(joint)));
  }
  if (const YamlValue* breakaway = entry.find("breakaway")) readBreakaway(*breakaway, hand, closing);
  if (const YamlValue* centering = entry.find("self_centering")) closing.selfCentering = centering->boolean();
  if (closing.selfCentering) {
    const std::vector<int> sides = jawSides(hand, closing);
    const bool movesBoth = std::find(sides.begin(), sides.end(), 1) != sides.end() &&
                           std::find(sides.begin(), sides.end(), -1) != sides.end();
    if (!followersOf(hand, closing.joint).empty() && !isSlidingPair(hand, closing.joint) && !movesBoth) {
      entry.fail(
          "is self_centering, want a joint without mimics, or a prismatic one with one prismatic mimic of multiplier 1 "
          "or -1, or one whose mimics move links on both sides of the palm along its closing axis");
    }
  }
  return closing;
}

void readContactLinks(const YamlValue& value, Hand& hand) {
  if (value.kind() == YamlValue::Kind::scalar) {
    if (value.text() != "all") value.refuse("all, or a list of links");
    return;
  }
  for (Link& link : hand.links) link.contactAllowed = false;
  for (const YamlValue& item : value.items()) hand.links[linkIndex(hand, item)].contactAllowed = true;
}

void readContact(const YamlValue& contact, Hand& hand) {
  constexpr double kLargest = 0.1;  // m, of what a hand presses with
  contact.allowKeys({"model", "torsion_radius"});
  const YamlValue& model = contact.require("model");
  if (model.text() != "point" && model.text() != "soft_finger") model.refuse("point or soft_finger");
  if (model.text() == "point") {
    const YamlValue* radius = contact.find("torsion_radius");
    if (radius != nullptr) radius->fail("is given with model point, want it with soft_finger alone");
    return;
  }
  const YamlValue& radius = contact.require("torsion_radius");
  hand.torsionRadius = radius.number();
  if (hand.torsionRadius <= 0 || hand.torsionRadius > kLargest) {
    radius.refuse(fmt::format("a number of metres > 0 and at most {}", kLargest));
  }
}

void readPreshapes(const YamlValue& list, Hand& hand) {
  for (const YamlValue& entry : list.items()) {
    hand.preshapes.push_back(readPreshape(entry, hand));
    const auto sameName = [&](const Preshape& p) { return p.name == hand.preshapes.back().name; };
    if (std::count_if(hand.preshapes.begin(), hand.preshapes.end(), sameName) > 1) {
      entry.require("name").refuse("a name that no other preshape has");
    }
  }
  if (hand.preshapes.empty()) list.refuse("at least one preshape");
}

void requireGeometry(const Hand& hand, const YamlValue& top) {
  for (const Link& link : hand.links) {
    if (!link.mesh.triangles.empty() && link.contactAllowed) return;
  }
  top.fail("describes a hand without any geometry that may touch");
}

void refuseUnknownKeys(const YamlValue& top) {
  top.allowKeys(
      {"urdf", "root_link", "palm", "tcp", "preshapes", "closing", "contact_links", "ignore_links", "contact"});
}

/// Empty: the URDF's own root.
std::string rootLinkOf(const YamlValue& top) {
  const YamlValue* rootLink = top.find("root_link");
  return rootLink == nullptr ? "" : rootLink->text();
}

/// What hand.yaml says of the links and joints that are there already; the hash of it all.
void configure(const YamlValue& top, Hand& hand) {
  readPalm(top.require("palm"), hand);
  if (const YamlValue* tcp = top.find("tcp")) {
    tcp->allowKeys({"link", "position"});
    hand.tcpLink = linkIndex(hand, tcp->require("link"));
    hand.p_LT = readPoint(tcp->require("position"));
  } else {
    hand.tcpLink = hand.palmLink;
    hand.p_LT = hand.X_LG.translation();
  }
  readPreshapes(top.require("preshapes"), hand);
  for (const YamlValue& entry : top.require("closing").items()) {
    hand.closing.push_back(readClosing(entry, hand));
    const auto sameJoint = [&](const ClosingJoint& c) { return c.joint == hand.closing.back().joint; };
    if (std::count_if(hand.closing.begin(), hand.closing.end(), sameJoint) > 1) {
      entry.require("joint").refuse("a joint that no other entry closes");
    }
  }
  const auto isCoupled = [&](const ClosingJoint& c) {
    return c.selfCentering && !followersOf(hand, c.joint).empty() && !isSlidingPair(hand, c.joint);
  };
  if (hand.closing.size() > 1 && std::any_of(hand.closing.begin(), hand.closing.end(), isCoupled)) {
    top.require("closing").fail("has a self_centering joint with coupled jaws beside others, want it alone");
  }
  if (hand.closing.empty()) top.require("closing").refuse("at least one joint that closes");
  if (const YamlValue* contactLinks = top.find("contact_links")) readContactLinks(*contactLinks, hand);
  if (const YamlValue* contact = top.find("contact")) readContact(*contact, hand);
  requireGeometry(hand, top);

  ContentHash hash;
  hash.addText(hand.contentHash);  // of the meshes
  hash.addText(hand.urdfText);
  hash.addText(hand.configText);
  hand.contentHash = hash.hex();
}

}  // namespace

Hand loadHand(const std::string& path, const PackagePaths& packages) {
  const fs::path file = fs::is_directory(path) ? fs::path(path) / "hand.yaml" : fs::path(path);
  if (!fs::exists(file))
    throw InputError(fmt::format("{}: does not exist, want a hand's folder with hand.yaml", file.string()));
  Hand hand;
  hand.configText = readFile(file);
  const YamlValue top = YamlValue::parseText(hand.configText, file.string());
  refuseUnknownKeys(top);
  hand.name = fs::absolute(file).lexically_normal().parent_path().filename().string();
  requireName(hand.name, file.string(), "the hand's folder");

  const YamlValue& urdf = top.require("urdf");
  const std::string urdfPath = (file.parent_path() / expandEnvironment(urdf.text(), urdf.where())).lexically_normal();
  if (!fs::exists(urdfPath))
    urdf.refuse("the path of a URDF file, relative to hand.yaml (looked for " + urdfPath + ")");
  const YamlValue* ignoreLinks = top.find("ignore_links");
  readUrdf(urdfPath, rootLinkOf(top), ignoreLinks == nullptr ? std::vector<std::string>{} : ignoreLinks->texts(),
           packages, hand);
  configure(top, hand);
  return hand;
}

Hand restoreHand(const std::string& name, const std::string& urdfText, const std::string& configText,
                 const std::vector<std::string>& linkNames, const std::vector<TriangleMesh>& linkMeshes) {
  Hand hand;
  hand.name = name;
  hand.configText = configText;
  std::map<std::string, TriangleMesh> meshes;
  for (std::size_t i = 0; i < std::min(linkNames.size(), linkMeshes.size()); ++i) meshes[linkNames[i]] = linkMeshes[i];
  const YamlValue top = YamlValue::parseText(configText, "the stored hand.yaml");
  refuseUnknownKeys(top);
  readStoredUrdf(urdfText, rootLinkOf(top), meshes, hand);
  configure(top, hand);
  return hand;
}

void choosePreshapes(Hand& hand, const std::vector<std::string>& names) {
  std::vector<Preshape> chosen;
  for (const std::string& name : names) {
    const auto it =
        std::find_if(hand.preshapes.begin(), hand.preshapes.end(), [&](const auto& p) { return p.name == name; });
    if (it != hand.preshapes.end()) chosen.push_back(*it);
  }
  hand.preshapes = std::move(chosen);
}

bool isSlidingPair(const Mechanism& mechanism, int joint) {
  const std::vector<int> followers = followersOf(mechanism, joint);
  const auto slides = [&](int j) { return mechanism.joints[j].type == JointType::prismatic; };
  return followers.size() == 1 && slides(joint) && slides(followers[0]) &&
         std::abs(std::abs(mechanism.joints[followers[0]].mimicMultiplier) - 1) < 1e-9;
}

std::vector<int> jawSides(const Hand& hand, const ClosingJoint& closing) {
  const std::vector<Eigen::Isometry3d> X_HL = forwardKinematics(hand, hand.preshapes[0].jointPosition);
  const Eigen::Isometry3d X_GH = (X_HL[hand.palmLink] * hand.X_LG).inverse();
  const std::vector<bool> moves = linksMovedBy(hand, closing.joint, true);
  std::vector<int> sides(hand.links.size(), 0);
  for (std::size_t i = 0; i < sides.size(); ++i) {
    if (!moves[i] || hand.links[i].mesh.triangles.empty()) continue;
    sides[i] = (X_GH * X_HL[i] * boundingBox(hand.links[i].mesh).center()).x() < 0 ? -1 : 1;
  }
  return sides;
}

std::vector<int> fixingJoints(const Hand& hand) {
  std::vector<int> joints = independentJoints(hand);
  for (const ClosingJoint& closing : hand.closing) {
    if (closing.breakawayJoint >= 0) joints.push_back(closing.breakawayJoint);
  }
  return joints;
}

}  // namespace handhold
