// Grasps whose outcome is known on paper.
#include "mesh/primitives.h"
#include "quality/force_closure.h"
#include "simulate/fast_policy.h"
#include "simulate/grasp_policy.h"
#include "support/toy_hands.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using testing::boxObject;
using testing::makeCoupledFingers;
using testing::makeFingers;
using testing::makeJaw;
using testing::makeObject;
using testing::sphereObject;

constexpr double kTolerance = 6e-5;  // m: the reference's own 1e-5, the chord error of round objects 4e-5
const ReferenceSettings kReference;

GraspTrial run(const Hand& hand, const ObjectModel& object, const GraspCandidate& candidate) {
  GraspTrial trial;
  makeReferencePolicy(hand, object, PolicyKind::surfaceNormal)->run(candidate, trial);
  return trial;
}

GraspCandidate fromAbove(double height) { return {Vector3d(0, 0, height), -Vector3d::UnitZ(), 0, 0}; }

ForceClosure verdict(const GraspTrial& trial, const ObjectModel& object, double friction) {
  const WrenchModel model{object.mass.centerOfMass, object.mass.radius, friction, 8};
  return testForceClosure(frictionConeWrenches(trial.contacts, model)).verdict;
}

// A flush palm stays at the smallest back-off, the pads stop at the box's width, the contacts are the pads' corners.
TEST(ClosedForm, BoxBetweenPlates) {
  const ObjectModel box = boxObject({0.05, 0.1, 0.06});
  const GraspTrial trial = run(makeJaw(false), box, fromAbove(0.03));
  EXPECT_EQ(trial.backoff, kReference.startBackoff);
  ASSERT_EQ(trial.jointPosition.size(), 2);
  for (int i = 0; i < 2; ++i) {
    EXPECT_GE(trial.jointPosition[i], 0.025 - 1e-9);  // stops on the free side
    EXPECT_NEAR(trial.jointPosition[i], 0.025, kTolerance);
  }
  ASSERT_EQ(trial.contacts.size(), 8U);  // approach -z: palm x points to object +x, so pads are at x = +-25 mm
  for (const Contact& contact : trial.contacts) {
    EXPECT_NEAR(std::abs(contact.position.x()), 0.025, 1e-9);
    EXPECT_NEAR(std::abs(contact.position.y()), 0.01, 1e-9);
    EXPECT_TRUE(std::abs(contact.position.z() - 0.0103) < 1e-8 || std::abs(contact.position.z() + 0.0097) < 1e-8)
        << contact.position.transpose();
    EXPECT_NEAR(contact.normal.x(), contact.position.x() > 0 ? -1 : 1, 1e-12);
  }
  EXPECT_EQ(verdict(trial, box, 0.4), ForceClosure::closed);
  EXPECT_EQ(verdict(trial, box, 0.01), ForceClosure::closed);  // patches resist torques at any friction > 0
}

// The flush palm, 0.3 mm off the box, is in contact when the contact distance says so.
TEST(ClosedForm, AFlushPalmCountsWithinTheContactDistance) {
  const ObjectModel box = boxObject({0.05, 0.1, 0.06});
  ReferenceSettings settings;
  settings.contactDistance = 4e-4;
  GraspTrial trial;
  const Hand hand = makeJaw(false);
  makeReferencePolicy(hand, box, PolicyKind::surfaceNormal, settings)->run(fromAbove(0.03), trial);
  const auto palmContacts =
      std::count_if(trial.contacts.begin(), trial.contacts.end(), [](const Contact& c) { return c.link == 0; });
  EXPECT_EQ(palmContacts, 4);
  for (const Contact& contact : trial.contacts) {
    if (contact.link != 0) continue;
    EXPECT_NEAR(contact.position.z(), 0.03, 1e-8);
  }
}

// Pads meet the sphere's equator; contacts lie in caps of half-width sqrt(2 r d) around it.
TEST(ClosedForm, SphereInAJaw) {
  constexpr double kRadius = 0.03;
  const ObjectModel sphere = sphereObject(kRadius);
  const GraspTrial trial = run(makeJaw(false), sphere, fromAbove(kRadius));
  EXPECT_NEAR(trial.backoff, kReference.startBackoff, kTolerance);
  for (int i = 0; i < 2; ++i) EXPECT_NEAR(trial.jointPosition[i], kRadius, kTolerance);
  const double cap = std::sqrt(2 * kRadius * (kReference.contactDistance + kTolerance)) + 1e-3;
  ASSERT_FALSE(trial.contacts.empty());
  for (const Contact& contact : trial.contacts) {
    EXPECT_NEAR(contact.position.norm(), kRadius, kTolerance);
    EXPECT_LT(std::hypot(contact.position.y(), contact.position.z()), cap);
    EXPECT_GT(-contact.normal.dot(contact.position.normalized()), 0.99);
  }
}

// A jaw that centres itself: the hand moves by the offset, the jaws end coupled.
TEST(ClosedForm, CoupledJawCentresOnAnOffsetBox) {
  const ObjectModel box = boxObject({0.03, 0.1, 0.06}, Eigen::Isometry3d(Eigen::Translation3d(0.006, 0, 0)));
  const GraspTrial trial = run(makeJaw(true), box, fromAbove(0.03));
  EXPECT_NEAR((trial.centering - Vector3d(0.006, 0, 0)).norm(), 0, kTolerance);
  EXPECT_NEAR(trial.jointPosition[0], 0.015, kTolerance);
  EXPECT_EQ(trial.jointPosition[0], trial.jointPosition[1]);
  EXPECT_EQ(trial.contacts.size(), 8U);
  EXPECT_EQ(verdict(trial, box, 0.4), ForceClosure::closed);
}

// One jaw finds nothing: both close as the coupling says, to their limit.
TEST(ClosedForm, CoupledJawClosesOnNothing) {
  const ObjectModel box = boxObject({0.05, 0.1, 0.01}, Eigen::Isometry3d(Eigen::Translation3d(0, 0, 0.025)));
  const GraspTrial trial = run(makeJaw(true), box, fromAbove(0.03));  // too flat to reach between the pads
  EXPECT_EQ(trial.jointPosition[0], 0.0);
  EXPECT_TRUE(trial.centering.isZero());
  EXPECT_LT(trial.contacts.size(), 3U);
}

// Centring would push the palm into a step of the object.
TEST(ClosedForm, CentringIsBlockedByAStep) {
  TriangleMesh mesh = boxMesh({0.03, 0.1, 0.06});
  // A post 3 mm beside the palm's edge, on the side to which the hand will move.
  TriangleMesh post;
  append(post, boxMesh({0.01, 0.01, 0.04}), Eigen::Isometry3d(Eigen::Translation3d(0.042, 0, 0.05)));
  append(mesh, post, Eigen::Isometry3d::Identity());
  const ObjectModel object = makeObject(std::move(mesh));
  GraspCandidate candidate = fromAbove(0.03);
  candidate.targetPoint.x() = -0.006;
  const GraspTrial trial = run(makeJaw(true), object, candidate);
  EXPECT_EQ(trial.outcome, GraspOutcome::blockedCentering);
}

// Fingers that turn with one drive: the hand moves to where both touch together, whichever way that is.
TEST(ClosedForm, CoupledFingersCentreOnAnOffsetBox) {
  const Hand hand = makeCoupledFingers();
  for (const double offset : {-0.011, 0.0, 0.006}) {
    const ObjectModel box = boxObject({0.03, 0.1, 0.06}, Eigen::Isometry3d(Eigen::Translation3d(offset, 0, 0)));
    const GraspTrial trial = run(hand, box, fromAbove(0.03));
    EXPECT_NEAR((trial.centering - Vector3d(offset, 0, 0)).norm(), 0, kTolerance);
    EXPECT_EQ(trial.backoff, kReference.startBackoff);
    EXPECT_EQ(trial.jointPosition[0], trial.jointPosition[2]);
    EXPECT_TRUE(trial.X_OH.translation().isApprox(Vector3d(offset, 0, 0.0303), kTolerance));
    for (const double side : {-1.0, 1.0}) {
      const auto touches = [&](const Contact& c) { return std::abs(c.position.x() - offset - side * 0.015) < 1e-9; };
      EXPECT_TRUE(std::any_of(trial.contacts.begin(), trial.contacts.end(), touches)) << offset;
    }
    EXPECT_EQ(verdict(trial, box, 0.4), ForceClosure::closed);
  }
}

TEST(ClosedForm, CoupledFingersAreBlockedByAStep) {
  TriangleMesh mesh = boxMesh({0.03, 0.1, 0.06});
  // A post 3 mm beside the palm's edge, on the side to which the hand would move.
  append(mesh, boxMesh({0.01, 0.01, 0.04}), Eigen::Isometry3d(Eigen::Translation3d(0.042, 0, 0.05)));
  GraspCandidate candidate = fromAbove(0.03);
  candidate.targetPoint.x() = -0.006;
  EXPECT_EQ(run(makeCoupledFingers(), makeObject(std::move(mesh)), candidate).outcome, GraspOutcome::blockedCentering);
}

// The fast policy is wrapped in the same way.
TEST(ClosedForm, FastCoupledFingersCentreAsTheReferenceDoes) {
  const Hand hand = makeCoupledFingers();
  const ObjectModel box = boxObject({0.03, 0.1, 0.06}, Eigen::Isometry3d(Eigen::Translation3d(0.006, 0, 0)));
  const auto fast = makeFastPolicy(makeHandFields(hand), hand, box, PolicyKind::surfaceNormal);
  GraspTrial trial, ofClone;
  fast->run(fromAbove(0.03), trial);
  EXPECT_NEAR((trial.centering - Vector3d(0.006, 0, 0)).norm(), 0, kTolerance);
  EXPECT_NEAR(trial.jointPosition[0], run(hand, box, fromAbove(0.03)).jointPosition[0], 2e-3);
  EXPECT_EQ(verdict(trial, box, 0.4), ForceClosure::closed);
  fast->clone()->run(fromAbove(0.03), ofClone);
  EXPECT_EQ(trial.jointPosition, ofClone.jointPosition);
}

// Three fingers at 120 degrees on an upright cylinder stop at one angle and hold it.
TEST(ClosedForm, CylinderInThreeFingers) {
  const ObjectModel cylinder = makeObject(cylinderMesh(0.025, 0.1));
  const GraspTrial trial = run(makeFingers(3), cylinder, fromAbove(0.05));
  EXPECT_NEAR(trial.backoff, kReference.startBackoff, kTolerance);
  for (int i = 1; i < 3; ++i) {
    // The cylinder's facets are not the same to every finger: 4e-5 m at 30 mm from the joint.
    EXPECT_NEAR(trial.jointPosition[2 * i], trial.jointPosition[0], 2e-3);
  }
  std::vector<bool> touched(7, false);
  for (const Contact& contact : trial.contacts) {
    touched[contact.link] = true;
    EXPECT_NEAR(std::hypot(contact.position.x(), contact.position.y()), 0.025, kTolerance);
  }
  EXPECT_TRUE((touched[1] || touched[2]) && (touched[3] || touched[4]) && (touched[5] || touched[6]));
  EXPECT_EQ(verdict(trial, cylinder, 0.4), ForceClosure::closed);
}

// The proximal link is stopped, the clutch opens, the distal link goes on until it touches too.
TEST(ClosedForm, BreakawayGoesOnWhenTheProximalLinkIsStopped) {
  // A low, wide box stops the proximal links; the distal ones fold over it.
  const ObjectModel box = boxObject({0.07, 0.07, 0.045});
  const GraspTrial trial = run(makeFingers(2), box, fromAbove(0.0225));
  ASSERT_EQ(trial.stops.size(), 4U);
  for (int finger = 0; finger < 2; ++finger) {
    const ClosingStop& proximal = trial.stops[2 * finger];
    const ClosingStop& distal = trial.stops[2 * finger + 1];
    EXPECT_EQ(proximal.links, std::vector<int>{2 * finger + 1});
    EXPECT_GT(distal.position, 0.4 * proximal.position + 0.01);  // beyond the coupling
    EXPECT_EQ(trial.jointPosition[2 * finger + 1], distal.position);
  }
}

// A finger that its distal link stops stays coupled.
TEST(ClosedForm, DistalContactKeepsTheCoupling) {
  const ObjectModel sphere = sphereObject(0.02);
  GraspCandidate candidate = fromAbove(0.02);
  Hand hand = makeFingers(3);
  hand.preshapes[0].standoff = 0.03;  // only the fingertips reach
  const GraspTrial trial = run(hand, sphere, candidate);
  ASSERT_EQ(trial.stops.size(), 3U);
  for (int finger = 0; finger < 3; ++finger) {
    EXPECT_EQ(trial.stops[finger].links, std::vector<int>{2 * finger + 2});
    EXPECT_NEAR(trial.jointPosition[2 * finger + 1], 0.4 * trial.jointPosition[2 * finger], 1e-15);
  }
}

TEST(ClosedForm, StandoffIsAddedToTheBackoff) {
  const ObjectModel box = boxObject({0.05, 0.1, 0.06});
  Hand hand = makeJaw(false);
  hand.preshapes[0].standoff = 0.012;
  EXPECT_NEAR(run(hand, box, fromAbove(0.03)).backoff, kReference.startBackoff + 0.012, 1e-12);
}

// Inside counts as touching: a hand that starts wholly inside a large block must come out of it.
TEST(ClosedForm, AHandInsideTheObjectBacksOut) {
  const ObjectModel block = boxObject({1, 1, 1});
  const GraspTrial trial = run(makeJaw(false), block, fromAbove(0.1));
  EXPECT_NEAR(trial.backoff, 0.5 - 0.1 + 0.04, kTolerance);  // the pads' tips, 40 mm before the palm, clear the top
}

// The object inside the hand's own solid counts as touching too.
TEST(ClosedForm, AnObjectInsideALinkTouches) {
  const Hand hand = makeJaw(false);
  const ObjectModel pea = sphereObject(0.003);
  const GraspTrial trial = run(hand, pea, fromAbove(-0.013));  // the palm plate, 20 mm thick, is around it
  EXPECT_NEAR(trial.backoff, 0.013 + 0.003, kTolerance);
}

// The centre-approach policy stops at the first touch from outside, not at the first gap from within.
TEST(ClosedForm, CenterOfMassPolicyComesFromOutside) {
  // Aimed at the lower plate of two, the hand fits between them; coming from outside it meets the upper one.
  TriangleMesh mesh;
  append(mesh, boxMesh({0.2, 0.2, 0.01}), Eigen::Isometry3d(Eigen::Translation3d(0, 0, -0.105)));
  append(mesh, boxMesh({0.2, 0.2, 0.01}), Eigen::Isometry3d(Eigen::Translation3d(0, 0, 0.105)));
  const ObjectModel plates = makeObject(std::move(mesh));
  const Hand hand = makeFingers(2);
  const GraspCandidate candidate = fromAbove(-0.1);
  GraspTrial inner, outer;
  makeReferencePolicy(hand, plates, PolicyKind::surfaceNormal)->run(candidate, inner);
  const auto policy = makeReferencePolicy(hand, plates, PolicyKind::centerOfMass);
  policy->run(candidate, outer);
  EXPECT_GT(inner.backoff, 0.05);  // the fingertips stand on the lower plate
  EXPECT_LT(inner.backoff, 0.09);
  EXPECT_NEAR(outer.backoff - inner.backoff, 0.21, kTolerance);
  EXPECT_TRUE(policy->approachIsClear(candidate, outer));
  EXPECT_FALSE(policy->approachIsClear(candidate, inner));  // the way in leads through the upper plate
}

// Nothing stands in the way from outside to the target: the hand stops at the smallest back-off, on no step's grid.
TEST(ClosedForm, CenterOfMassPolicyReachesTheSmallestBackoff) {
  const ObjectModel beside = boxObject({0.01, 0.01, 0.3}, Isometry3d(Eigen::Translation3d(0.5, 0, 0)));
  const Hand hand = makeJaw(false);
  for (const double height : {0.0, 0.0123, 0.1}) {
    GraspTrial trial;
    makeReferencePolicy(hand, beside, PolicyKind::centerOfMass)->run(fromAbove(height), trial);
    EXPECT_EQ(trial.backoff, kReference.startBackoff);
  }
}

// Fingers that find nothing pass through each other, and that is told.
TEST(ClosedForm, ClosedEmptyFingersCollide) {
  const ObjectModel faraway = boxObject({0.01, 0.01, 0.01}, Eigen::Isometry3d(Eigen::Translation3d(5, 0, 0)));
  const Hand hand = makeFingers(2);
  const auto policy = makeReferencePolicy(hand, faraway, PolicyKind::surfaceNormal);
  GraspTrial trial;
  policy->run(fromAbove(0), trial);
  EXPECT_TRUE(policy->selfCollides(fromAbove(0), trial));
  trial.jointPosition = hand.preshapes[0].jointPosition;
  EXPECT_FALSE(policy->selfCollides(fromAbove(0), trial));
  for (const ClosingStop& stop : trial.stops) EXPECT_TRUE(stop.links.empty());
}

// Roll 0 points the palm's x axis up where it can; rolls turn it about the approach by the right-hand rule.
TEST(PalmPose, FollowsItsDefinition) {
  const Eigen::Isometry3d X = palmPose({1, 2, 3}, -Vector3d::UnitX(), 0);
  EXPECT_TRUE(X.linear().col(2).isApprox(-Vector3d::UnitX()));
  EXPECT_TRUE(X.linear().col(0).isApprox(Vector3d::UnitZ()));
  EXPECT_NEAR(X.linear().determinant(), 1, 1e-12);
  const Eigen::Isometry3d turned = palmPose({1, 2, 3}, -Vector3d::UnitX(), std::numbers::pi / 2);
  EXPECT_TRUE(turned.linear().col(0).isApprox(-Vector3d::UnitX().cross(Vector3d::UnitZ())));
  EXPECT_TRUE(palmPose({0, 0, 0}, Vector3d::UnitZ(), 0).linear().col(0).isApprox(Vector3d::UnitX()));
}

}  // namespace
}  // namespace handhold
