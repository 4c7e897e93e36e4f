#include "quality/true_cone.h"

#include "bench/grasp_like_contacts.h"
#include "quality/columns.h"
#include "support/allocations.h"
#include "support/random_contacts.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::randomContacts;

constexpr int kManyEdges = 64;
// What epsilonMetric and the bounds may be off by, R is at most 2 here.
constexpr double kRoundingTol = 4 * kEpsilonTolerance;

WrenchModel model(double friction, int coneEdges = 8, double torqueScale = 1, double torsionRadius = 0) {
  return {{0, 0, 0}, torqueScale, friction, coneEdges, torsionRadius};
}

/// Epsilon of columns; 0 when not closed.
double epsilonOf(const WrenchMatrix& w) {
  const ForceClosureResult closure = testForceClosure(w);
  return closure.verdict == ForceClosure::closed ? epsilonMetric(w, closure) : 0;
}

/// Linearised epsilon; 0 when not closed.
double epsilonWithEdges(const std::vector<Contact>& contacts, const WrenchModel& with) {
  return epsilonOf(frictionConeWrenches(contacts, with));
}

/// Friction of the narrowest cone with so many edges that holds the true one.
double circumscribed(double friction) { return friction / std::cos(std::numbers::pi / kManyEdges); }

/// Contacts of a grasp as large as the unit sphere when scaled, or anywhere on it.
struct Instance {
  std::vector<Contact> contacts;
  double torqueScale;
};
Instance instance(int seed, bool graspLike) {
  const int nContacts = 3 + seed % 8;
  if (graspLike) return {bench::graspLikeContacts(seed, nContacts + 1), 0.09};
  return {randomContacts(seed, nContacts, 0.3), 1};
}

std::vector<Contact> rotated(const std::vector<Contact>& contacts, int seed) {
  const RandomStream stream = RandomStream(seed).child(77);
  const Eigen::Matrix3d r =
      Eigen::AngleAxisd(6.28 * stream.uniform(2), testing::randomUnitVector(stream, 0)).toRotationMatrix();
  std::vector<Contact> turned;
  for (const Contact& contact : contacts) {
    turned.push_back({r * contact.position, (r * contact.normal).normalized(), contact.link});
  }
  return turned;
}

void expectWithinGap(const EpsilonBounds& bounds) {
  EXPECT_EQ(bounds.verdict, ForceClosure::closed);
  EXPECT_GT(bounds.lower, 0);
  EXPECT_LE(bounds.lower, bounds.upper);
  EXPECT_LE(bounds.upper - bounds.lower, kBoundsGap * bounds.upper + kRoundingTol);
}

/// Six contacts in the middle of the faces of the cube of edge 2.
std::vector<Contact> facePairs() {
  std::vector<Contact> contacts;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {1.0, -1.0}) {
      contacts.push_back({side * Eigen::Vector3d::Unit(axis), -side * Eigen::Vector3d::Unit(axis), 0});
    }
  }
  return contacts;
}

/// h(d), equation (11), written with the contacts themselves about the origin, s = 1.
double supportOf(const std::vector<Contact>& contacts, const WrenchModel& with, const Eigen::Matrix<double, 6, 1>& d) {
  double most = -HUGE_VAL;
  for (const Contact& contact : contacts) {
    const Eigen::Vector3d g = d.head<3>() + d.tail<3>().cross(contact.position);
    const double normal = g.dot(contact.normal), twist = with.torsionRadius * d.tail<3>().dot(contact.normal);
    most = std::max(most, normal + with.friction * std::hypot((g - normal * contact.normal).norm(), twist));
  }
  return most;
}

/// The least support of the contacts in random directions and in small steps down from the best of them: an upper
/// bound of epsilon that knows nothing of polytopes.
double leastSupport(const std::vector<Contact>& contacts, const WrenchModel& with, int seed) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  const auto support = [&](const Vector6& d) { return supportOf(contacts, with, d) / d.norm(); };
  const RandomStream stream = RandomStream(seed).child(5);
  Vector6 best = Vector6::Unit(0);
  std::uint64_t counter = 0;
  for (double step = 2; step > 1e-5; step *= 0.9) {
    for (int i = 0; i < 40; ++i) {
      Vector6 d = best;
      for (int k = 0; k < 6; ++k) d[k] += step * (2 * stream.uniform(counter++) - 1);
      if (support(d) < support(best)) best = d.normalized();
    }
  }
  return support(best);
}

// The pair along axis k reaches |d_k| + mu hypot of the two other components, with d_j + (d_tau x p)_j for each. For a
// pure torque b the pair on axis k reaches mu |b without b_k|, most where |b_k| is least: epsilon <= mu sqrt(2/3), at
// b = (1, 1, 1) / sqrt 3. For small mu the torque decides. A pure force a gives max |a_k| + mu |rest| >= 1 / sqrt 3.
TEST(TrueCone, FacePairsOfACube) {
  for (const double friction : {0.05, 0.1, 0.3}) {
    const EpsilonBounds bounds = TrueCones(model(friction)).epsilonBounds(facePairs());
    expectWithinGap(bounds);
    const double torque = friction * std::sqrt(2.0 / 3);
    EXPECT_NEAR(bounds.upper, torque, kBoundsGap * torque + kRoundingTol) << friction;
    // Eight edges are near it only by the luck of their direction.
    EXPECT_LE(epsilonWithEdges(facePairs(), model(friction)), torque + kRoundingTol);
  }
}

// Two pairs of opposed contacts on a square, pressed with friction mu: the force across the square and the torque about
// the lines that join the pairs come from friction alone, and vanish with it. Any friction closes six of them.
TEST(TrueCone, FacePairsNeedFrictionOnlyForTorque) {
  const CriticalFriction critical = TrueCones(model(0.5)).criticalFriction(facePairs());
  EXPECT_EQ(critical.verdict, ForceClosure::closed);
  EXPECT_LE(critical.friction, kLeastFriction);
}

// Two rings of three contacts about the z axis, all normals leaning by `lean` to +z, at z = +-0.5: along -z nothing
// pushes until friction exceeds the lean, tan(lean). (The normal force n and friction must add up to f_z < 0.)
TEST(TrueCone, LeaningRingsCloseAtTheirSlope) {
  for (const double slope : {0.1, 0.25, 0.4}) {
    std::vector<Contact> contacts;
    for (int i = 0; i < 6; ++i) {
      const double angle = 2 * std::numbers::pi * (i % 3 + 0.5 * (i / 3)) / 3;
      const Eigen::Vector3d out(std::cos(angle), std::sin(angle), 0);
      contacts.push_back({out + (i < 3 ? 0.5 : -0.5) * Eigen::Vector3d::UnitZ(),
                          (-out + slope * Eigen::Vector3d::UnitZ()).normalized(), 0});
    }
    const CriticalFriction critical = TrueCones(model(0.8)).criticalFriction(contacts);
    EXPECT_EQ(critical.verdict, ForceClosure::closed);
    EXPECT_LE(critical.below, slope + 1e-9);
    EXPECT_GE(critical.friction, slope - 1e-9);
    EXPECT_LE(critical.friction - critical.below, kFrictionTolerance);
    EXPECT_EQ(TrueCones(model(0.999 * slope)).testForceClosure(contacts), ForceClosure::notClosed);
    EXPECT_EQ(TrueCones(model(1.001 * slope)).testForceClosure(contacts), ForceClosure::closed);
  }
}

// An inscribed and a circumscribed cone of many edges hold the true epsilon between them.
TEST(TrueConeBounds, LieBetweenManyEdges) {
  int nClosed = 0;
  for (int seed = 0; seed < 2000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = instance(seed, seed % 2 == 1);
    const double friction = 0.3 + 0.1 * (seed % 4);
    const EpsilonBounds bounds = TrueCones(model(friction, 8, set.torqueScale)).epsilonBounds(set.contacts);
    ASSERT_NE(bounds.verdict, ForceClosure::failed);
    const double inside = epsilonWithEdges(set.contacts, model(friction, kManyEdges, set.torqueScale));
    const double outside = epsilonWithEdges(set.contacts, model(circumscribed(friction), kManyEdges, set.torqueScale));
    EXPECT_GE(bounds.upper, inside - kRoundingTol);
    EXPECT_LE(bounds.lower, outside + kRoundingTol);
    if (bounds.verdict == ForceClosure::notClosed) {
      EXPECT_EQ(inside, 0);
      EXPECT_EQ(bounds.upper, 0);
      continue;
    }
    expectWithinGap(bounds);
    ++nClosed;
  }
  EXPECT_GT(nClosed, 1000);
  EXPECT_LT(nClosed, 1900);
}

// h written with the contact points themselves, searched without a polytope: never below the lower bound, and near it.
TEST(TrueConeBounds, NoDirectionIsWeaker) {
  for (int seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const std::vector<Contact> contacts = randomContacts(seed, 5 + seed % 4, 0.3);
    const EpsilonBounds bounds = TrueCones(model(0.5)).epsilonBounds(contacts);
    if (bounds.verdict != ForceClosure::closed) continue;
    EXPECT_GE(leastSupport(contacts, model(0.5), seed), bounds.lower - kRoundingTol);
  }
}

// Turned together about the object, contacts keep their bounds; eight edges do not, since tangents follow the normals.
TEST(TrueConeBounds, InvariantWhenContactsTurn) {
  double mostOfEight = 0;
  int nClosed = 0;
  for (int seed = 0; seed < 400; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = instance(seed, seed % 2 == 1);
    const std::vector<Contact> turned = rotated(set.contacts, seed);
    TrueCones cones(model(0.5, 8, set.torqueScale));
    const EpsilonBounds bounds = cones.epsilonBounds(set.contacts), after = cones.epsilonBounds(turned);
    ASSERT_EQ(bounds.verdict, after.verdict);
    if (bounds.verdict != ForceClosure::closed) continue;
    ++nClosed;
    EXPECT_NEAR(after.lower, bounds.lower, 2 * kBoundsGap * bounds.upper + kRoundingTol);
    EXPECT_NEAR(after.upper, bounds.upper, 2 * kBoundsGap * bounds.upper + kRoundingTol);
    const CriticalFriction critical = cones.criticalFriction(set.contacts), then = cones.criticalFriction(turned);
    EXPECT_NEAR(critical.friction, then.friction, kFrictionTolerance);
    const double eight = epsilonWithEdges(set.contacts, model(0.5, 8, set.torqueScale));
    const double eightAfter = epsilonWithEdges(turned, model(0.5, 8, set.torqueScale));
    mostOfEight = std::max(mostOfEight, std::abs(eightAfter - eight) / bounds.upper);
  }
  EXPECT_GT(nClosed, 150);
  EXPECT_GT(mostOfEight, 0.05);
}

TEST(TrueConeBounds, DoNotFallWithFriction) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = instance(seed, seed % 2 == 1);
    double before = 0;
    for (const double friction : {0.2, 0.3, 0.5, 0.8, 1.2}) {
      const EpsilonBounds bounds = TrueCones(model(friction, 8, set.torqueScale)).epsilonBounds(set.contacts);
      ASSERT_NE(bounds.verdict, ForceClosure::failed);
      EXPECT_GE(bounds.upper, before - kRoundingTol) << "friction " << friction;
      before = bounds.lower;
    }
  }
}

// The linearised test agrees on both sides of the critical friction: inscribed cones above, circumscribed ones below.
TEST(TrueConeCriticalFriction, IsConfirmedByManyEdges) {
  int nClosed = 0;
  for (int seed = 0; seed < 1000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = instance(seed, seed % 2 == 1);
    TrueCones cones(model(0.6, 8, set.torqueScale));
    const CriticalFriction critical = cones.criticalFriction(set.contacts);
    ASSERT_NE(critical.verdict, ForceClosure::failed);
    ASSERT_EQ(critical.verdict, cones.testForceClosure(set.contacts));
    if (critical.verdict != ForceClosure::closed) {
      EXPECT_TRUE(std::isnan(critical.friction));
      continue;
    }
    ++nClosed;
    EXPECT_GT(critical.friction, 0);
    EXPECT_LE(critical.friction, 0.6);
    EXPECT_LE(critical.friction - critical.below, kFrictionTolerance);
    const auto verdict = [&](double friction) {
      return testForceClosure(frictionConeWrenches(set.contacts, model(friction, kManyEdges, set.torqueScale))).verdict;
    };
    if (critical.friction <= kLeastFriction) continue;  // closed with hardly any friction
    EXPECT_EQ(verdict(1.01 * critical.friction), ForceClosure::closed);
    EXPECT_EQ(verdict(circumscribed(0.99 * critical.friction)), ForceClosure::notClosed);
  }
  EXPECT_GT(nClosed, 500);
}

// A flat or broken set is no grasp, and never a number that is none.
TEST(TrueConeDegenerate, EndInNotClosed) {
  const std::vector<Contact> pair = {{{1, 0, 0}, {-1, 0, 0}, 0}, {{-1, 0, 0}, {1, 0, 0}, 0}};
  const std::vector<Contact> same(5, Contact{{1, 0, 0}, {-1, 0, 0}, 0});
  std::vector<Contact> line = pair;  // all on one line: no torque about it
  for (const double x : {0.5, -0.5}) line.push_back({{x, 0, 0}, {0, x > 0 ? 1.0 : -1.0, 0}, 0});
  for (const std::vector<Contact>& contacts : {std::vector<Contact>{}, pair, same, line}) {
    SCOPED_TRACE(std::to_string(contacts.size()) + " contacts");
    TrueCones cones(model(0.5));
    EXPECT_EQ(cones.testForceClosure(contacts), ForceClosure::notClosed);
    const EpsilonBounds bounds = cones.epsilonBounds(contacts);
    EXPECT_EQ(bounds.verdict, ForceClosure::notClosed);
    EXPECT_EQ(bounds.lower, 0);
    EXPECT_EQ(bounds.upper, 0);
    EXPECT_EQ(cones.criticalFriction(contacts).verdict, ForceClosure::notClosed);
    EXPECT_EQ(TrueCones(model(0)).testForceClosure(contacts), ForceClosure::notClosed);
  }
  std::vector<Contact> broken = facePairs();
  broken[2].position.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(TrueCones(model(0.5)).epsilonBounds(broken).verdict, ForceClosure::failed);
  EXPECT_EQ(TrueCones(model(0.5)).criticalFriction(broken).verdict, ForceClosure::failed);
}

// Symmetric sets put many wrenches into one plane; contacts that differ by about the tolerance tear the horizon.
TEST(TrueConeDegenerate, RepeatedContactsChangeNothing) {
  for (int digits = 6; digits <= 17; ++digits) {
    SCOPED_TRACE("noise 1e-" + std::to_string(digits));
    const double noise = digits == 17 ? 0 : std::pow(10.0, -digits);
    std::vector<Contact> contacts;
    for (int copy = 0; copy < 3; ++copy) {
      for (Contact contact : facePairs()) {
        contact.position += noise * testing::randomUnitVector(RandomStream(digits), 2 * contacts.size());
        contacts.push_back(contact);
      }
    }
    const EpsilonBounds bounds = TrueCones(model(0.3)).epsilonBounds(contacts);
    expectWithinGap(bounds);
    const double torque = 0.3 * std::sqrt(2.0 / 3);
    EXPECT_NEAR(bounds.upper, torque, kBoundsGap * torque + 10 * noise + kRoundingTol);
  }
}

// ---- Soft fingers ----------------------------------------------------------------------------------------------

constexpr int kMeridians = 48, kParallels = 24;
/// The hull of the wrenches below holds the ellipsoids of this share of the friction: a point of the unit sphere is at
/// most half a step in latitude and half a step in longitude from one of theirs.
const double kInscribedShare =
    std::cos(0.5 * std::numbers::pi / kParallels) + std::cos(std::numbers::pi / kMeridians) - 1;

/// Wrenches on the ellipsoids, dense, by other tangents and another order than frictionConeWrenches.
WrenchMatrix ellipsoidWrenches(const std::vector<Contact>& contacts, const WrenchModel& with) {
  std::vector<Eigen::Vector3d> sphere = {{0, 0, 1}, {0, 0, -1}};
  for (int i = 1; i < kParallels; ++i) {
    const double latitude = std::numbers::pi * (static_cast<double>(i) / kParallels - 0.5);
    for (int j = 0; j < kMeridians; ++j) {
      const double longitude = 2 * std::numbers::pi * j / kMeridians;
      sphere.emplace_back(std::cos(latitude) * std::cos(longitude), std::cos(latitude) * std::sin(longitude),
                          std::sin(latitude));
    }
  }
  WrenchMatrix w(6, static_cast<Eigen::Index>(contacts.size() * sphere.size()));
  Eigen::Index column = 0;
  for (const Contact& contact : contacts) {
    const Eigen::Vector3d t = contact.normal.unitOrthogonal(), b = contact.normal.cross(t);
    for (const Eigen::Vector3d& x : sphere) {
      const Eigen::Vector3d force = contact.normal + with.friction * (x.x() * t + x.y() * b);
      const Eigen::Vector3d moment = with.friction * with.torsionRadius * x.z() * contact.normal;
      w.col(column++) << force, (contact.position.cross(force) + moment) / with.torqueScale;
    }
  }
  return w;
}

/// Two to six contacts: pairs that nearly oppose each other, contacts on a sphere, a hand about a bottle.
Instance softInstance(int seed) {
  if (seed % 3 == 0) {
    const RandomStream stream = RandomStream(seed).child(9);
    const Eigen::Vector3d axis = testing::randomUnitVector(stream, 0);
    Instance pair{{}, 0.09};
    for (const double side : {1.0, -1.0}) {
      const std::uint64_t counter = side > 0 ? 2 : 6;
      pair.contacts.push_back({0.035 * side * axis + 0.01 * testing::randomUnitVector(stream, counter),
                               (-side * axis + 0.3 * testing::randomUnitVector(stream, counter + 2)).normalized(), 0});
    }
    return pair;
  }
  const int nContacts = 2 + seed % 5;
  if (seed % 3 == 1) return {bench::graspLikeContacts(seed, nContacts), 0.09};
  return {randomContacts(seed, nContacts, 0.3), 1};
}
WrenchModel softModel(const Instance& set, double friction, double share = 0.06) {
  return model(friction, 8, set.torqueScale, share * set.torqueScale);
}

// Points on a line cannot turn about it. Soft fingers do, and that moment, mu e, is what they are weakest at: any other
// direction has friction over the arm (1) or the force beside it.
TEST(SoftFinger, TwoOpposedContactsAreForceClosed) {
  const std::vector<Contact> pair = {{{1, 0, 0}, {-1, 0, 0}, 0}, {{-1, 0, 0}, {1, 0, 0}, 0}};
  EXPECT_EQ(TrueCones(model(0.5)).testForceClosure(pair), ForceClosure::notClosed);
  for (const double torsionRadius : {0.01, 0.1}) {
    const WrenchModel soft = model(0.5, 8, 1, torsionRadius);
    TrueCones cones(soft);
    EXPECT_EQ(cones.testForceClosure(pair), ForceClosure::closed);
    const EpsilonBounds bounds = cones.epsilonBounds(pair);
    expectWithinGap(bounds);
    EXPECT_NEAR(bounds.upper, 0.5 * torsionRadius, kBoundsGap * bounds.upper + kRoundingTol);
    const double linearised = epsilonWithEdges(pair, soft);
    EXPECT_GT(linearised, 0);
    EXPECT_LE(linearised, bounds.upper + kRoundingTol);
    EXPECT_LE(cones.criticalFriction(pair).friction, kLeastFriction);
    EXPECT_EQ(cones.testForceClosure(std::vector<Contact>{pair[0]}), ForceClosure::notClosed);
  }
}

// The closed form of the support is that of the ellipsoids.
TEST(SoftFinger, SupportIsThatOfManyWrenches) {
  const RandomStream stream(11);
  for (int seed = 0; seed < 30; ++seed) {
    const std::vector<Contact> contacts = randomContacts(seed, 4, 0.3);
    const WrenchModel with = model(0.6, 8, 1, 0.3);
    const WrenchMatrix w = ellipsoidWrenches(contacts, with);
    Eigen::Matrix<double, 6, 1> d;
    for (int k = 0; k < 6; ++k) d[k] = 2 * stream.uniform(6 * static_cast<std::uint64_t>(seed) + k) - 1;
    const double most = (d.transpose() * w).maxCoeff(), wanted = supportOf(contacts, with, d);
    EXPECT_LE(most, wanted + 1e-14);
    EXPECT_GE(most, wanted - (1 - kInscribedShare) * 0.6 * 3 * d.norm());  // |t|, |b|, |r| add up to less than 3
  }
}

// Dense wrenches on the ellipsoids and the same pushed out until they hold the ellipsoids have the true epsilon between
// them, and eight edges are inside.
TEST(SoftFinger, BoundsLieBetweenManyWrenches) {
  int nClosed = 0;
  for (int seed = 0; seed < 120; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = softInstance(seed);
    const WrenchModel with = softModel(set, 0.3 + 0.1 * (seed % 4));
    WrenchModel wide = with;
    wide.friction /= kInscribedShare;
    const EpsilonBounds bounds = TrueCones(with).epsilonBounds(set.contacts);
    ASSERT_NE(bounds.verdict, ForceClosure::failed);
    const double inside = epsilonOf(ellipsoidWrenches(set.contacts, with));
    EXPECT_GE(bounds.upper, inside - kRoundingTol);
    EXPECT_LE(bounds.lower, epsilonOf(ellipsoidWrenches(set.contacts, wide)) + kRoundingTol);
    EXPECT_GE(bounds.upper, epsilonWithEdges(set.contacts, with) - kRoundingTol);
    if (bounds.verdict != ForceClosure::closed) continue;
    expectWithinGap(bounds);
    if (set.torqueScale == 1) {
      EXPECT_GE(leastSupport(set.contacts, with, seed), bounds.lower - kRoundingTol);
    }
    ++nClosed;
  }
  EXPECT_GT(nClosed, 60);
  EXPECT_LT(nClosed, 118);
}

TEST(SoftFinger, InvariantWhenContactsTurn) {
  int nClosed = 0;
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = softInstance(seed);
    TrueCones cones(softModel(set, 0.5));
    const std::vector<Contact> turned = rotated(set.contacts, seed);
    const EpsilonBounds bounds = cones.epsilonBounds(set.contacts), after = cones.epsilonBounds(turned);
    ASSERT_EQ(bounds.verdict, after.verdict);
    if (bounds.verdict != ForceClosure::closed) continue;
    ++nClosed;
    EXPECT_NEAR(after.lower, bounds.lower, 2 * kBoundsGap * bounds.upper + kRoundingTol);
    EXPECT_NEAR(after.upper, bounds.upper, 2 * kBoundsGap * bounds.upper + kRoundingTol);
    EXPECT_NEAR(cones.criticalFriction(set.contacts).friction, cones.criticalFriction(turned).friction,
                kFrictionTolerance);
  }
  EXPECT_GT(nClosed, 100);
}

// Dense wrenches 1 % above the critical friction are closed, those that hold the ellipsoids 1 % below are not.
TEST(SoftFinger, CriticalFrictionIsConfirmedByManyWrenches) {
  int nChecked = 0;
  for (int seed = 0; seed < 150; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = softInstance(seed);
    const WrenchModel with = softModel(set, 0.6);
    const CriticalFriction critical = TrueCones(with).criticalFriction(set.contacts);
    ASSERT_NE(critical.verdict, ForceClosure::failed);
    if (critical.verdict != ForceClosure::closed || critical.friction <= kLeastFriction) continue;
    ++nChecked;
    const auto verdict = [&](double friction) {
      return testForceClosure(ellipsoidWrenches(set.contacts, softModel(set, friction))).verdict;
    };
    EXPECT_EQ(verdict(1.01 * critical.friction), ForceClosure::closed);
    EXPECT_EQ(verdict(0.99 * critical.friction / kInscribedShare), ForceClosure::notClosed);
  }
  EXPECT_GT(nChecked, 60);
}

// A moment of mu e / s more moves no support, and so no epsilon, by more. A radius that vanishes beside rounding gives
// the point contact's bits.
TEST(SoftFinger, BecomesThePointContact) {
  int nClosed = 0;
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance set = instance(seed, seed % 2 == 1);
    const auto boundsAt = [&](double share) {
      return TrueCones(softModel(set, 0.5, share)).epsilonBounds(set.contacts);
    };
    const EpsilonBounds point = boundsAt(0), vanishing = boundsAt(1e-200);
    EXPECT_EQ(vanishing.verdict, point.verdict);
    EXPECT_EQ(vanishing.lower, point.lower);
    EXPECT_EQ(vanishing.upper, point.upper);
    EXPECT_EQ(vanishing.facets, point.facets);
    double before = point.lower;
    for (const double share : {1e-9, 1e-6, 1e-3, 1e-1}) {
      const EpsilonBounds soft = boundsAt(share);
      EXPECT_GE(soft.upper, before - kRoundingTol) << share;
      EXPECT_LE(soft.lower, point.upper + 0.5 * share + kRoundingTol) << share;
      before = soft.lower;
    }
    nClosed += point.verdict == ForceClosure::closed;
  }
  EXPECT_GT(nClosed, 50);
}

TEST(TrueConeInstructionSets, GiveEqualBits) {
  using polar::InstructionSet;
  if (polar::instructionSet() == InstructionSet::baseline) GTEST_SKIP() << "this machine has one set only";
  for (int seed = 0; seed < 1000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance some = instance(seed, seed % 2 == 1);
    const WrenchModel asked = model(0.4, 8, some.torqueScale, seed % 4 < 2 ? 0 : 0.05 * some.torqueScale);
    TrueCones plain(asked, InstructionSet::baseline), fast(asked, InstructionSet::avx2);
    const EpsilonBounds bounds = plain.epsilonBounds(some.contacts), b = fast.epsilonBounds(some.contacts);
    EXPECT_EQ(b.verdict, bounds.verdict);
    EXPECT_EQ(b.lower, bounds.lower);
    EXPECT_EQ(b.upper, bounds.upper);
    EXPECT_EQ(b.facets, bounds.facets);
    const CriticalFriction critical = plain.criticalFriction(some.contacts), c = fast.criticalFriction(some.contacts);
    EXPECT_EQ(c.verdict, critical.verdict);
    if (c.verdict != ForceClosure::closed) continue;
    EXPECT_EQ(c.below, critical.below);
    EXPECT_EQ(c.friction, critical.friction);
  }
}

TEST(TrueCone, SecondPassAllocatesNothing) {
  if (!testing::countsAllocations()) GTEST_SKIP() << "a sanitizer has its own malloc";
  std::vector<std::vector<Contact>> sets;
  for (int seed = 0; seed < 60; ++seed) sets.push_back(randomContacts(seed, 3 + seed % 9, 0.3));
  sets.push_back(facePairs());
  TrueCones cones(model(0.5));
  double sum[2] = {0, 0};
  for (int pass = 0; pass < 2; ++pass) {
    const long before = testing::allocations();
    for (const std::vector<Contact>& contacts : sets) {
      const EpsilonBounds bounds = cones.epsilonBounds(contacts);
      const CriticalFriction critical = cones.criticalFriction(contacts);
      if (bounds.verdict == ForceClosure::closed) sum[pass] += bounds.lower + bounds.upper + critical.friction;
    }
    if (pass == 1) {
      EXPECT_EQ(testing::allocations() - before, 0);
    }
  }
  EXPECT_GT(sum[0], 1);
  EXPECT_EQ(sum[0], sum[1]);
}

}  // namespace
}  // namespace handhold
