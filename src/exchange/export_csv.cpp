#include "exchange/export_set.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace handhold {
namespace {

/// A field of a CSV file: quoted when it has to be (RFC 4180).
std::string csvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  return quoted + '"';
}

}  // namespace

std::string csvText(const std::vector<FoundSet>& sets, std::string_view poseName) {
  std::vector<std::string> joints;  // of all hands: each has a column, empty for hands without that joint
  for (const FoundSet& set : sets) {
    for (const std::string& name : set.jointNames) {
      if (std::find(joints.begin(), joints.end(), name) == joints.end()) joints.push_back(name);
    }
  }
  std::string text =
      "object,hand,set_version,grasp,sample,roll_index,preshape_index,preshape,epsilon,epsilon_lower,epsilon_upper,"
      "critical_friction,load_margin,robustness,robustness_lower,robustness_upper";
  for (const char* name : {"x", "y", "z", "qx", "qy", "qz", "qw"}) text += fmt::format(",{}{}", poseName, name);
  text += ",target_x,target_y,target_z,approach_x,approach_y,approach_z,roll,backoff,approach_clear,contacts";
  for (const std::string& name : joints) text += "," + csvField("joint." + name);
  text += '\n';
  const auto add = [&](double value) { text += std::isnan(value) ? "," : fmt::format(",{}", value); };
  for (const FoundSet& set : sets) {
    std::vector<std::ptrdiff_t> column;
    for (const std::string& name : joints) {
      const auto found = std::find(set.jointNames.begin(), set.jointNames.end(), name);
      column.push_back(found == set.jointNames.end() ? -1 : found - set.jointNames.begin());
    }
    for (const FoundGrasp& g : set.grasps) {
      text += fmt::format("{},{},{},{},{},{}", csvField(set.object), csvField(set.hand), set.setVersion, g.grasp,
                          fmt::join(g.trial, ","), csvField(set.preshapeNames[g.trial[2]]));
      for (const double value : {g.epsilon, g.epsilonLower, g.epsilonUpper, g.criticalFriction, g.loadMargin,
                                 g.robustness, g.robustnessLower, g.robustnessUpper})
        add(value);
      for (const double value : g.handPose) add(value);
      for (const double value : g.targetPoint) add(value);
      for (const double value : g.approachDirection) add(value);
      add(g.roll);
      add(g.backoff);
      text += fmt::format(",{},{}", g.approachClear ? 1 : 0, g.contacts);
      for (const std::ptrdiff_t i : column) add(i < 0 ? std::nan("") : g.jointPosition[i]);
      text += '\n';
    }
  }
  return text;
}

}  // namespace handhold
