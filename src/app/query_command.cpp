#include "app/commands.h"
#include "core/error.h"
#include "core/log.h"
#include "exchange/export_set.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <numbers>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

/// "X,Y,Z".
Eigen::Vector3d parseVector(const char* option, const std::string& text) {
  Eigen::Vector3d v;
  const char *position = text.data(), *end = text.data() + text.size();
  for (int i = 0; i < 3; ++i) {
    const auto [stop, error] = std::from_chars(position, end, v[i]);
    const bool goesOn = i < 2 ? stop != end && *stop == ',' : stop == end;
    if (error != std::errc() || !goesOn) {
      throw InputError(fmt::format("{} is \"{}\", want three numbers X,Y,Z, as 0,0,-1", option, text));
    }
    position = stop + 1;
  }
  return v;
}

const std::string& preshapeName(const FoundSet& set, const FoundGrasp& grasp) {
  return set.preshapeNames[grasp.trial[2]];
}

nlohmann::ordered_json toJson(const FoundSet& set, const FoundGrasp& g) {
  nlohmann::ordered_json json = {{"object", set.object},
                                 {"hand", set.hand},
                                 {"set_version", set.setVersion},
                                 {"grasp", g.grasp},
                                 {"trial", g.trial},
                                 {"preshape", preshapeName(set, g)},
                                 {"epsilon", g.epsilon},
                                 {"epsilon_lower", g.epsilonLower},
                                 {"epsilon_upper", g.epsilonUpper},
                                 {"critical_friction", g.criticalFriction},
                                 {"load_margin", g.loadMargin},
                                 {"robustness", g.robustness},
                                 {"robustness_lower", g.robustnessLower},
                                 {"robustness_upper", g.robustnessUpper},
                                 {"hand_pose", g.handPose},
                                 {"joint_names", set.jointNames},
                                 {"joint_position", g.jointPosition},
                                 {"preshape_joint_position", g.preshapeJointPosition},
                                 {"target_point", g.targetPoint},
                                 {"approach_direction", g.approachDirection},
                                 {"roll", g.roll},
                                 {"backoff", g.backoff},
                                 {"approach_clear", g.approachClear},
                                 {"contacts", g.contacts}};
  if (!std::isnan(g.physics)) json["physics"] = g.physics;  // --min-physics was given
  return json;
}

std::string jsonText(const QueryAnswer& answer) {
  std::string text = "[";
  for (const FoundSet& set : answer.sets) {
    for (const FoundGrasp& grasp : set.grasps) text += (text.size() > 1 ? ",\n" : "\n") + toJson(set, grasp).dump();
  }
  return text + "\n]\n";
}

std::string coverLine(const FoundSet& set) {
  return fmt::format(
      "{} x {} v{}: cover radius {:.4g} m: each of the {} grasps that pass lies within it of one of the {}", set.object,
      set.hand, set.setVersion, set.coverRadius, set.passed, set.grasps.size());
}

/// -0.000 reads as a direction.
double withoutMinusZero(double value, double smallest) { return std::abs(value) < smallest / 2 ? 0 : value; }

std::string tableText(const QueryAnswer& answer) {
  std::size_t count = 0, objectWidth = 6, handWidth = 4, preshapeWidth = 8;
  std::set<double> frictions;
  for (const FoundSet& set : answer.sets) {
    count += set.grasps.size();
    frictions.insert(set.friction);
    objectWidth = std::max(objectWidth, set.object.size());
    handWidth = std::max(handWidth, set.hand.size());
    for (const std::string& name : set.preshapeNames) preshapeWidth = std::max(preshapeWidth, name.size());
  }
  std::string text;
  if (count > 0) {
    text = fmt::format("{:<{}} {:<{}} {:>3} {:>6} {:<{}} {:>7} {:>7} {:>6} {:^23} {:^20} {:>5} {:>8}\n", "object",
                       objectWidth, "hand", handWidth, "ver", "grasp", "preshape", preshapeWidth, "epsilon", "true",
                       "mu", "hand position [m]", "approach", "clear", "contacts");
  }
  const auto known = [](double value, int digits) {
    return std::isnan(value) ? "-" : fmt::format("{:.{}f}", value, digits);
  };
  for (const FoundSet& set : answer.sets) {
    for (const FoundGrasp& g : set.grasps) {
      text += fmt::format("{:<{}} {:<{}} {:>3} {:>6} {:<{}} {:>7.4f} {:>7} {:>6}", set.object, objectWidth, set.hand,
                          handWidth, set.setVersion, g.grasp, preshapeName(set, g), preshapeWidth, g.epsilon,
                          known(g.epsilonLower, 4), known(g.criticalFriction, 3));
      for (std::size_t i = 0; i < 3; ++i) text += fmt::format(" {:>7.4f}", withoutMinusZero(g.handPose[i], 1e-4));
      for (const double x : g.approachDirection) text += fmt::format(" {:>6.3f}", withoutMinusZero(x, 1e-3));
      text += fmt::format(" {:>5} {:>8}\n", g.approachClear ? "yes" : "no", g.contacts);
    }
  }
  text += fmt::format("{} grasps from {} of {} sets\n", count, answer.sets.size(), answer.setsAsked);
  if (count == 0) return text;
  text += fmt::format(
      "  epsilon   on the linearised cones at the friction that the set was built with ({}), whatever --friction says\n"
      "  true      its lower bound on the true cone; - where it is not known\n"
      "  mu        critical friction: the least at which the grasp is force closed\n"
      "  approach  direction from the palm to the object; clear: nothing of the object is in the way\n",
      fmt::join(frictions, ", "));
  for (const FoundSet& set : answer.sets) {
    if (!std::isnan(set.coverRadius)) text += coverLine(set) + "\n";
  }
  return text;
}

/// What was left out and why, on stderr: an empty answer is an answer.
void reportLeftOut(const QueryAnswer& answer, bool asksForPhysics) {
  const LeftOut& out = answer.leftOut;
  const std::pair<const char*, std::size_t> filters[] = {{"not simulated", out.notSimulated},
                                                         {"by --min-physics", out.minPhysics},
                                                         {"by --min-epsilon", out.minEpsilon},
                                                         {"by --friction", out.friction},
                                                         {"of unknown critical friction", out.unknownFriction},
                                                         {"by --preshape", out.preshape},
                                                         {"by --approach", out.approach},
                                                         {"by --near", out.near}};
  std::size_t total = 0;
  std::string parts;
  for (const auto& [name, count] : filters) {
    if (count > 0) parts += fmt::format("{}{} {}", parts.empty() ? "" : ", ", count, name);
    total += count;
  }
  if (asksForPhysics && out.notSimulated > 0) {
    logWarning("query: --min-physics leaves out the grasps that have no physics results beside them");
  }
  if (total > 0) logInfo(fmt::format("query: {} of {} grasps left out: {}", total, answer.graspsAsked, parts));
  if (answer.graspsAsked == 0 && answer.failures.empty()) logInfo("query: the sets hold no grasp");
}

}  // namespace

QueryAnswer findGrasps(const QueryCommand& command, const Database& database) {
  GraspQuery query = command.query;
  if (command.approach) {
    query.approach = {parseVector("--approach", *command.approach), command.withinDeg * std::numbers::pi / 180};
  }
  if (command.near) query.near = {parseVector("--near", *command.near), command.radius};
  QueryAnswer answer = database.query(query);
  for (const std::string& failure : answer.failures) logError(failure);
  reportLeftOut(answer, query.minPhysics.has_value());
  return answer;
}

int runQuery(const QueryCommand& command, const Database& database) {
  const QueryAnswer answer = findGrasps(command, database);
  if (command.format == "table") {
    fmt::print("{}", tableText(answer));
  } else {
    fmt::print("{}", command.format == "json" ? jsonText(answer) : csvText(answer.sets));
    for (const FoundSet& set : answer.sets) {
      if (!std::isnan(set.coverRadius)) logInfo(coverLine(set));
    }
  }
  return answer.failures.empty() ? kExitDone : kExitItemFailed;
}

int runIndex(const Database& database) {
  std::vector<std::string> failures;
  const std::size_t sets = database.writeIndex(failures);
  for (const std::string& failure : failures) logError(failure);
  fmt::print("{} sets in the index of {}\n", sets, database.folder().string());
  return failures.empty() ? kExitDone : kExitItemFailed;
}

}  // namespace handhold
