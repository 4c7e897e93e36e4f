#include "physics/grasp_physics.h"

#include "support/toy_hands.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using handhold::testing::boxObject;
using handhold::testing::makeJaw;
using handhold::testing::sphereObject;

constexpr double kOwnMass = 0.3;  // kg

/// The coupled jaw on an object 40 mm wide, its origin 30 mm in front of the palm.
class JawPhysics : public ::testing::Test {
 protected:
  JawPhysics() {
    posture.X_OH = Isometry3d(Eigen::Translation3d(0, 0, -0.03));
    posture.preshape = hand.preshapes[0].jointPosition;
    posture.joints = Eigen::VectorXd::Constant(2, 0.02);
    posture.contacts = {{Vector3d(0.02, 0, 0), -Vector3d::UnitX(), 1}, {Vector3d(-0.02, 0, 0), Vector3d::UnitX(), 2}};
  }

  PhysicsModel modelOf(const ObjectModel& object, const PhysicsSettings& settings = {}) const {
    return {hand, linkSolids(hand), std::make_shared<Solid>(objectSolid(object.mesh)), object.mass, kOwnMass, settings};
  }

  Hand hand = makeJaw(true);
  GraspPosture posture;
};

TEST_F(JawPhysics, ABallIsHeldInAllDirections) {
  const PhysicsModel model = modelOf(sphereObject(0.02));
  const TestResult result = GraspSimulator(model).run(posture, PhysicsTest::pull);
  ASSERT_EQ(result.directions.size(), 6u);
  EXPECT_TRUE(isHeld(result));
  EXPECT_NEAR(result.settled.squeeze, 40, 1e-6);
  EXPECT_GE(result.settled.contacts.size(), 2u);
  for (const DirectionResult& direction : result.directions) {
    EXPECT_LT(direction.penetration, 5e-4);
    EXPECT_TRUE(std::isinf(direction.fallSeconds));
  }
}

// With flat pads on flat faces the contacts after the squeeze close, on a ball two points do not.
TEST_F(JawPhysics, ABoxIsHeldByContactsThatClose) {
  const PhysicsModel model = modelOf(boxObject({0.04, 0.04, 0.04}));
  const TestResult result = GraspSimulator(model).run(posture, PhysicsTest::pull);
  EXPECT_TRUE(isHeld(result));
  EXPECT_TRUE(result.settled.closed);
  EXPECT_LT(result.settled.displacement, 1e-3);
}

TEST_F(JawPhysics, AnOpenHandHoldsNothing) {
  const PhysicsModel model = modelOf(sphereObject(0.02));
  posture.joints = posture.preshape;
  posture.contacts.clear();
  const TestResult result = GraspSimulator(model).run(posture, PhysicsTest::pull);
  EXPECT_FALSE(result.settled.closed);
  EXPECT_TRUE(result.settled.contacts.empty());
  for (const std::size_t k : {2, 3, 4}) EXPECT_EQ(result.directions[k].outcome, PhysicsOutcome::moved) << k;
  // Free, 1 N moves 0.1 kg by 5 m/s^2 t^2: 0.2 m at the first look.
  EXPECT_NEAR(result.directions[2].displacement, 0.2, 0.005);
  EXPECT_NEAR(result.directions[2].fallSeconds, 0.2, 1e-9);
}

// Without friction the pads cannot hold against a pull along them.
TEST_F(JawPhysics, WithoutFrictionABoxSlidesOut) {
  PhysicsSettings settings;
  settings.world.friction = 0.005;
  settings.world.torsionFriction = 0;
  const PhysicsModel model = modelOf(boxObject({0.04, 0.04, 0.04}), settings);
  const TestResult result = GraspSimulator(model).run(posture, PhysicsTest::pull);
  EXPECT_FALSE(isHeld(result));
  EXPECT_EQ(result.directions[0].outcome, PhysicsOutcome::held);  // against a pad
  EXPECT_NE(result.directions[2].outcome, PhysicsOutcome::held);  // along both
}

TEST_F(JawPhysics, AHandInsideTheObjectIsNotBegun) {
  const PhysicsModel model = modelOf(boxObject({0.04, 0.04, 0.04}));
  posture.preshape = Eigen::VectorXd::Constant(2, 0.005);
  const TestResult result = GraspSimulator(model).run(posture, PhysicsTest::pull);
  ASSERT_EQ(result.directions.size(), 6u);
  EXPECT_EQ(result.directions[5].outcome, PhysicsOutcome::inside);
}

// Bit for bit: again, after another grasp, and on a simulator of its own.
TEST_F(JawPhysics, ResultsRepeat) {
  const PhysicsModel model = modelOf(boxObject({0.04, 0.03, 0.05}));
  GraspPosture other = posture;
  other.X_OH.translate(Vector3d(0, 0.012, 0));
  GraspSimulator simulator(model);
  const TestResult first = simulator.run(posture, PhysicsTest::pull);
  simulator.run(other, PhysicsTest::pull);
  const TestResult second = simulator.run(posture, PhysicsTest::pull);
  const TestResult fresh = GraspSimulator(model).run(posture, PhysicsTest::pull);
  for (std::size_t k = 0; k < 6; ++k) {
    for (const TestResult* again : {&second, &fresh}) {
      EXPECT_EQ(first.directions[k].displacement, again->directions[k].displacement);
      EXPECT_EQ(first.directions[k].rotation, again->directions[k].rotation);
      EXPECT_EQ(first.directions[k].penetration, again->directions[k].penetration);
    }
  }
  EXPECT_EQ(first.settled.displacement, second.settled.displacement);
}

// Heavy things are squeezed more, as far as the effort goes.
TEST_F(JawPhysics, TheWeightIsHeldWithMoreForce) {
  const PhysicsModel model = modelOf(boxObject({0.04, 0.04, 0.04}));
  const TestResult result = GraspSimulator(model).run(posture, PhysicsTest::weight);
  EXPECT_TRUE(isHeld(result));
  EXPECT_NEAR(result.settled.squeeze, 40 * 9.81 * kOwnMass, 1e-6);
}

TEST_F(JawPhysics, ABoxIsLiftedFromTheTableAndAnOpenHandLeavesItThere) {
  const PhysicsModel model = modelOf(boxObject({0.04, 0.04, 0.04}));
  posture.X_OH = Isometry3d(Eigen::Translation3d(0, 0, 0.03) * Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX()));
  std::swap(posture.contacts[0].link, posture.contacts[1].link);
  posture.contacts[0].link = 1, posture.contacts[1].link = 2;  // a turn about x leaves the jaws where they are
  GraspSimulator simulator(model);
  const TestResult held = simulator.run(posture, PhysicsTest::lift);
  ASSERT_EQ(held.directions.size(), 1u);
  EXPECT_EQ(held.directions[0].outcome, PhysicsOutcome::held);
  EXPECT_LT(held.directions[0].displacement, 0.01);
  posture.joints = posture.preshape;
  posture.contacts.clear();
  const TestResult left = simulator.run(posture, PhysicsTest::lift);
  EXPECT_EQ(left.directions[0].outcome, PhysicsOutcome::moved);
  EXPECT_NEAR(left.directions[0].displacement, 0.1, 0.005);
}

// MuJoCo's own collisions of convex pieces tell the same: held by the closed hand, not by the open one.
TEST_F(JawPhysics, PiecesAreHeldAsTheFieldIs) {
  const ObjectModel object = boxObject({0.04, 0.04, 0.04});
  const PhysicsModel model(hand, linkSolids(hand), std::make_shared<Solid>(objectSolid(object.mesh)), object.mass, 0,
                           {}, connectedHulls(object.mesh));
  GraspSimulator simulator(model);
  const TestResult held = simulator.run(posture, PhysicsTest::pull);
  EXPECT_TRUE(isHeld(held));
  ASSERT_FALSE(held.settled.contacts.empty());
  for (const Contact& contact : held.settled.contacts) {  // normals point into the object
    EXPECT_LT(contact.normal.dot(contact.position), 0);
  }
  posture.joints = posture.preshape;
  posture.contacts.clear();
  EXPECT_FALSE(isHeld(simulator.run(posture, PhysicsTest::pull)));
}

TEST_F(JawPhysics, TheWatchSeesEveryPhaseOnce) {
  const PhysicsModel model = modelOf(boxObject({0.04, 0.04, 0.04}));
  std::vector<PhysicsFrame> frames;
  GraspSimulator(model).run(posture, PhysicsTest::pull, [&](const PhysicsFrame& frame) { frames.push_back(frame); });
  ASSERT_EQ(frames.size(), 170u);  // 3.4 s
  EXPECT_EQ(frames.front().phase, "close");
  EXPECT_EQ(frames.back().phase, "pull");
  EXPECT_EQ(frames.back().X_WL.size(), hand.links.size());
  EXPECT_NEAR(frames.back().seconds, 3.4, 1e-6);
}

TEST_F(JawPhysics, ContactsWithinADistanceAreThoseOfTheSurfaces) {
  const PhysicsModel model = modelOf(boxObject({0.038, 0.04, 0.04}));  // 1 mm off each pad
  EXPECT_TRUE(model.contactsWithin(posture, 5e-4).empty());
  const std::vector<Contact> contacts = model.contactsWithin(posture, 3e-3);
  EXPECT_GE(contacts.size(), 6u);
  EXPECT_TRUE(model.closes(contacts));
}

}  // namespace
}  // namespace handhold
