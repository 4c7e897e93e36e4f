#include "store/hold_calibration.h"

#include "core/hash.h"
#include "store/refusal.h"
#include "store/synthetic_calibration.h"
#include "store/synthetic_set.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class CalibrationFile : public testing::Test {
 protected:
  std::string refusal(const std::string& bytes) {
    writeBytes(path, bytes);
    return refusalOf([&] { readCalibration(path); });
  }
  /// The file with another text in it, and the checksum of that.
  std::string changed(const std::string& from, const std::string& to) {
    writeCalibration(path, calibration);
    std::string bytes = bytesOf(path);
    const std::size_t begin = bytes.find('\n') + 1, at = bytes.find(from, begin);
    EXPECT_NE(at, std::string::npos) << from;
    bytes.replace(at, from.size(), to);
    const std::string hash = hashBytes(bytes.data() + begin, bytes.size() - begin);
    return bytes.replace(begin - 1 - hash.size(), hash.size(), hash);
  }

  TestFolder folder;
  std::filesystem::path path = folder.path() / "calibration-hand.yaml";
  GraspSet set = syntheticSet({}, 1);
  HoldCalibration calibration = calibrationFor(set);
};

TEST_F(CalibrationFile, EverythingComesBack) {
  writeCalibration(path, calibration);
  const HoldCalibration read = readCalibration(path);
  EXPECT_EQ(read.path, path.string());
  EXPECT_EQ(read.protocol, calibration.protocol);
  EXPECT_EQ(read.seed, calibration.seed);
  EXPECT_EQ(read.objects[0].storedHeld, 49u);
  EXPECT_TRUE(std::isnan(read.models[0].all.auc));
  EXPECT_EQ(read.rankModel().stored.calibrationError, 0.1);
  EXPECT_EQ(holdProbabilities(read, set, "set"), holdProbabilities(calibration, set, "set"));
  const std::string bytes = bytesOf(path);
  writeCalibration(path, read);  // over itself
  EXPECT_EQ(bytesOf(path), bytes);
}

TEST_F(CalibrationFile, WhatCannotBeUsedIsRefused) {
  writeCalibration(path, calibration);
  const std::string good = bytesOf(path), where = path.string();
  EXPECT_EQ(refusal(good), "accepted");
  EXPECT_EQ(refusal(""), where + ": is no calibration: it does not start with \"# HANDHOLD CALIBRATION \"");
  EXPECT_EQ(refusal("# HANDHOLD CALIBRATION 2 x\n"), where + ": has version 2, want 1");
  EXPECT_EQ(refusal(good.substr(0, 30)), where + ": is damaged: it ends in its first line");
  std::string damaged = good;
  damaged[damaged.find("coefficient: 2") + 13] = '3';
  EXPECT_THAT(refusal(damaged), StartsWith(where + ": is damaged: the checksum of its data is "));
  EXPECT_THAT(refusal(good.substr(0, good.size() - 5)), HasSubstr("is damaged"));
  // Whole files that say what cannot be.
  EXPECT_THAT(refusal(changed("scale: 0.02", "scale: 0.0")),
              HasSubstr("models[1].terms[0].scale is \"0.0\", want a number > 0"));
  EXPECT_THAT(refusal(changed("feature: epsilon", "feature: weight")), HasSubstr("want one of: epsilon, critical_"));
  EXPECT_THAT(refusal(changed("feature: epsilon", "feature: settled_closed")),
              HasSubstr("models has settled_closed in the model rank, want columns of every stored grasp alone"));
  EXPECT_THAT(refusal(changed("name: rank", "name: rang")), HasSubstr("models has no model called rank"));
  EXPECT_THAT(refusal(changed("friction: 0.", "frictoin: 0.")), HasSubstr(":4: frictoin is not a known key"));
  EXPECT_THAT(refusal(changed("stored_held: 49", "stored_held: -1")), HasSubstr("want a whole number >= 0"));
}

// Equation (1) by hand, and what is taken where the critical friction is not known.
TEST_F(CalibrationFile, ProbabilitiesAreTheModels) {
  set.epsilon[0] = 0.07, set.criticalFriction[0] = 0.25F;
  set.epsilon[1] = 0.05, set.criticalFriction[1] = std::numeric_limits<float>::quiet_NaN();
  const std::vector<double> p = holdProbabilities(calibration, set, "set");
  ASSERT_EQ(p.size(), set.graspCount());
  EXPECT_NEAR(p[0], 1 / (1 + std::exp(-(1 + 2 + 1.5))), 1e-9);
  EXPECT_NEAR(p[1], 1 / (1 + std::exp(-(1 - 3 * (set.friction - 0.3) / 0.1))), 1e-9);
}

TEST_F(CalibrationFile, IsForItsOwnKindOfSets) {
  const auto refusalOfSet = [&](const GraspSet& other) {
    return refusalOf([&] { requireSameKind(calibration, other, "v0001.h5"); });
  };
  EXPECT_EQ(refusalOfSet(set), "accepted");
  GraspSet other = set;
  other.hand = "claw";
  EXPECT_EQ(refusalOfSet(other), "v0001.h5: has hand claw, want " + set.hand + ", that of calibration.yaml");
  other = set;
  other.friction = 0.3;
  EXPECT_THAT(refusalOfSet(other), StartsWith("v0001.h5: has friction 0.3, want "));
  other = set;
  other.config += "# another\n";
  EXPECT_THAT(refusalOfSet(other), StartsWith("v0001.h5: has a hand with the hash "));
  other = set;
  other.linkMeshes[0].vertices[0].x() += 0.001;
  EXPECT_THAT(refusalOfSet(other), StartsWith("v0001.h5: has a hand with the hash "));
  other = set;
  other.coneEdges = 12;
  EXPECT_THAT(refusalOfSet(other), StartsWith("v0001.h5: has cone_edges 12, want "));
}

}  // namespace
}  // namespace handhold
