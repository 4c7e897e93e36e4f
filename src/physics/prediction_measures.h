#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace handhold {

/// A probability that was predicted, and what came true.
struct Prediction {
  double probability = 0;  // 0 to 1
  bool held = false;
};

/// Probability that one that held was given a higher probability than one that did not; ties count half: the area under
/// the ROC curve (Fawcett 2006, "An introduction to ROC analysis"). NaN when all held, or none.
double areaUnderRoc(std::span<const Prediction> predictions);

/// The ROC curve by falling threshold, (share of the others, share of those that held) at or above it, from (0, 0) to
/// (1, 1). Equal probabilities are one step. Empty when all held, or none.
std::vector<std::array<double, 2>> rocCurve(std::span<const Prediction> predictions);

/// Mean squared difference from 1 (held) or 0 (Brier 1950, halved: for the one class). NaN of nothing.
double brierScore(std::span<const Prediction> predictions);

/// Mean of -log of the probability given to what came true [nat]; probabilities are kept 1e-15 away from 0 and 1. NaN
/// of nothing.
double logLoss(std::span<const Prediction> predictions);

/// Predictions in a bin of probabilities.
struct ReliabilityBin {
  std::size_t grasps = 0, held = 0;
  double meanProbability = 0;  // 0 of nothing
};
inline constexpr std::size_t kReliabilityBins = 10;

/// Bins of equal width over [0, 1]; 1 belongs to the last.
std::array<ReliabilityBin, kReliabilityBins> reliabilityBins(std::span<const Prediction> predictions);

/// Mean over the predictions of |share held - mean probability| of their bin (Guo et al. 2017, "On Calibration of
/// Modern Neural Networks", equation 3, of the probability itself). NaN of nothing.
double expectedCalibrationError(std::span<const Prediction> predictions);

}  // namespace handhold
