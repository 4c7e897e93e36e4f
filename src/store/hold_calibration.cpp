#include "store/hold_calibration.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/yaml.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kCalibrationMagic = "# HANDHOLD CALIBRATION ", kVersion = "1";

template <class Measures, class Visit>
void forEachMeasure(Measures& measures, const Visit& visit) {
  visit("auc", measures.auc);
  visit("auc_in_object", measures.aucInObject);
  visit("brier", measures.brier);
  visit("log_loss", measures.logLoss);
  visit("calibration_error", measures.calibrationError);
}

std::string measuresText(const HoldMeasures& measures) {
  std::string text = fmt::format("{{grasps: {}, held: {}", measures.grasps, measures.held);
  forEachMeasure(measures, [&](const char* name, double value) {
    if (!std::isnan(value)) text += fmt::format(", {}: {:#}", name, value);
  });
  return text + "}";
}

/// A list item a line.
std::string listed(const std::string& text) {
  std::string items;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    items += "  - " + text.substr(begin, end - begin) + "\n";
    begin = end + 1;
  }
  return items;
}

std::string encode(const HoldCalibration& c) {
  std::string text = fmt::format("hand: {}\nhand_hash: {}\nfriction: {:#}\ncone_edges: {}\ncontact_distance: {:#}\n",
                                 c.hand, c.handHash, c.friction, c.coneEdges, c.contactDistance);
  text += fmt::format("simulated_friction: {:#}\nprotocol:\n{}", c.simulatedFriction, listed(c.protocol));
  text += fmt::format("seed: {}\nnoise: {{position: {:#}, rotation: {:#}, trials: {}}}\nridge: {:#}\nobjects:\n",
                      c.seed, c.noisePosition, c.noiseRotation, c.noiseTrials, c.ridge);
  for (const HoldCalibration::Object& object : c.objects) {
    text += fmt::format("  - {{name: {}, stored: {}, stored_held: {}, trials: {}, trials_held: {}}}\n", object.name,
                        object.stored, object.storedHeld, object.trials, object.trialsHeld);
  }
  text += "models:\n";
  for (const HoldModel& model : c.models) {
    text += fmt::format("  - name: {}\n    intercept: {:#}\n    terms:{}\n", model.name, model.intercept,
                        model.terms.empty() ? " []" : "");
    for (const HoldModel::Term& term : model.terms) {
      text += fmt::format("      - {{feature: {}, mean: {:#}, scale: {:#}, coefficient: {:#}}}\n",
                          kHoldFeatureNames[static_cast<std::size_t>(term.feature)], term.mean, term.scale,
                          term.coefficient);
    }
    text += fmt::format("    all: {}\n    stored: {}\n", measuresText(model.all), measuresText(model.stored));
  }
  return text;
}

std::uint64_t wholeNumber(const YamlValue& value) {
  const std::string text = value.text();
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) value.refuse("a whole number >= 0");
  return number;
}

std::size_t countAt(const YamlValue& map, const char* key) { return wholeNumber(map.require(key)); }

HoldMeasures measuresOf(const YamlValue& value) {
  value.allowKeys({"grasps", "held", "auc", "auc_in_object", "brier", "log_loss", "calibration_error"});
  HoldMeasures measures;
  measures.grasps = countAt(value, "grasps");
  measures.held = countAt(value, "held");
  forEachMeasure(measures, [&](const char* name, double& into) {
    if (const YamlValue* number = value.find(name)) into = number->number();
  });
  return measures;
}

HoldModel::Term termOf(const YamlValue& value) {
  value.allowKeys({"feature", "mean", "scale", "coefficient"});
  const YamlValue& name = value.require("feature");
  const auto at = std::find(kHoldFeatureNames.begin(), kHoldFeatureNames.end(), name.text());
  if (at == kHoldFeatureNames.end()) name.refuse(fmt::format("one of: {}", fmt::join(kHoldFeatureNames, ", ")));
  return {static_cast<HoldFeature>(at - kHoldFeatureNames.begin()), value.require("mean").number(),
          value.require("scale").positiveNumber(), value.require("coefficient").number()};
}

HoldModel modelOf(const YamlValue& value) {
  value.allowKeys({"name", "intercept", "terms", "all", "stored"});
  HoldModel model;
  model.name = value.require("name").text();
  model.intercept = value.require("intercept").number();
  for (const YamlValue& term : value.require("terms").items()) model.terms.push_back(termOf(term));
  model.all = measuresOf(value.require("all"));
  model.stored = measuresOf(value.require("stored"));
  return model;
}

/// There must be a rank model, and it must ask for nothing that a stored grasp may not have.
void requireRankModel(const YamlValue& models, const HoldCalibration& calibration) {
  const auto at = std::find_if(calibration.models.begin(), calibration.models.end(),
                               [](const HoldModel& model) { return model.name == kRankModel; });
  if (at == calibration.models.end()) models.fail(fmt::format("has no model called {}, want one", kRankModel));
  for (const HoldModel::Term& term : at->terms) {
    if (term.feature == HoldFeature::epsilon || term.feature == HoldFeature::criticalFriction) continue;
    models.fail(
        fmt::format("has {} in the model {}, want columns of every stored grasp alone: epsilon, "
                    "critical_friction",
                    kHoldFeatureNames[static_cast<std::size_t>(term.feature)], kRankModel));
  }
}

HoldCalibration decode(const YamlValue& top) {
  top.allowKeys({"hand", "hand_hash", "friction", "cone_edges", "contact_distance", "simulated_friction", "protocol",
                 "seed", "noise", "ridge", "objects", "models"});
  HoldCalibration c;
  c.hand = top.require("hand").text();
  c.handHash = top.require("hand_hash").text();
  c.friction = top.require("friction").positiveNumber();
  c.coneEdges = top.require("cone_edges").integer(3, 1'000'000);
  c.contactDistance = top.require("contact_distance").positiveNumber();
  c.simulatedFriction = top.require("simulated_friction").positiveNumber();
  for (const std::string& line : top.require("protocol").texts()) c.protocol += line + "\n";
  c.seed = wholeNumber(top.require("seed"));
  const YamlValue& noise = top.require("noise");
  noise.allowKeys({"position", "rotation", "trials"});
  c.noisePosition = noise.require("position").numberAtLeast(0);
  c.noiseRotation = noise.require("rotation").numberAtLeast(0);
  c.noiseTrials = noise.require("trials").integer(0, std::numeric_limits<int>::max());
  c.ridge = top.require("ridge").numberAtLeast(0);
  for (const YamlValue& object : top.require("objects").items()) {
    object.allowKeys({"name", "stored", "stored_held", "trials", "trials_held"});
    c.objects.push_back({object.require("name").text(), countAt(object, "stored"), countAt(object, "stored_held"),
                         countAt(object, "trials"), countAt(object, "trials_held")});
  }
  for (const YamlValue& model : top.require("models").items()) c.models.push_back(modelOf(model));
  requireRankModel(top.require("models"), c);
  return c;
}

void addMesh(const TriangleMesh& mesh, ContentHash& hash) {
  hash.addBytes(mesh.vertices.data(), mesh.vertices.size() * sizeof(mesh.vertices[0]));
  hash.addBytes(mesh.triangles.data(), mesh.triangles.size() * sizeof(mesh.triangles[0]));
}

}  // namespace

double HoldModel::probability(const HoldFeatures& x) const {
  double logit = intercept;
  for (const Term& term : terms) {
    logit += term.coefficient * (x[static_cast<std::size_t>(term.feature)] - term.mean) / term.scale;
  }
  return 1 / (1 + std::exp(-logit));
}

const HoldModel& HoldCalibration::rankModel() const {
  return *std::find_if(models.begin(), models.end(), [](const HoldModel& model) { return model.name == kRankModel; });
}

std::string handHash(const GraspSet& set) {
  ContentHash hash;
  hash.addText(set.urdf);
  hash.addText(set.config);
  for (const TriangleMesh& mesh : set.linkMeshes) addMesh(mesh, hash);
  return hash.hex();
}

void requireSameKind(const HoldCalibration& c, const GraspSet& set, const std::string& path) {
  const auto require = [&](const char* what, const auto& found, const auto& wanted) {
    if (found == wanted) return;
    throw InputError(fmt::format("{}: has {} {}, want {}, that of {}", path, what, found, wanted, c.path));
  };
  require("hand", set.hand, c.hand);
  require("a hand with the hash", handHash(set), c.handHash);
  require("friction", set.friction, c.friction);
  require("cone_edges", set.coneEdges, c.coneEdges);
  require("contact_distance", set.contactDistance, c.contactDistance);
}

std::vector<double> holdProbabilities(const HoldCalibration& c, const GraspSet& set, const std::string& path) {
  requireSameKind(c, set, path);
  const HoldModel& model = c.rankModel();
  std::vector<double> probabilities;
  for (std::size_t row = 0; row < set.graspCount(); ++row) {
    const double critical = set.criticalFriction[row];
    probabilities.push_back(model.probability({set.epsilon[row], std::isnan(critical) ? set.friction : critical}));
  }
  return probabilities;
}

void writeCalibration(const fs::path& path, const HoldCalibration& calibration) {
  const std::string text = encode(calibration);
  replaceContent(path,
                 fmt::format("{}{} {}\n{}", kCalibrationMagic, kVersion, hashBytes(text.data(), text.size()), text));
}

HoldCalibration readCalibration(const fs::path& path) {
  const std::string bytes = readFile(path);
  const auto refuse = [&](const std::string& message) {
    throw InputError(fmt::format("{}: {}", path.string(), message));
  };
  if (!bytes.starts_with(kCalibrationMagic)) {
    refuse(fmt::format("is no calibration: it does not start with \"{}\"", kCalibrationMagic));
  }
  const std::size_t space = std::min(bytes.find(' ', kCalibrationMagic.size()), bytes.size());
  const std::string version = bytes.substr(kCalibrationMagic.size(), space - kCalibrationMagic.size());
  if (version != kVersion) refuse(fmt::format("has version {}, want {}", version, kVersion));
  const std::size_t begin = space + kHashLength + 2;  // after the space, the hash and the line's end
  if (bytes.size() < begin) refuse("is damaged: it ends in its first line");
  const std::string found = hashBytes(bytes.data() + begin, bytes.size() - begin);
  const std::string wanted = bytes.substr(space + 1, kHashLength);
  if (found != wanted) refuse(fmt::format("is damaged: the checksum of its data is {}, want {}", found, wanted));
  HoldCalibration calibration = decode(YamlValue::parseText(std::string_view(bytes).substr(begin), path.string(), 2));
  calibration.path = path.string();
  return calibration;
}

}  // namespace handhold
