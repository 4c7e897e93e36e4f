// Measures of predictions on cases that can be counted by hand.
#include "physics/prediction_measures.h"

#include "core/random.h"

#include <cmath>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Predictions = std::vector<Prediction>;

TEST(AreaUnderRoc, OfKnownRankings) {
  EXPECT_DOUBLE_EQ(areaUnderRoc(Predictions{{0.9, true}, {0.8, true}, {0.3, false}}), 1);
  EXPECT_DOUBLE_EQ(areaUnderRoc(Predictions{{0.1, true}, {0.8, false}}), 0);
  EXPECT_DOUBLE_EQ(areaUnderRoc(Predictions{{0.9, true}, {0.7, false}, {0.5, true}, {0.3, false}}), 0.75);
  // A tie counts half, whatever the order: pairs (0.9, 0.4), (0.4, 0.4).
  EXPECT_DOUBLE_EQ(areaUnderRoc(Predictions{{0.4, true}, {0.4, false}, {0.9, true}}), 0.75);
  EXPECT_DOUBLE_EQ(areaUnderRoc(Predictions{{0.4, false}, {0.9, true}, {0.4, true}}), 0.75);
  EXPECT_DOUBLE_EQ(areaUnderRoc(Predictions{{0.2, true}, {0.2, false}, {0.2, true}}), 0.5);
  EXPECT_TRUE(std::isnan(areaUnderRoc(Predictions{{0.9, true}, {0.2, true}})));
  EXPECT_TRUE(std::isnan(areaUnderRoc(Predictions{})));
}

// The definition: the share of pairs in the right order, ties half.
TEST(AreaUnderRocProperty, IsTheShareOfPairsInOrder) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    Predictions predictions;
    for (std::uint64_t i = 0; i < 60; ++i) {
      predictions.push_back({std::floor(8 * random.uniform(2 * i)) / 8, random.uniform(2 * i + 1) < 0.4});
    }
    double pairs = 0, inOrder = 0;
    for (const Prediction& a : predictions) {
      for (const Prediction& b : predictions) {
        if (!a.held || b.held) continue;
        pairs += 1;
        inOrder += a.probability > b.probability ? 1 : a.probability == b.probability ? 0.5 : 0;
      }
    }
    EXPECT_NEAR(areaUnderRoc(predictions), inOrder / pairs, 1e-12);
  }
}

TEST(RocCurve, GoesFromCornerToCornerAndTiesAreOneStep) {
  const auto curve = rocCurve(Predictions{{0.9, true}, {0.4, true}, {0.4, false}, {0.1, false}});
  const std::vector<std::array<double, 2>> wanted = {{0, 0}, {0, 0.5}, {0.5, 1}, {1, 1}};
  EXPECT_EQ(curve, wanted);
}

TEST(PredictionMeasures, BrierScoreAndLogLoss) {
  const Predictions predictions{{0.8, true}, {0.5, false}};
  EXPECT_DOUBLE_EQ(brierScore(predictions), (0.04 + 0.25) / 2);
  EXPECT_DOUBLE_EQ(logLoss(predictions), -(std::log(0.8) + std::log(0.5)) / 2);
  EXPECT_NEAR(logLoss(Predictions{{0, true}}), -std::log(1e-15), 1e-9);  // certain and wrong: bad, not infinite
  EXPECT_TRUE(std::isnan(brierScore({})));
}

// Two bins: four at 0.85 of which three held, two at 0.25 of which none did.
TEST(PredictionMeasures, CalibrationErrorIsOfTheBins) {
  const Predictions predictions{{0.85, true}, {0.85, true}, {0.85, true}, {0.85, false}, {0.25, false}, {0.25, false}};
  EXPECT_NEAR(expectedCalibrationError(predictions), (4 * (0.85 - 0.75) + 2 * 0.25) / 6, 1e-12);
  const auto bins = reliabilityBins(predictions);
  EXPECT_EQ(bins[8].grasps, 4u);
  EXPECT_EQ(bins[8].held, 3u);
  EXPECT_NEAR(bins[8].meanProbability, 0.85, 1e-12);
  EXPECT_EQ(bins[2].grasps, 2u);
  EXPECT_EQ(reliabilityBins(Predictions{{1, true}, {0, false}})[9].grasps, 1u);
  EXPECT_NEAR(expectedCalibrationError(Predictions{{0.5, true}, {0.5, false}}), 0, 1e-12);
}

}  // namespace
}  // namespace handhold
