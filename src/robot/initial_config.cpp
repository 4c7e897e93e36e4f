#include "core/error.h"
#include "core/file.h"
#include "core/random.h"
#include "hand/urdf_reader.h"
#include "robot/neighbours.h"
#include "robot/robot.h"
#include "robot/touching_links.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <tinyxml.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

using LinkPair = std::pair<int, int>;

constexpr int kSamples = 1000;                 // postures for the pairs of links that touch
constexpr std::uint64_t kSampleStream = 0x73;  // their key
constexpr int kLongestFinger = 5;              // joints; what is longer is an arm

template <typename Items>
int indexOf(const Items& items, const std::string& name) {
  const auto it = std::find_if(items.begin(), items.end(), [&](const auto& item) { return item.name == name; });
  return it == items.end() ? -1 : static_cast<int>(it - items.begin());
}

/// What an SRDF says.
struct SemanticDescription {
  std::string homeName;  // empty: no group_state
  std::map<int, double> home;
  std::vector<LinkPair> disabled;
};

std::string attribute(const TiXmlElement& element, const char* name, const std::string& path) {
  const char* value = element.Attribute(name);
  if (value == nullptr) {
    throw InputError(fmt::format("{}:{}: <{}> has no attribute {}", path, element.Row(), element.Value(), name));
  }
  return value;
}

void readGroupState(const TiXmlElement& state, const std::string& path, const Mechanism& body,
                    SemanticDescription& result) {
  result.homeName = attribute(state, "name", path);
  for (const TiXmlElement* element = state.FirstChildElement("joint"); element != nullptr;
       element = element->NextSiblingElement("joint")) {
    const std::string name = attribute(*element, "name", path), value = attribute(*element, "value", path);
    const int joint = indexOf(body.joints, name);
    if (joint < 0) {
      throw InputError(fmt::format("{}:{}: group_state {} names the joint {}, want a moving joint of the URDF", path,
                                   element->Row(), result.homeName, name));
    }
    if (body.joints[joint].mimicOf >= 0) continue;  // it follows
    char* end = nullptr;
    const double position = std::strtod(value.c_str(), &end);
    const bool within = position >= body.joints[joint].lower && position <= body.joints[joint].upper;
    if (value.empty() || *end != '\0' || !within) {
      throw InputError(fmt::format("{}:{}: group_state {} puts the joint {} at {}, want a number within {} .. {}", path,
                                   element->Row(), result.homeName, name, value, body.joints[joint].lower,
                                   body.joints[joint].upper));
    }
    result.home[joint] = position;
  }
}

SemanticDescription readSrdf(const std::string& path, const Mechanism& body) {
  SemanticDescription result;
  if (path.empty()) return result;
  const std::string text = readFile(path);
  TiXmlDocument document;
  document.Parse(text.c_str());
  if (document.Error()) {
    throw InputError(
        fmt::format("{}:{}: is no valid SRDF: {}", path, std::max(1, document.ErrorRow()), document.ErrorDesc()));
  }
  const TiXmlElement* const robot = document.FirstChildElement("robot");
  if (robot == nullptr) throw InputError(fmt::format("{}: is no valid SRDF: has no <robot>", path));
  if (const TiXmlElement* state = robot->FirstChildElement("group_state")) readGroupState(*state, path, body, result);
  for (const TiXmlElement* element = robot->FirstChildElement("disable_collisions"); element != nullptr;
       element = element->NextSiblingElement("disable_collisions")) {
    int links[2];
    for (int i = 0; i < 2; ++i) {
      const std::string name = attribute(*element, i == 0 ? "link1" : "link2", path);
      links[i] = indexOf(body.links, name);
      if (links[i] >= 0) continue;
      throw InputError(fmt::format("{}:{}: disable_collisions names the link {}, want a link of the URDF", path,
                                   element->Row(), name));
    }
    if (links[0] != links[1]) result.disabled.emplace_back(std::min(links[0], links[1]), std::max(links[0], links[1]));
  }
  return result;
}

/// What looks like the arm and its hand.
struct Guess {
  std::vector<int> joints;  // from base to tip
  int baseLink = -1, tipLink = -1;
  int handRoot = -1;            // -1: no hand in the URDF
  std::vector<int> handJoints;  // independent ones
};

/// The most moving joints one below the other under each link.
std::vector<int> jointsBelow(const Mechanism& body) {
  std::vector<int> depth(body.links.size(), 0);
  for (std::size_t link = body.links.size() - 1; link > 0; --link) {
    const int through = depth[link] + (body.links[link].joint >= 0 ? 1 : 0);
    int& above = depth[body.links[link].parentLink];
    above = std::max(above, through);
  }
  return depth;
}

/// Links that fingers hang on: two moving joints or more right below, all of them with few joints further out.
std::vector<bool> likelyHands(const Mechanism& body) {
  const std::vector<int> depth = jointsBelow(body);
  std::vector<int> fingers(body.links.size(), 0), jointsAbove(body.links.size(), 0);
  for (std::size_t link = 1; link < body.links.size(); ++link) {
    const int parent = body.links[link].parentLink;
    jointsAbove[link] = jointsAbove[parent] + (body.links[link].joint >= 0 ? 1 : 0);
    if (body.links[link].joint >= 0) ++fingers[parent];
  }
  std::vector<bool> isHand(body.links.size());
  for (std::size_t link = 0; link < body.links.size(); ++link) {
    isHand[link] = fingers[link] >= 2 && depth[link] <= kLongestFinger && jointsAbove[link] > 0;
  }
  return isHand;
}

/// The links from the root to `link`.
std::vector<int> pathTo(const Mechanism& body, int link) {
  std::vector<int> path;
  for (; link >= 0; link = body.links[link].parentLink) path.push_back(link);
  std::reverse(path.begin(), path.end());
  return path;
}

/// The longest chain of independent joints from the root, up to a hand; of equally long ones the first.
Guess guessArm(const Mechanism& body, const std::string& path) {
  const std::vector<bool> isHand = likelyHands(body);
  Guess best;
  for (std::size_t end = 0; end < body.links.size(); ++end) {
    Guess guess;
    for (const int link : pathTo(body, static_cast<int>(end))) {
      const int joint = body.links[link].joint;
      if (guess.handRoot >= 0 || (joint >= 0 && body.joints[joint].mimicOf >= 0)) {
        guess.joints.clear();  // the path goes on into a hand: it is counted where it ends before
        break;
      }
      if (joint >= 0) {
        if (guess.joints.empty()) guess.baseLink = body.links[link].parentLink;
        guess.joints.push_back(joint);
        guess.tipLink = link;
      }
      if (isHand[link]) {
        guess.handRoot = link;
        if (joint < 0) guess.tipLink = body.links[link].parentLink;
      }
    }
    const bool better = guess.joints.size() > best.joints.size() ||
                        (guess.joints == best.joints && guess.handRoot >= 0 && best.handRoot < 0);
    if (better && !guess.joints.empty()) best = guess;
  }
  if (best.joints.empty()) {
    throw InputError(path + ": has no chain of moving joints that could be an arm, want a robot with an arm");
  }
  return best;
}

/// Without a hand in the URDF the tip is the last link of what is fixed to the chain's end, as long as it does not
/// branch.
void findFlange(const Mechanism& body, Guess& guess) {
  for (bool more = true; more;) {
    std::vector<int> children;
    for (std::size_t link = 1; link < body.links.size(); ++link) {
      if (body.links[link].parentLink == guess.tipLink) children.push_back(static_cast<int>(link));
    }
    more = children.size() == 1 && body.links[children[0]].joint < 0;
    if (more) guess.tipLink = children[0];
  }
}

void listHandJoints(const Mechanism& body, Guess& guess) {
  for (std::size_t j = 0; j < body.joints.size(); ++j) {
    int link = body.joints[j].parentLink;
    while (link > guess.handRoot) link = body.links[link].parentLink;
    if (link == guess.handRoot && body.joints[j].mimicOf < 0) guess.handJoints.push_back(static_cast<int>(j));
  }
}

/// Pairs of links, no neighbours, by whether they touch in the postures tried.
struct SampledPairs {
  std::vector<LinkPair> always, apart;  // in every posture; in some they do not
  int never = 0;
};

/// Random postures within the limits (continuous joints: one turn); each has its own stream.
SampledPairs sampleContacts(const Mechanism& body, const TouchingLinks& models) {
  const auto neighbours = neighbouringLinks(body);
  struct Undecided {
    LinkPair links;
    bool touched = false, apart = false;
  };
  std::vector<Undecided> pairs;
  for (int b = 0; b < static_cast<int>(body.links.size()); ++b) {
    for (int a = 0; a < b; ++a) {
      const bool solid = !body.links[a].mesh.triangles.empty() && !body.links[b].mesh.triangles.empty();
      const LinkPair pair(a, b);
      if (solid && std::find(neighbours.begin(), neighbours.end(), pair) == neighbours.end()) pairs.push_back({pair});
    }
  }
  std::vector<Eigen::Isometry3d> X_BL;
  for (int sample = 0; sample < kSamples; ++sample) {
    const RandomStream stream = RandomStream(kSampleStream).child(static_cast<std::uint64_t>(sample));
    Eigen::VectorXd q(static_cast<Eigen::Index>(body.joints.size()));
    for (Eigen::Index j = 0; j < q.size(); ++j) {
      const Joint& joint = body.joints[j];
      const bool limited = std::isfinite(joint.upper - joint.lower);
      const double lower = limited ? joint.lower : -std::numbers::pi, upper = limited ? joint.upper : std::numbers::pi;
      q[j] = lower + (upper - lower) * stream.uniform(static_cast<std::uint64_t>(j));
    }
    forwardKinematics(body, followMimics(body, q), X_BL);
    for (Undecided& pair : pairs) {
      if (pair.touched && pair.apart) continue;
      (models.touch(pair.links.first, pair.links.second, X_BL) ? pair.touched : pair.apart) = true;
    }
  }
  SampledPairs sampled;
  for (const Undecided& pair : pairs) {
    (pair.apart ? sampled.apart : sampled.always).push_back(pair.links);
    if (!pair.touched) ++sampled.never;
  }
  return sampled;
}

std::string armText(const std::string& urdfName, const Mechanism& body, const Guess& guess) {
  std::vector<std::string> joints, fingers;
  for (const int joint : guess.joints) joints.push_back(body.joints[joint].name);
  for (const int joint : guess.handJoints) fingers.push_back(body.joints[joint].name);
  std::string text = fmt::format("arms:\n  # Guessed: the longest chain of moving joints that are no hand's ({}).\n",
                                 fmt::join(joints, ", "));
  std::string mount;
  if (guess.handRoot >= 0) {
    text += fmt::format(
        "  # Guessed: the URDF has a hand at {} (it moves {}). Write a hand.yaml in a folder of its own, with the "
        "path\n"
        "  # of {} as urdf and root_link: {}, and name that folder here.\n",
        body.links[guess.handRoot].name, fmt::join(fingers, ", "), urdfName, yamlName(body.links[guess.handRoot].name));
  } else {
    text +=
        "  # No hand was found in the URDF. Name the folder of one; mount is the pose of its root link in tip_link.\n";
    mount = ", mount: {position: [0, 0, 0], orientation: [0, 0, 0, 1]}";
  }
  return text + fmt::format("  - {{name: arm, base_link: {}, tip_link: {}, hand: FOLDER_OF_THE_HAND{}}}\n",
                            yamlName(body.links[guess.baseLink].name), yamlName(body.links[guess.tipLink].name), mount);
}

/// A posture to begin with, and how it was chosen.
struct Home {
  Eigen::VectorXd position;
  std::string reason;
};

/// The first of three guesses in which no links meet that are apart elsewhere; the first of all when they meet in each.
Home guessHome(const Mechanism& body, const SemanticDescription& semantic, const TouchingLinks& models,
               const SampledPairs& sampled) {
  constexpr double kNearEnd = 0.05;  // of the way from one limit to the other
  const std::array<std::string, 3> reasons = {
      "joints at 0, or in the middle of limits that do not hold it",
      "joints at 0, or in the middle where 0 is at or beyond an end of the limits",
      "joints in the middle of their limits"};
  const auto isFree = [&](const Eigen::VectorXd& q) {
    std::vector<Eigen::Isometry3d> X_BL;
    forwardKinematics(body, followMimics(body, q), X_BL);
    return std::none_of(sampled.apart.begin(), sampled.apart.end(), [&](const LinkPair& pair) {
      const bool isDisabled =
          std::find(semantic.disabled.begin(), semantic.disabled.end(), pair) != semantic.disabled.end();
      return !isDisabled && models.touch(pair.first, pair.second, X_BL);
    });
  };
  Home first;
  for (std::size_t guess = 0; guess < reasons.size(); ++guess) {
    Home home{Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.joints.size())), reasons[guess]};
    for (std::size_t j = 0; j < body.joints.size(); ++j) {
      const Joint& joint = body.joints[j];
      const double range = joint.upper - joint.lower, margin = guess == 0 ? 0 : kNearEnd * range;
      const bool holdsZero = joint.lower + margin <= 0 && joint.upper - margin >= 0;
      double& position = home.position[static_cast<Eigen::Index>(j)];
      if (std::isfinite(range) && (guess == 2 || !holdsZero)) position = (joint.lower + joint.upper) / 2;
      if (const auto given = semantic.home.find(static_cast<int>(j)); given != semantic.home.end())
        position = given->second;
    }
    if (isFree(home.position)) return home;
    if (guess == 0) first = std::move(home);
  }
  first.reason += "; links meet here";
  return first;
}

std::string homeText(const Mechanism& body, const SemanticDescription& semantic, const std::string& srdfPath,
                     const Home& home) {
  std::vector<std::string> entries;
  for (std::size_t j = 0; j < body.joints.size(); ++j) {
    if (body.joints[j].mimicOf >= 0) continue;
    entries.push_back(
        fmt::format("{}: {}", yamlName(body.joints[j].name), home.position[static_cast<Eigen::Index>(j)]));
  }
  const std::string source =
      semantic.homeName.empty()
          ? "Guessed: "
          : fmt::format("group_state \"{}\" of {}; other ", semantic.homeName, fs::path(srdfPath).filename().string());
  return fmt::format("# {}{}.\nhome: {{{}}}\n", source, home.reason, fmt::join(entries, ", "));
}

std::string speedText(const Mechanism& body) {
  constexpr double kVelocity = 1, kAcceleration = 2;  // rad/s, rad/s^2
  std::vector<std::string> velocities;
  for (const Joint& joint : body.joints) {
    if (joint.mimicOf < 0) {
      velocities.push_back(
          fmt::format("{}: {}", yamlName(joint.name), joint.velocity > 0 ? joint.velocity : kVelocity));
    }
  }
  return fmt::format(
      "# rad/s (m/s for sliding joints): the URDF's limits, {0} where it gives none.\n"
      "max_velocity: {{{1}}}\n"
      "# rad/s^2 (m/s^2): a URDF gives none.\n"
      "max_acceleration: {2}\n",
      kVelocity, fmt::join(velocities, ", "), kAcceleration);
}

std::string collisionText(const Mechanism& body, const SemanticDescription& semantic, const SampledPairs& sampled) {
  std::string text;
  const auto neighbours = neighbouringLinks(body);
  std::vector<LinkPair> listed = neighbours;
  const auto list = [&](const std::vector<LinkPair>& pairs, const std::string& reason) {
    for (const LinkPair& pair : pairs) {
      if (std::find(listed.begin(), listed.end(), pair) != listed.end()) continue;
      listed.push_back(pair);
      text += fmt::format("  - [{}, {}]   # {}\n", yamlName(body.links[pair.first].name),
                          yamlName(body.links[pair.second].name), reason);
    }
  };
  list(sampled.always, "touch in every posture tried");
  list(semantic.disabled, "disabled in the SRDF");
  return fmt::format(
      "# In {} random postures {} pairs of links never touched; they need no entry, nor do neighbours in the tree.\n"
      "allowed_collisions:{}{}",
      kSamples, sampled.never, text.empty() ? " []\n" : "\n", text);
}

}  // namespace

std::string initialRobotConfig(const std::string& urdfPath, const std::string& srdfPath, const PackagePaths& packages) {
  Mechanism body;
  readUrdf(urdfPath, "", {}, packages, body);
  const SemanticDescription semantic = readSrdf(srdfPath, body);
  Guess guess = guessArm(body, urdfPath);
  if (guess.handRoot >= 0) {
    listHandJoints(body, guess);
  } else {
    findFlange(body, guess);
  }
  const std::string urdfName = fs::path(urdfPath).filename().string();
  const TouchingLinks models(body);
  const SampledPairs sampled = sampleContacts(body, models);
  return fmt::format("# Made from {}, to be saved beside it. Set `hand`, and check what was guessed.\nurdf: {}\n",
                     urdfName, yamlName(urdfName)) +
         armText(urdfName, body, guess) +
         homeText(body, semantic, srdfPath, guessHome(body, semantic, models, sampled)) + speedText(body) +
         "clearance: 0.005   # m, kept by planned motions\n" + collisionText(body, semantic, sampled);
}

}  // namespace handhold
