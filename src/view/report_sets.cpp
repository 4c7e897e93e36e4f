#include "view/report_sets.h"

#include "core/error.h"
#include "hand/hand.h"
#include "view/grasp_picture.h"
#include "view/png.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Json = nlohmann::ordered_json;

std::string text(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

/// The first `rows` rows of an array with `width` columns, as 32-bit floats.
template <class T>
std::vector<float> firstRows(const std::vector<T>& array, std::size_t rows, std::size_t width = 1) {
  return {array.begin(), array.begin() + static_cast<std::ptrdiff_t>(rows * width)};
}

/// What a histogram spans: the values that there are, or 0 to 1.
enum class Scale { values, share };

/// A number that every grasp has: shown, plotted and filtered by. Left out where no grasp has it.
void addColumn(Json& columns, const char* key, const char* label, const char* brief, const char* unit,
               const char* meaning, const std::vector<float>& values, Scale scale = Scale::values) {
  if (std::none_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); })) return;
  columns.push_back({{"key", key},
                     {"label", label},
                     {"brief", brief},
                     {"unit", unit},
                     {"meaning", meaning},
                     {"is_share", scale == Scale::share},
                     {"values", packed(values)}});
}

Json columnsJson(const ReportedSet& reported, std::size_t rows) {
  const GraspSet& set = reported.set;
  Json columns = Json::array();
  addColumn(columns, "epsilon", "Epsilon", "Epsilon", "",
            "The largest disturbance, in any direction of force and torque, that unit contact forces resist; more is "
            "better.",
            firstRows(set.epsilon, rows));
  addColumn(columns, "critical_friction", "Critical friction", "Friction", "",
            "The least coefficient of friction at which the grasp is still force closed; less is better.",
            firstRows(set.criticalFriction, rows));
  addColumn(columns, "load_margin", "Load margin", "Load", "N",
            "The largest load that the hand's joints bear in every task of the job; more is better.",
            firstRows(set.loadMargin, rows));
  addColumn(columns, "robustness", "Robustness", "Robust", "",
            "Share of the slightly moved poses at which the hand still ends force closed; more is better.",
            firstRows(set.robustness, rows), Scale::share);
  if (!reported.physics.empty()) {
    addColumn(columns, "physics", "Physics", "Physics", "",
              "Share of the simulated directions that the grasp survived.", firstRows(reported.physics, rows),
              Scale::share);
  }
  return columns;
}

Json graspsJson(const GraspSet& set, std::size_t rows) {
  const std::size_t contacts = set.contactBegin[rows];
  const auto upTo = [](const auto& array, std::size_t size) { return packed(std::span(array.data(), size)); };
  return {{"pose", packed(firstRows(set.handPose, rows, 7))},
          {"joints", upTo(set.jointPosition, rows * set.jointNames.size())},
          {"trial", upTo(set.trial, 3 * rows)},
          {"target", upTo(set.targetPoint, 3 * rows)},
          {"approach", upTo(set.approachDirection, 3 * rows)},
          {"roll", upTo(set.roll, rows)},
          {"backoff", upTo(set.backoff, rows)},
          {"contact_begin", upTo(set.contactBegin, rows + 1)},
          {"contact_position", upTo(set.contactPosition, 3 * contacts)},
          {"contact_normal", upTo(set.contactNormal, 3 * contacts)},
          {"contact_link", upTo(set.contactLink, contacts)}};
}

/// By trial: did it end as a grasp? An epsilon alone does not say so: the hand may collide with itself.
std::vector<bool> graspedTrials(const GraspSet& set) {
  const auto name = std::find(set.outcomeNames.begin(), set.outcomeNames.end(), "force_closed");
  const auto grasped = static_cast<std::size_t>(name - set.outcomeNames.begin());
  std::vector<bool> result;
  for (const std::uint8_t outcome : set.outcome) result.push_back(outcome == grasped);
  return result;
}

/// By sample: the largest epsilon of the grasps from there, 0 where there is none.
Json samplesJson(const GraspSet& set) {
  const std::size_t perSample = set.rolls * set.preshapes;
  const std::vector<bool> isGrasp = graspedTrials(set);
  std::vector<float> best(set.samples, 0);
  for (std::size_t i = 0; i < isGrasp.size(); ++i) {
    if (isGrasp[i]) best[i / perSample] = std::max(best[i / perSample], set.trialEpsilon[i]);
  }
  return {{"point", packed(set.samplePoint)}, {"normal", packed(set.sampleNormal)}, {"best", packed(best)}};
}

/// What ends a trial, in words; an outcome of a newer program has its name alone.
const char* meaningOf(const std::string& outcome) {
  if (outcome == "force_closed") return "resists every wrench: a grasp";
  if (outcome == "not_force_closed") return "contacts cannot resist every wrench";
  if (outcome == "too_few_contacts") return "fewer contacts than force closure takes";
  if (outcome == "blocked_centering") return "a jaw that centres itself would push the hand into the object";
  if (outcome == "self_collision") return "force closed, but parts of the hand pass through each other";
  if (outcome == "solve_failed") return "force closure or epsilon could not be computed";
  if (outcome == "not_run") return "not asked for, or the build was stopped";
  if (outcome == "preshape_touches") return "the open hand touches the object";
  return "";
}

Json outcomesJson(const GraspSet& set) {
  std::vector<std::size_t> counts(set.outcomeNames.size(), 0);
  for (const std::uint8_t outcome : set.outcome) ++counts[outcome];
  Json outcomes = Json::array();
  for (std::size_t i = 0; i < counts.size(); ++i) {
    outcomes.push_back(
        {{"name", set.outcomeNames[i]}, {"meaning", meaningOf(set.outcomeNames[i])}, {"count", counts[i]}});
  }
  return outcomes;
}

/// Where the set comes from, in the order in which a person asks.
Json factsJson(const ReportedSet& reported) {
  const GraspSet& set = reported.set;
  Json facts = Json::array();
  const auto add = [&](const char* label, const std::string& value) { facts.push_back({label, value}); };
  add("File", fmt::format("{} ({:.2f} MB)", reported.path, static_cast<double>(reported.bytes) / 1e6));
  add("Made by", set.generator);
  add("Written", fmt::format("{} on {}", set.created, set.host));
  add("Input hash", set.inputHash);
  add("Sampling", fmt::format("{} samples x {} rolls x {} preshapes, policy {}, seed {}", set.samples, set.rolls,
                              set.preshapes, set.policy, set.seed));
  add("Contacts", set.torsionRadius > 0
                      ? fmt::format("soft fingers, torsion radius {} m", set.torsionRadius)
                      : std::string("points") + fmt::format(", at most {} m apart", set.contactDistance));
  add("Friction", fmt::format("{}, epsilon on cones of {} edges", set.friction, set.coneEdges));
  add("Torque scale", fmt::format("{:.4f} m", set.torqueScale));
  if (set.robustnessTrials > 0) {
    add("Robustness", fmt::format("{} poses, off by {} m and {:.3g} degrees", set.robustnessTrials,
                                  set.robustnessPosition, set.robustnessRotation * 180 / std::numbers::pi));
  }
  add("Object", fmt::format("{} triangles, {}", set.objectMesh.triangles.size(),
                            set.watertight ? "watertight" : "an open surface"));
  for (const std::string& note : set.objectNotes) add("", note);
  return facts;
}

double totalSeconds(const GraspSet& set) {
  double sum = 0;
  for (const auto& [stage, seconds] : set.seconds) sum += seconds;
  return sum;
}

/// The picture of the best grasp as a data URL; empty when there is none.
std::string thumbnail(const GraspSet& set) {
  if (set.graspCount() == 0) return "";
  RenderSettings settings;
  settings.width = 264, settings.height = 198;
  settings.samplesPerSide = 2, settings.ambientRays = 4, settings.lightRays = 2;
  const std::vector<std::uint8_t> png = pngBytes(graspPicture(set, 0, settings));
  return "data:image/png;base64," + base64(png.data(), png.size());
}

}  // namespace

SetsReport::SetsReport(bool thumbnails) : thumbnails_(thumbnails) {}

std::string SetsReport::shareBlock(const std::string& kind, const std::string& json) {
  for (const PageData& block : blocks_) {
    if (block.json == json) return block.name;
  }
  blocks_.push_back({fmt::format("{}-{}", kind, blocks_.size()), json});
  return blocks_.back().name;
}

void SetsReport::add(const ReportedSet& reported) {
  const GraspSet& set = reported.set;
  Hand hand;
  try {
    hand = restoreHand(set.hand, set.urdf, set.config, set.linkNames, set.linkMeshes);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", reported.path, error.what()));
  }
  const std::size_t rows = std::min(set.graspCount(), reported.top);
  const std::string object = shareBlock("object", meshJson(set.objectMesh));
  const std::string shownHand = shareBlock("hand", handJson(hand));
  Json stages = Json::array();
  for (const auto& [stage, seconds] : set.seconds) stages.push_back({stage, seconds});
  const Json json = {{"object", set.object},
                     {"hand", set.hand},
                     {"version", set.setVersion},
                     {"path", reported.path},
                     {"friction", set.friction},
                     {"pitch", set.pitch},
                     {"stored", set.graspCount()},
                     {"shown", rows},
                     {"object_block", object},
                     {"hand_block", shownHand},
                     {"center_of_mass", {set.centerOfMass.x(), set.centerOfMass.y(), set.centerOfMass.z()}},
                     {"preshapes", set.preshapeNames},
                     {"trials", {set.samples, set.rolls, set.preshapes}},
                     {"columns", columnsJson(reported, rows)},
                     {"grasps", graspsJson(set, rows)},
                     {"samples", samplesJson(set)},
                     {"outcomes", outcomesJson(set)},
                     {"stages", stages},
                     {"facts", factsJson(reported)},
                     {"job", set.job}};
  const std::string name = fmt::format("set-{}", summaries_.size());
  blocks_.push_back({name, text(json)});
  const std::vector<bool> isGrasp = graspedTrials(set);
  summaries_.push_back(text({{"block", name},
                             {"object", set.object},
                             {"hand", set.hand},
                             {"version", set.setVersion},
                             {"trials", set.trialCount()},
                             {"closed", std::count(isGrasp.begin(), isGrasp.end(), true)},
                             {"grasps", set.graspCount()},
                             {"best", set.graspCount() > 0 ? set.epsilon.front() : 0.0},
                             {"seconds", totalSeconds(set)},
                             {"picture", thumbnails_ ? thumbnail(set) : ""}}));
}

std::string SetsReport::html(const std::string& database) const {
  Json sets = {{"database", database}, {"failures", failures_}, {"sets", Json::array()}};
  for (const std::string& summary : summaries_) sets["sets"].push_back(Json::parse(summary));
  std::vector<PageData> data = blocks_;
  data.push_back({"sets", text(sets)});
  std::string title = fmt::format("{} grasp sets", summaries_.size());
  if (summaries_.size() == 1) {
    const Json& only = sets["sets"][0];
    title = fmt::format("{} x {}", only["object"].get<std::string>(), only["hand"].get<std::string>());
  }
  return assemblePage(title + " - Handhold", data);
}

}  // namespace handhold
