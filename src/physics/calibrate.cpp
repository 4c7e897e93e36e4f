#include "physics/calibrate.h"

#include "physics/label_set.h"
#include "physics/logistic_regression.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace handhold {
namespace {

constexpr double kRidge = 1;  // a prior of standard deviation 1 for each coefficient
constexpr double kRounding = 1e-9;
constexpr std::size_t kFewestOfClass = 5;

struct ModelKind {
  std::string_view name;
  std::size_t features;  // the first so many of HoldFeature
};
constexpr std::array<ModelKind, 5> kModels = {
    {{"constant", 0}, {"epsilon", 1}, {kRankModel, 2}, {"full", 4}, {kSettledModel, 5}}};

using GraspPointers = std::vector<const LabelledGrasp*>;

/// The grasps of all objects but one.
GraspPointers graspsWithout(const std::vector<LabelledObject>& objects, std::size_t left) {
  GraspPointers grasps;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (i == left) continue;
    for (const LabelledGrasp& grasp : objects[i].grasps) grasps.push_back(&grasp);
  }
  return grasps;
}

std::size_t countHeld(const GraspPointers& grasps) {
  return static_cast<std::size_t>(
      std::count_if(grasps.begin(), grasps.end(), [](const LabelledGrasp* grasp) { return grasp->held; }));
}

/// Mean and standard deviation of a feature; 1 in the place of what rounding makes of one that never changes.
HoldModel::Term standardisation(const GraspPointers& grasps, std::size_t feature) {
  const auto n = static_cast<double>(grasps.size());
  double mean = 0, square = 0;
  for (const LabelledGrasp* grasp : grasps) mean += grasp->features[feature] / n;
  for (const LabelledGrasp* grasp : grasps) square += std::pow(grasp->features[feature] - mean, 2) / n;
  const double deviation = std::sqrt(square);
  return {static_cast<HoldFeature>(feature), mean, deviation > kRounding * std::abs(mean) ? deviation : 1, 0};
}

HoldModel fit(const ModelKind& kind, const GraspPointers& grasps) {
  HoldModel model;
  model.name = kind.name;
  for (std::size_t k = 0; k < kind.features; ++k) model.terms.push_back(standardisation(grasps, k));
  const auto n = static_cast<Eigen::Index>(grasps.size()), nFeatures = static_cast<Eigen::Index>(kind.features);
  Eigen::MatrixXd X(n, nFeatures);
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const LabelledGrasp& grasp = *grasps[static_cast<std::size_t>(i)];
    y[i] = grasp.held ? 1 : 0;
    for (Eigen::Index k = 0; k < nFeatures; ++k) {
      const HoldModel::Term& term = model.terms[static_cast<std::size_t>(k)];
      X(i, k) = (grasp.features[static_cast<std::size_t>(k)] - term.mean) / term.scale;
    }
  }
  const LogisticFit fitted = fitLogistic(X, y, kRidge);
  model.intercept = fitted.intercept;
  for (Eigen::Index k = 0; k < nFeatures; ++k) {
    model.terms[static_cast<std::size_t>(k)].coefficient = fitted.coefficients[k];
  }
  return model;
}

/// @param ofObjects  the predictions of each object
HoldMeasures measure(const std::vector<std::vector<Prediction>>& ofObjects, bool ranks) {
  std::vector<Prediction> together;
  double sum = 0, objects = 0;
  for (const std::vector<Prediction>& predictions : ofObjects) {
    together.insert(together.end(), predictions.begin(), predictions.end());
    const double auc = areaUnderRoc(predictions);
    if (!std::isnan(auc)) sum += auc, objects += 1;
  }
  HoldMeasures measures;
  measures.grasps = together.size();
  measures.held = static_cast<std::size_t>(
      std::count_if(together.begin(), together.end(), [](const Prediction& p) { return p.held; }));
  measures.brier = brierScore(together);
  measures.logLoss = logLoss(together);
  measures.calibrationError = expectedCalibrationError(together);
  // The share that held among the others is low for an object that held often: its order says nothing.
  if (ranks) measures.auc = areaUnderRoc(together);
  if (ranks && objects > 0) measures.aucInObject = sum / objects;
  return measures;
}

}  // namespace

CalibratedHand calibrateHand(const std::vector<LabelledObject>& objects) {
  CalibratedHand result;
  for (const ModelKind& kind : kModels) {
    std::vector<std::vector<Prediction>> all(objects.size()), stored(objects.size());
    std::vector<Prediction> predictions;
    for (std::size_t i = 0; i < objects.size(); ++i) {
      const HoldModel model = fit(kind, graspsWithout(objects, i));
      for (const LabelledGrasp& grasp : objects[i].grasps) {
        all[i].push_back({model.probability(grasp.features), grasp.held});
        if (grasp.stored) stored[i].push_back(all[i].back());
      }
      predictions.insert(predictions.end(), all[i].begin(), all[i].end());
    }
    HoldModel model = fit(kind, graspsWithout(objects, objects.size()));
    model.all = measure(all, kind.features > 0);
    model.stored = measure(stored, kind.features > 0);
    result.models.push_back(std::move(model));
    result.predictions.push_back(std::move(predictions));
  }
  return result;
}

std::string whyNotCalibrated(const std::vector<LabelledObject>& objects) {
  const GraspPointers all = graspsWithout(objects, objects.size());
  const std::size_t held = countHeld(all);
  if (held == all.size()) return fmt::format("all {} grasps held", all.size());
  if (held == 0) return fmt::format("none of {} grasps held", all.size());
  if (objects.size() == 1) return fmt::format("{} is the only object, want two or more", objects[0].name);
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const GraspPointers others = graspsWithout(objects, i);
    const std::size_t ofOthers = countHeld(others);
    if (std::min(ofOthers, others.size() - ofOthers) >= kFewestOfClass) continue;
    return fmt::format("without {} {} of {} grasps held, want {} that did and {} that did not", objects[i].name,
                       ofOthers, others.size(), kFewestOfClass, kFewestOfClass);
  }
  return "";
}

HoldCalibration calibrationOf(const SimulatedSet& set, std::uint64_t seed) {
  HoldCalibration calibration;
  calibration.hand = set.set().hand;
  calibration.handHash = handHash(set.set());
  calibration.friction = set.set().friction;
  calibration.coneEdges = set.set().coneEdges;
  calibration.contactDistance = set.set().contactDistance;
  calibration.simulatedFriction = set.settings().world.friction;
  calibration.protocol = protocolText(set.settings());
  calibration.seed = seed;
  calibration.noisePosition = kCalibrationNoise.position;
  calibration.noiseRotation = kCalibrationNoise.rotation;
  calibration.noiseTrials = kCalibrationNoise.trials;
  calibration.ridge = kRidge;
  return calibration;
}

HoldCalibration::Object countObject(const LabelledObject& object) {
  HoldCalibration::Object counts{object.name};
  for (const LabelledGrasp& grasp : object.grasps) {
    ++(grasp.stored ? counts.stored : counts.trials);
    if (grasp.held) ++(grasp.stored ? counts.storedHeld : counts.trialsHeld);
  }
  return counts;
}

void addResults(const std::vector<LabelledObject>& objects, const CalibratedHand& calibrated,
                HoldCalibration& calibration) {
  for (const LabelledObject& object : objects) calibration.objects.push_back(countObject(object));
  calibration.models = calibrated.models;
}

}  // namespace handhold
