// Given grasps become a set whose contacts and verdicts are ours.
#include "build/import_set.h"

#include "mesh/primitives.h"
#include "store/database.h"

#include <cmath>
#include <filesystem>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using ::testing::Each;
using ::testing::ElementsAre;

/// The shipped jaw at a box of 50 x 80 x 120 mm about the origin, which it takes from above by the 50 mm.
class ImportSet : public ::testing::Test {
 protected:
  ImportSet() {
    hand_ = loadHand(std::string(HANDHOLD_SOURCE_DIR) + "/hands/jaw");
    choosePreshapes(hand_, {"open_80"});
    job_ = importJob("imported by a test", 0.4, 1e-4);
    job_.simulation = Simulation::reference;
    item_.name = "box";
    item_.mesh = "box in memory";
    TriangleMesh mesh = boxMesh({0.05, 0.08, 0.12});
    roundToFloat(mesh);
    object_ = sampleObject(job_, item_, repairObject(mesh, {1, true, "m"}, item_.mesh));
  }

  /// The palm 1 mm above the box, then moved by `shift` in the object frame.
  GivenGrasp fromAbove(const Vector3d& shift = Vector3d::Zero()) const {
    Isometry3d X_OG = Isometry3d::Identity();
    X_OG.linear() = Vector3d(1, -1, -1).asDiagonal();
    X_OG.translation() = Vector3d(0, 0, 0.061) + shift;
    GivenGrasp grasp;
    grasp.X_OH = X_OG * hand_.X_LG.inverse();
    return grasp;
  }

  GraspSet import(const std::vector<GivenGrasp>& grasps) {
    const std::atomic<bool> never{false};
    const std::string hash = importHash(job_, item_, "0123", hand_, grasps);
    auto set = importSet(job_, object_, hand_, grasps, hash, nullptr, JobSystem(2), never);
    EXPECT_TRUE(set);
    const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "import_set_test";
    std::filesystem::remove_all(folder);
    GraspSet stored = readGraspSet(Database(folder).write(*set));  // checks it
    std::filesystem::remove_all(folder);
    return stored;
  }
  static GraspOutcome outcome(const GraspSet& set, std::size_t i) { return static_cast<GraspOutcome>(set.outcome[i]); }

  Hand hand_;
  Job job_;
  CatalogItem item_;
  SampledObject object_;
};

TEST_F(ImportSet, PosesAreClosedByThePolicy) {
  const GraspSet set = import({fromAbove({0, 0.001, 0})});
  ASSERT_EQ(set.graspCount(), 1U);
  EXPECT_EQ(set.policy, kImportedPolicy);
  EXPECT_THAT(set.trial, ElementsAre(0, 0, 0));
  EXPECT_THAT(set.jointPosition, Each(::testing::FloatNear(0.025f, 2e-5f)));
  EXPECT_GT(set.epsilon[0], 0.01);
  EXPECT_EQ(set.approachClear[0], 1);
  EXPECT_NEAR(set.backoff[0], 0.001, 1e-6);
  EXPECT_NEAR(set.targetPoint[2], 0.06, 1e-6);
  EXPECT_THAT(set.approachDirection, ElementsAre(0, 0, -1));
  EXPECT_THAT(set.sampleNormal, ElementsAre(0, 0, 1));
  for (std::size_t i = 0; i < set.contactLink.size(); ++i)
    EXPECT_NEAR(std::abs(set.contactPosition[3 * i]), 0.025, 1e-6);
  EXPECT_EQ(set.mapPoint.size(), 3 * 4000U);  // four for each of the 1000 samples of a build
  EXPECT_EQ(set.mapWeight.size(), 8U);
}

TEST_F(ImportSet, AJawCentresItself) {
  const GraspSet set = import({fromAbove({0.005, 0, 0})});
  ASSERT_EQ(set.graspCount(), 1U);
  EXPECT_NEAR(set.handPose[0], 0, 2e-5);
  EXPECT_NEAR(set.targetPoint[0], 0.005, 1e-6);  // where the palm was aimed at
}

TEST_F(ImportSet, GivenJointsAreTakenAsTheyAre) {
  GivenGrasp touching = fromAbove(), open = fromAbove();
  touching.jointPosition = Eigen::Vector2d(0.025, 0.025);
  open.jointPosition = Eigen::Vector2d(0.03, 0.03);  // 5 mm off
  const GraspSet set = import({open, touching});
  EXPECT_EQ(outcome(set, 0), GraspOutcome::tooFewContacts);
  EXPECT_EQ(outcome(set, 1), GraspOutcome::forceClosed);
  ASSERT_EQ(set.graspCount(), 1U);
  EXPECT_THAT(set.trial, ElementsAre(1, 0, 0));
  EXPECT_THAT(set.jointPosition, Each(0.025f));
  EXPECT_EQ(set.contactLink.size(), 8U);  // four corners of each pad
}

TEST_F(ImportSet, WhatIsNoGraspIsAnOutcome) {
  GivenGrasp inside = fromAbove({0, 0, -0.01});
  const GraspSet set = import({inside, fromAbove({1, 0, 0}), fromAbove()});
  EXPECT_EQ(set.outcomeNames[set.outcome[0]], kPreshapeTouches);
  EXPECT_TRUE(std::isnan(set.trialEpsilon[0]));
  EXPECT_EQ(outcome(set, 1), GraspOutcome::tooFewContacts);
  EXPECT_EQ(set.trialEpsilon[1], 0);
  EXPECT_EQ(outcome(set, 2), GraspOutcome::forceClosed);
  EXPECT_EQ(set.graspCount(), 1U);
  // The palm looks past the box: the target is the point of the map nearest to the tool centre point.
  EXPECT_NEAR(set.samplePoint[3], 0.025, 1e-6);
}

TEST_F(ImportSet, TurningTheHandIsItsRoll) {
  for (const double angle : {0.0, 0.02, std::numbers::pi}) {  // that leave the box between the jaws
    GivenGrasp turned = fromAbove();
    turned.X_OH = turned.X_OH * hand_.X_LG * Eigen::AngleAxisd(angle, Vector3d::UnitZ()) * hand_.X_LG.inverse();
    job_.contactDistance = 1e-3;
    const GraspSet set = import({turned});
    ASSERT_EQ(set.graspCount(), 1U) << angle;
    const Isometry3d again = palmPose(Vector3d::Zero(), {0, 0, -1}, set.roll[0]);
    EXPECT_TRUE(again.linear().isApprox((set.X_OH(0) * hand_.X_LG).linear(), 1e-6)) << angle;
  }
}

TEST_F(ImportSet, TheHashFollowsEveryGrasp) {
  const auto hash = [&](const std::vector<GivenGrasp>& grasps) {
    return importHash(job_, item_, "0123", hand_, grasps);
  };
  GivenGrasp posed = fromAbove();
  posed.jointPosition = Eigen::Vector2d(0.025, 0.025);
  EXPECT_EQ(hash({fromAbove()}), hash({fromAbove()}));
  EXPECT_NE(hash({fromAbove()}), hash({posed}));
  EXPECT_NE(hash({fromAbove()}), hash({fromAbove({0, 1e-9, 0})}));
  EXPECT_NE(hash({fromAbove()}), hash({fromAbove(), fromAbove()}));
  EXPECT_NE(hash({fromAbove()}), inputHash(job_, item_, "0123", hand_));
}

}  // namespace
}  // namespace handhold
