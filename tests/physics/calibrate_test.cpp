// Models of what holds, on grasps whose labels follow a rule.
#include "physics/calibrate.h"

#include "core/random.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

/// Grasps whose log odds are 6 - 20 times the critical friction; half of them count as stored.
LabelledObject drawnObject(const std::string& name, std::size_t count) {
  const RandomStream random = RandomStream(7).child(static_cast<std::uint64_t>(name.front()));
  LabelledObject object{name, {}};
  for (std::size_t i = 0; i < count; ++i) {
    LabelledGrasp grasp;
    const double friction = 0.6 * random.uniform(3 * i);
    grasp.features = {0.1 * random.uniform(3 * i + 1), friction, 0.5, 0.2, 0};
    grasp.held = random.uniform(3 * i + 2) < 1 / (1 + std::exp(20 * friction - 6));
    grasp.features[4] = grasp.held ? 1 : 0;
    grasp.stored = i % 2 == 0;
    object.grasps.push_back(grasp);
  }
  return object;
}

const HoldModel& modelOf(const CalibratedHand& hand, std::string_view name) {
  return *std::find_if(hand.models.begin(), hand.models.end(), [&](const auto& model) { return model.name == name; });
}

TEST(Calibrate, FindsTheRuleBehindTheLabels) {
  const CalibratedHand hand = calibrateHand({drawnObject("a", 800), drawnObject("b", 800), drawnObject("c", 800)});
  const HoldModel& rank = modelOf(hand, kRankModel);
  ASSERT_EQ(rank.terms.size(), 2u);
  // Within what 2400 labels tell: a standard error is some 0.1 of the log odds at the middle, 0.7 of the slope.
  EXPECT_NEAR(rank.terms[1].coefficient / rank.terms[1].scale, -20, 2.5);
  EXPECT_NEAR(rank.probability({0.05, 0.3}), 0.5, 0.08);
  EXPECT_GT(rank.all.auc, 0.9);
  EXPECT_LT(rank.all.calibrationError, 0.04);
  // Epsilon is noise here, and a feature that never changes adds nothing.
  EXPECT_NEAR(modelOf(hand, "epsilon").all.auc, 0.5, 0.05);
  EXPECT_EQ(modelOf(hand, "full").terms[2].scale, 1);
  EXPECT_NEAR(modelOf(hand, "full").terms[2].coefficient, 0, 1e-9);
  EXPECT_NEAR(modelOf(hand, "full").all.brier, rank.all.brier, 1e-9);
  EXPECT_EQ(modelOf(hand, kSettledModel).all.auc, 1);
  EXPECT_TRUE(std::isnan(modelOf(hand, "constant").all.auc));
  EXPECT_EQ(rank.all.grasps, 2400u);
  EXPECT_EQ(rank.stored.grasps, 1200u);
}

// What a model says of an object must not depend on that object's labels.
TEST(Calibrate, AnObjectIsJudgedByTheOthers) {
  std::vector<LabelledObject> objects{drawnObject("a", 60), drawnObject("b", 60), drawnObject("c", 60)};
  const CalibratedHand before = calibrateHand(objects);
  for (LabelledGrasp& grasp : objects[1].grasps) grasp.held = !grasp.held;
  const CalibratedHand after = calibrateHand(objects);
  bool othersMoved = false;
  for (std::size_t m = 1; m < before.models.size(); ++m) {
    for (std::size_t i = 0; i < 180; ++i) {
      const double a = before.predictions[m][i].probability, b = after.predictions[m][i].probability;
      if (i >= 60 && i < 120) {
        EXPECT_EQ(a, b);
      } else {
        othersMoved = othersMoved || a != b;
      }
    }
  }
  EXPECT_TRUE(othersMoved);
}

TEST(Calibrate, SaysWhyAModelWouldMeanNothing) {
  std::vector<LabelledObject> objects{drawnObject("a", 40), drawnObject("b", 40)};
  EXPECT_EQ(whyNotCalibrated(objects), "");
  EXPECT_EQ(whyNotCalibrated({objects[0]}), "a is the only object, want two or more");
  for (LabelledGrasp& grasp : objects[0].grasps) grasp.held = true;
  EXPECT_EQ(whyNotCalibrated(objects), "without b 40 of 40 grasps held, want 5 that did and 5 that did not");
  for (LabelledGrasp& grasp : objects[1].grasps) grasp.held = true;
  EXPECT_EQ(whyNotCalibrated(objects), "all 80 grasps held");
  for (LabelledObject& object : objects) {
    for (LabelledGrasp& grasp : object.grasps) grasp.held = false;
  }
  EXPECT_EQ(whyNotCalibrated(objects), "none of 80 grasps held");
}

TEST(Calibrate, CountsByWhereAGraspWasDrawn) {
  LabelledObject object{"mug", {{true, {}, true}, {true, {}, false}, {false, {}, true}}};
  const HoldCalibration::Object counts = countObject(object);
  EXPECT_EQ(counts.name, "mug");
  EXPECT_EQ(counts.stored, 2u);
  EXPECT_EQ(counts.storedHeld, 1u);
  EXPECT_EQ(counts.trials, 1u);
  EXPECT_EQ(counts.trialsHeld, 1u);
}

}  // namespace
}  // namespace handhold
