#include "physics/prediction_measures.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace handhold {
namespace {

constexpr double kNearest = 1e-15;  // to 0 and 1, for the logarithm
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

/// The mean of `term` over the predictions.
template <class Term>
double meanOf(std::span<const Prediction> predictions, const Term& term) {
  double sum = 0;
  for (const Prediction& prediction : predictions) sum += term(prediction);
  return predictions.empty() ? kNothing : sum / static_cast<double>(predictions.size());
}

}  // namespace

std::vector<std::array<double, 2>> rocCurve(std::span<const Prediction> predictions) {
  std::vector<Prediction> sorted(predictions.begin(), predictions.end());
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.probability > b.probability; });
  const auto held = static_cast<double>(std::count_if(sorted.begin(), sorted.end(), [](auto& p) { return p.held; }));
  const double others = static_cast<double>(sorted.size()) - held;
  if (held == 0 || others == 0) return {};
  std::vector<std::array<double, 2>> curve{{0, 0}};
  double heldAbove = 0, othersAbove = 0;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    (sorted[i].held ? heldAbove : othersAbove) += 1;
    const bool isLastOfTie = i + 1 == sorted.size() || sorted[i + 1].probability != sorted[i].probability;
    if (isLastOfTie) curve.push_back({othersAbove / others, heldAbove / held});
  }
  return curve;
}

double areaUnderRoc(std::span<const Prediction> predictions) {
  const auto curve = rocCurve(predictions);
  if (curve.empty()) return kNothing;
  double area = 0;
  for (std::size_t i = 1; i < curve.size(); ++i) {
    area += (curve[i][0] - curve[i - 1][0]) * (curve[i][1] + curve[i - 1][1]) / 2;
  }
  return area;
}

double brierScore(std::span<const Prediction> predictions) {
  return meanOf(predictions, [](const Prediction& p) { return std::pow(p.probability - (p.held ? 1 : 0), 2); });
}

double logLoss(std::span<const Prediction> predictions) {
  return meanOf(predictions, [](const Prediction& p) {
    return -std::log(std::max(kNearest, p.held ? p.probability : 1 - p.probability));
  });
}

std::array<ReliabilityBin, kReliabilityBins> reliabilityBins(std::span<const Prediction> predictions) {
  std::array<ReliabilityBin, kReliabilityBins> bins;
  for (const Prediction& prediction : predictions) {
    const auto at = static_cast<std::size_t>(prediction.probability * kReliabilityBins);
    ReliabilityBin& bin = bins[std::min(at, kReliabilityBins - 1)];
    ++bin.grasps;
    bin.held += prediction.held ? 1 : 0;
    bin.meanProbability += prediction.probability;
  }
  for (ReliabilityBin& bin : bins) bin.meanProbability /= static_cast<double>(std::max<std::size_t>(1, bin.grasps));
  return bins;
}

double expectedCalibrationError(std::span<const Prediction> predictions) {
  if (predictions.empty()) return kNothing;
  double sum = 0;
  for (const ReliabilityBin& bin : reliabilityBins(predictions)) {
    sum += std::abs(static_cast<double>(bin.held) - static_cast<double>(bin.grasps) * bin.meanProbability);
  }
  return sum / static_cast<double>(predictions.size());
}

}  // namespace handhold
