#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "mesh/primitives.h"
#include "simulate/hand_check.h"
#include "view/colours.h"
#include "view/hand_picture.h"
#include "view/png.h"

#include <cmath>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

std::string text(const Eigen::Vector3d& v) { return fmt::format("({:.4f}, {:.4f}, {:.4f})", v.x(), v.y(), v.z()); }

void printJoints(const Hand& hand) {
  fmt::print("joints:\n");
  for (const Joint& joint : hand.joints) {
    const char* unit = joint.type == JointType::revolute ? "rad" : "m";
    fmt::print("  {:<28} {:<9} {:8.4f} .. {:8.4f} {:<3}", joint.name,
               joint.type == JointType::revolute ? "revolute" : "prismatic", joint.lower, joint.upper, unit);
    if (joint.mimicOf >= 0) {
      fmt::print("  = {:.4f} x {} + {:.4f}", joint.mimicMultiplier, hand.joints[joint.mimicOf].name, joint.mimicOffset);
    } else {
      fmt::print("  independent, effort {}", joint.effort > 0 ? fmt::format("{:.3g}", joint.effort) : "not given");
    }
    fmt::print("\n");
  }
}

void printLinks(const Hand& hand) {
  std::size_t triangles = 0, solid = 0;
  for (const Link& link : hand.links) {
    triangles += link.mesh.triangles.size();
    solid += link.mesh.triangles.empty() ? 0 : 1;
  }
  fmt::print("{}: {} links ({} with geometry, {} triangles), {} moving joints, root link {}\n", hand.name,
             hand.links.size(), solid, triangles, hand.joints.size(), hand.links[0].name);
  for (const std::string& note : hand.notes) fmt::print("  {}\n", note);
}

void printClosing(const Hand& hand) {
  fmt::print("closing, in this order:\n");
  for (const ClosingJoint& closing : hand.closing) {
    std::string followers;
    for (const int follower : followersOf(hand, closing.joint)) followers += " " + hand.joints[follower].name;
    fmt::print("  {} {}{}{}{}\n", hand.joints[closing.joint].name, closing.direction > 0 ? "upwards" : "downwards",
               followers.empty() ? "" : ", with" + followers,
               closing.breakawayJoint >= 0
                   ? ", then " + hand.joints[closing.breakawayJoint].name + " alone when only links before it touch"
                   : "",
               closing.selfCentering ? ", the hand centred" : "");
  }
}

std::string stopsText(const Hand& hand, const GraspTrial& trial) {
  std::string result;
  for (const ClosingStop& stop : trial.stops) {
    result += fmt::format("{}{} {:.3f}{}", result.empty() ? "" : ", ", hand.joints[stop.joint].name, stop.position,
                          stop.links.empty() ? "" : " (touches)");
  }
  return result;
}

/// Each preshape as it is, and closed on the sphere.
void drawPreshapes(const Hand& hand, const HandCheck& check, const std::string& folder) {
  RenderSettings settings;
  settings.width = settings.height = 600;
  createFolders(folder);
  for (std::size_t i = 0; i < check.preshapes.size(); ++i) {
    const GraspTrial& closed = check.preshapes[i].onSphere;
    const ScenePart sphere{sphereMesh(check.sphereRadius), closed.X_OH.inverse(), kObjectColour, false};
    const fs::path file = fs::path(folder) / (check.preshapes[i].name + ".png");
    writePng(composeGrid({handPicture(hand, hand.preshapes[i].jointPosition, {}, settings),
                          handPicture(hand, closed.jointPosition, {sphere}, settings)},
                         2),
             file);
    fmt::print("{}: {}, open and closed; blue: approach, red: closing, from the palm point\n", file.string(),
               check.preshapes[i].name);
  }
}

}  // namespace

int runHand(const HandCommand& command) {
  const auto& [path, initialise, rootLink, pictures, sphereRadius, packages] = command;
  if (initialise) {
    fmt::print("{}", initialHandConfig(path, rootLink, packages));
    return kExitDone;
  }
  const fs::path extension = fs::path(path).extension();
  if (extension == ".urdf" || extension == ".xacro") {
    initialHandConfig(path, "", packages);  // refuses what is no hand at all
    throw InputError(
        fmt::format("{}: is a URDF, want a folder with hand.yaml; start one with: handhold hand {} --init > hand.yaml",
                    path, path));
  }
  const Hand hand = loadHand(path, packages);
  printLinks(hand);
  printJoints(hand);
  const Eigen::Isometry3d X_LG = hand.X_LG;
  fmt::print("palm in link {}: position {} m, approach {}, closing {}\n", hand.links[hand.palmLink].name,
             text(X_LG.translation()), text(X_LG.linear().col(2)), text(X_LG.linear().col(0)));
  printClosing(hand);
  fmt::print("contacts are {}\n", contactModel(hand.torsionRadius));
  const HandCheck check = checkHand(hand, sphereRadius);
  fmt::print("palm point: the surface of its link is {:.2f} mm above it\n", 1e3 * check.palmHeight);
  for (const PreshapeCheck& preshape : check.preshapes) {
    fmt::print("preshape {}:\n", preshape.name);
    fmt::print("  closed on nothing: {}{}\n", stopsText(hand, preshape.onNothing),
               preshape.selfCollidesEmpty ? "; parts of the hand then pass through each other" : "");
    fmt::print("  closed on a sphere of {:.0f} mm, backed off {:.1f} mm: {}; {} contacts\n", 2e3 * sphereRadius,
               1e3 * preshape.onSphere.backoff, stopsText(hand, preshape.onSphere), preshape.onSphere.contacts.size());
  }
  if (!pictures.empty()) drawPreshapes(hand, check, pictures);
  for (const std::string& warning : check.warnings) fmt::print("warning: {}\n", warning);
  fmt::print("{}\n", check.warnings.empty() ? "the hand is ready" : "the hand loads; look at the warnings");
  return kExitDone;
}

}  // namespace handhold
