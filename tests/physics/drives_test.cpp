#include "physics/drives.h"

#include "support/toy_hands.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using handhold::testing::makeFingers;
using handhold::testing::makeJaw;

/// The jaw on a ball of 40 mm, its centre 30 mm in front of the palm.
GraspPosture jawOnABall(const Hand& hand) {
  GraspPosture posture;
  posture.X_OH = Isometry3d(Eigen::Translation3d(0, 0, -0.03));
  posture.preshape = hand.preshapes[0].jointPosition;
  posture.joints = Eigen::VectorXd::Constant(2, 0.02);
  posture.contacts = {{Vector3d(0.02, 0, 0), -Vector3d::UnitX(), 1}, {Vector3d(-0.02, 0, 0), Vector3d::UnitX(), 2}};
  return posture;
}

TEST(Drives, AMimicFollowsAndABreakawayDrivesItself) {
  const std::vector<Drive> jaw = drivesOf(makeJaw(true));
  ASSERT_EQ(jaw.size(), 1u);
  EXPECT_EQ(jaw[0].joint, 0);
  EXPECT_THAT(jaw[0].followers, ::testing::ElementsAre(std::pair(1, 1.0)));
  const std::vector<Drive> fingers = drivesOf(makeFingers(3));
  ASSERT_EQ(fingers.size(), 6u);
  EXPECT_EQ(fingers[1].breaksFrom, 0);
  EXPECT_TRUE(fingers[1].followers.empty());
}

// A joint that closing does not move is held, and with it what mimics it.
TEST(Drives, WhatDoesNotCloseIsHeld) {
  Hand hand = makeJaw(false);
  hand.closing.pop_back();
  const std::vector<Drive> drives = drivesOf(hand);
  ASSERT_EQ(drives.size(), 2u);
  EXPECT_FALSE(drives[0].holds);
  EXPECT_TRUE(drives[1].holds);
}

TEST(Drives, AreSoftEnoughForTheTimeStep) {
  for (const Hand& hand : {makeJaw(true), makeJaw(false), makeFingers(3)}) {
    for (const Drive& drive : drivesOf(hand)) {
      EXPECT_LE(drive.stiffness * 0.004 * 0.004 / drive.armature, 0.35);
    }
  }
}

// The outer joint follows at 0.4 until the inner one has arrived, then goes on alone, both at one speed.
TEST(ClosingTarget, ABreakawayGoesOnAlone) {
  const Hand hand = makeFingers(1);
  const std::vector<Drive> drives = drivesOf(hand);
  GraspPosture posture;
  posture.preshape = hand.preshapes[0].jointPosition;  // -0.3 and -0.12
  posture.joints = Eigen::Vector2d(0.3, 0.32);         // 0.12 coupled, 0.2 alone: 0.6 of the way and 0.2
  const auto at = [&](double s) {
    return Eigen::Vector2d(closingTarget(hand, drives[0], posture, s), closingTarget(hand, drives[1], posture, s));
  };
  EXPECT_TRUE(at(0).isApprox(Eigen::Vector2d(-0.3, -0.12)));
  EXPECT_TRUE(at(0.375).isApprox(Eigen::Vector2d(0, 0), 1e-9) || at(0.375).norm() < 1e-9);
  EXPECT_TRUE(at(0.75).isApprox(Eigen::Vector2d(0.3, 0.12)));
  EXPECT_TRUE(at(0.875).isApprox(Eigen::Vector2d(0.3, 0.22)));
  EXPECT_TRUE(at(1).isApprox(posture.joints));
}

// Two pads on a ball: 20 N each, and the driver of both bears them together.
TEST(Squeeze, OfTwoPads) {
  const Hand hand = makeJaw(true);
  const Squeeze squeeze = balancedSqueeze(hand, drivesOf(hand), jawOnABall(hand), Vector3d::Zero(), 40);
  EXPECT_NEAR(squeeze.normalForce, 40, 1e-9);
  ASSERT_EQ(squeeze.torque.size(), 1);
  EXPECT_NEAR(squeeze.torque[0], -40, 0.1);  // closing is towards smaller positions
  EXPECT_LT(squeeze.residual, 1e-3);
}

TEST(Squeeze, KeepsWithinTheEffort) {
  Hand hand = makeJaw(true);
  hand.joints[0].effort = 10;
  const Squeeze squeeze = balancedSqueeze(hand, drivesOf(hand), jawOnABall(hand), Vector3d::Zero(), 40);
  EXPECT_NEAR(squeeze.torque[0], -10, 1e-9);
  EXPECT_NEAR(squeeze.normalForce, 10, 0.1);
}

TEST(Squeeze, WithoutContactsThereIsNone) {
  const Hand hand = makeJaw(true);
  GraspPosture posture = jawOnABall(hand);
  posture.contacts.clear();
  const Squeeze squeeze = balancedSqueeze(hand, drivesOf(hand), posture, Vector3d::Zero(), 40);
  EXPECT_EQ(squeeze.normalForce, 0);
  EXPECT_TRUE(squeeze.torque.isZero(0));
}

// Two pads on one side of a ball can only push it away: what is asked of them is not balanced, and it is told.
TEST(Squeeze, TellsWhatItCannotBalance) {
  const Hand hand = makeJaw(true);
  GraspPosture posture = jawOnABall(hand);
  posture.contacts[1] = posture.contacts[0];
  EXPECT_GT(balancedSqueeze(hand, drivesOf(hand), posture, Vector3d::Zero(), 40).residual, 0.5);
}

}  // namespace
}  // namespace handhold
