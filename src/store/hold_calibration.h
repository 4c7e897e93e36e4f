#pragma once

#include "store/grasp_set.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace handhold {

/// What the probability that a grasp holds is estimated from (docs/physics.md, "The probability that a grasp holds").
enum class HoldFeature : std::uint8_t {
  epsilon,           // at the set's friction; 0: not force closed
  criticalFriction,  // at most the simulated friction
  loadMargin,        // load / (load + 1 N), 0 to 1
  robustness,        // share of perturbed poses that end force closed
  settledClosed,     // 1: the contacts after the simulated squeeze are force closed
};
inline constexpr std::array<std::string_view, 5> kHoldFeatureNames = {"epsilon", "critical_friction", "load_margin",
                                                                      "robustness", "settled_closed"};
using HoldFeatures = std::array<double, kHoldFeatureNames.size()>;  // by HoldFeature

/// How well probabilities agreed with what was held; NaN where it is not defined.
struct HoldMeasures {
  std::size_t grasps = 0, held = 0;
  double auc = std::numeric_limits<double>::quiet_NaN();          // area under the ROC curve, all objects together
  double aucInObject = std::numeric_limits<double>::quiet_NaN();  // mean over objects where some held and some did not
  double brier = std::numeric_limits<double>::quiet_NaN();
  double logLoss = std::numeric_limits<double>::quiet_NaN();           // nat a grasp
  double calibrationError = std::numeric_limits<double>::quiet_NaN();  // expected, ten bins
};

/// A logistic model of the probability that a grasp x is held in all six directions of the pull:
///
///     P(x) = 1 / (1 + exp(-b - sum over the terms of beta_k (x_k - m_k) / s_k))                                 (1)
struct HoldModel {
  struct Term {
    HoldFeature feature = HoldFeature::epsilon;
    double mean = 0, scale = 1, coefficient = 0;  // m_k, s_k > 0, beta_k
  };
  std::string name;
  double intercept = 0;  // b
  std::vector<Term> terms;
  HoldMeasures all, stored;  // on objects that the model had not seen: of all grasps drawn, of the stored ones alone

  double probability(const HoldFeatures& x) const;
};

/// The model that needs no more than every stored grasp has.
inline constexpr std::string_view kRankModel = "rank";

/// What `handhold physics --calibrate` found of a hand: a calibration-HAND.yaml.
struct HoldCalibration {
  /// Of the drawn grasps of an object: how many, and how many of them held.
  struct Object {
    std::string name;
    std::size_t stored = 0, storedHeld = 0, trials = 0, trialsHeld = 0;
  };

  std::string path;  // of the file that it was read from; not written

  // what it is for
  std::string hand, handHash;  // handHash() of its sets
  double friction = 0, contactDistance = 0;
  int coneEdges = 0;

  // how it was made
  double simulatedFriction = 0;
  std::string protocol;  // all else that labels depend on, a line each
  std::uint64_t seed = 1;
  double noisePosition = 0, noiseRotation = 0;  // of the robustness: m, rad
  int noiseTrials = 0;
  double ridge = 0;  // weight of the squared coefficients
  std::vector<Object> objects;
  std::vector<HoldModel> models;  // one is called kRankModel

  const HoldModel& rankModel() const;
};

/// Of everything that makes a set's hand: texts and meshes.
std::string handHash(const GraspSet& set);

/// @throws InputError  `PATH: ...` the set's hand, friction, cone edges or contact distance are not those of the
/// calibration
void requireSameKind(const HoldCalibration& calibration, const GraspSet& set, const std::string& path);

/// Of each grasp of a set (n) the probability that it holds, by the rank model: from its epsilon and critical friction.
/// Where the latter is not known, the set's friction is taken, at which the grasp is force closed.
/// @throws InputError  as requireSameKind
std::vector<double> holdProbabilities(const HoldCalibration& calibration, const GraspSet& set, const std::string& path);

/// Writes it whole, in place of a former one. Equal calibrations give equal bytes. @throws SystemError
void writeCalibration(const std::filesystem::path& path, const HoldCalibration& calibration);

/// @throws InputError  `PATH: ...` no calibration, damaged (its checksum is checked), of a newer version, or
/// `PATH:LINE: KEY ...` what was found and what is wanted
HoldCalibration readCalibration(const std::filesystem::path& path);

}  // namespace handhold
