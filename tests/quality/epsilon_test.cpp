#include "quality/cone_wrenches.h"
#include "quality/force_closure.h"
#include "quality/proof.h"
#include "quality/references.h"
#include "support/allocations.h"
#include "support/random_contacts.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/QR>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::qhullEpsilon;
using testing::randomContacts;
using testing::wrenchesOf;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// A facet's plane comes from at most a hundred interpolations, each good to a few units in the last place; and the
// expansion stops when no column is farther than 1e-12 R beyond it.
constexpr double kRoundingTol = 4e-12;
// Qhull merges what lies within its own rounding, about 1e-14 for these sizes.
constexpr double kQhullTol = 1e-9;

double epsilon(const WrenchMatrix& wrenches) { return epsilonMetric(wrenches, testForceClosure(wrenches)); }

/// The corners of {-1, 1}^6.
WrenchMatrix cubeCorners() {
  WrenchMatrix w(6, 64);
  for (int j = 0; j < 64; ++j) {
    for (int k = 0; k < 6; ++k) w(k, j) = (j >> k & 1) ? 1 : -1;
  }
  return w;
}

WrenchMatrix crossPolytope(double radius) {
  WrenchMatrix w(6, 12);
  w << radius * Matrix6::Identity(), -radius * Matrix6::Identity();
  return w;
}

Matrix6 randomRotation(int seed) {
  Matrix6 random;
  for (int k = 0; k < 36; ++k) random.data()[k] = RandomStream(seed).uniform(k) - 0.5;
  return Eigen::HouseholderQR<Matrix6>(random).householderQ();
}

/// One to four contacts on each face of the cube of edge 2, all in symmetric places.
std::vector<Contact> boxContacts(int perSide) {
  std::vector<Contact> contacts;
  for (int face = 0; face < 6; ++face) {
    const int axis = face % 3;
    const double side = face < 3 ? 1 : -1;
    for (int k = 0; k < perSide * perSide; ++k) {
      Eigen::Vector3d p = Eigen::Vector3d::Zero();
      p[axis] = side;
      p[(axis + 1) % 3] = 0.5 * (k % perSide - 0.5 * (perSide - 1));
      p[(axis + 2) % 3] = 0.5 * (k / perSide - 0.5 * (perSide - 1));
      contacts.push_back({p, -side * Eigen::Vector3d::Unit(axis), 0});
    }
  }
  return contacts;
}

// Its facets are x . (+-1 .. +-1) = r.
TEST(Epsilon, CrossPolytope) {
  for (const double r : {1e-3, 1.0, 7.0}) EXPECT_NEAR(epsilon(crossPolytope(r)) / r, 1 / std::sqrt(6.0), kRoundingTol);
}

// 12 facets of 32 corners each: nearly every plane that is tried is shared by many wrenches.
TEST(Epsilon, CubeCorners) { EXPECT_NEAR(epsilon(cubeCorners()), 1, kRoundingTol); }

TEST(Epsilon, CubeCornersTimesFour) { EXPECT_NEAR(epsilon(cubeCorners().replicate(1, 4)), 1, kRoundingTol); }

// A box about the origin: the nearest face decides.
TEST(Epsilon, BoxOfUnequalSides) {
  const Vector6 below = (Vector6() << -1, -2, -0.3, -4, -5, -6).finished();
  const Vector6 above = (Vector6() << 2, 0.7, 3, 0.25, 9, 6).finished();
  WrenchMatrix w(6, 64);
  for (int j = 0; j < 64; ++j) {
    for (int k = 0; k < 6; ++k) w(k, j) = (j >> k & 1) ? above[k] : below[k];
  }
  EXPECT_NEAR(epsilon(w), 0.25, kRoundingTol);
}

// The regular simplex with corners on the unit sphere: v_i . v_j = -1/6, so each facet lies 1/6 from the centre.
TEST(Epsilon, RegularSimplex) {
  Matrix6 gram = Matrix6::Constant(-1.0 / 6);
  gram.diagonal().setOnes();
  WrenchMatrix w(6, 7);
  w.leftCols(6) = gram.llt().matrixU();
  w.col(6) = -w.leftCols(6).rowwise().sum();
  EXPECT_NEAR(epsilon(w), 1.0 / 6, kRoundingTol);
}

// All of {-1, 0, 1}^6, most of it inside or in the middle of facets and ridges.
TEST(Epsilon, LatticeOfTheCube) {
  WrenchMatrix w(6, 729);
  for (int j = 0, digits = 0; j < 729; digits = ++j) {
    for (int k = 0; k < 6; ++k, digits /= 3) w(k, j) = digits % 3 - 1;
  }
  EXPECT_NEAR(epsilon(w), 1, kRoundingTol);
}

// The cube moved until the origin nearly leaves it.
TEST(Epsilon, SmallRadii) {
  for (const double depth : {1e-3, 1e-6, 1e-8}) {
    WrenchMatrix w = cubeCorners();
    w.row(0).array() += 1 - depth;
    EXPECT_NEAR(epsilon(w), depth, kRoundingTol) << depth;
    EXPECT_NEAR(epsilon(randomRotation(1) * w), depth, kRoundingTol) << depth;
  }
}

// Pure torque d = (0; b): the face pair along axis i offers mu |b_k| for k other than i, so that
// epsilon <= mu max |b_k| at b = (1, 1, 1) / sqrt 3; four edges along the axes.
TEST(Epsilon, SixContactsOnASphereAreBoundedByTorque) {
  const double value = epsilon(wrenchesOf(boxContacts(1), 0.3, 4));
  EXPECT_GT(value, 0);
  EXPECT_LE(value, 0.3 / std::sqrt(3.0) + kRoundingTol);
  EXPECT_NEAR(value, qhullEpsilon(wrenchesOf(boxContacts(1), 0.3, 4)), kQhullTol);
}

TEST(Epsilon, SymmetricBoxAgainstQhull) {
  for (const int edges : {3, 4, 6}) {
    for (const int perSide : {1, 2}) {
      const WrenchMatrix w = wrenchesOf(boxContacts(perSide), 0.5, edges);
      EXPECT_NEAR(epsilon(w), qhullEpsilon(w), kQhullTol) << edges << " edges, " << perSide * perSide << " a side";
    }
  }
}

TEST(Epsilon, OnlyOfClosedSets) {
  EXPECT_TRUE(std::isnan(epsilon(WrenchMatrix(6, 0))));
  EXPECT_TRUE(std::isnan(epsilon(wrenchesOf({}))));
  EXPECT_TRUE(std::isnan(epsilon(crossPolytope(1).leftCols(11))));
  WrenchMatrix w = crossPolytope(1);
  const ForceClosureResult closure = testForceClosure(w);
  w(2, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(epsilonMetric(w, closure)));
}

// Past trouble by design: noise about as large as the tolerance tears the horizon, and the shifted tries must mend it.
TEST(EpsilonDegenerate, NoiseOfEverySizeOnAnOvercrowdedCube) {
  for (int digits = 6; digits <= 16; ++digits) {
    const double noise = std::pow(10.0, -digits);
    for (int seed = 0; seed < 30; ++seed) {
      SCOPED_TRACE("noise 1e-" + std::to_string(digits) + ", seed " + std::to_string(seed));
      WrenchMatrix w = cubeCorners().replicate(1, 3);
      const RandomStream stream = RandomStream(digits).child(seed);
      for (int i = 0; i < w.size(); ++i) w.data()[i] += noise * (2 * stream.uniform(i) - 1);
      const double radius = w.colwise().norm().maxCoeff();
      EXPECT_NEAR(epsilon(w), 1, std::sqrt(6.0) * noise + kEpsilonTolerance * radius);
    }
  }
}

// The sign and the value, over contacts that make closed, open and flat sets.
TEST(EpsilonAgainstQhull, AgreesOnRandomContacts) {
  int nClosed = 0, nFlat = 0;
  for (int seed = 0; seed < 1000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = wrenchesOf(randomContacts(seed, 2 + seed % 7, 0.3), 0.4, 4 + seed % 2);
    const ForceClosure verdict = testing::provedVerdict(w);
    const double reference = qhullEpsilon(w);
    if (std::isnan(reference)) {  // Qhull refuses flat sets
      EXPECT_FALSE(testing::hasFullRank(w));
      EXPECT_EQ(verdict, ForceClosure::notClosed);
      ++nFlat;
      continue;
    }
    EXPECT_EQ(verdict, reference > kSeparationTolerance ? ForceClosure::closed : ForceClosure::notClosed);
    if (verdict != ForceClosure::closed) continue;
    EXPECT_NEAR(epsilon(w), reference, kQhullTol);
    ++nClosed;
  }
  EXPECT_GT(nClosed, 300);
  EXPECT_GT(nFlat, 50);
  EXPECT_LT(nClosed + nFlat, 900);
}

TEST(EpsilonAgainstQhull, AgreesOnManyContacts) {
  for (const int nContacts : {10, 14, 18}) {
    for (int seed = 0; seed < 4; ++seed) {
      SCOPED_TRACE(std::to_string(nContacts) + " contacts, seed " + std::to_string(seed));
      const WrenchMatrix w = wrenchesOf(randomContacts(seed, nContacts, 0.4), 0.5, 8);
      EXPECT_NEAR(epsilon(w), qhullEpsilon(w), kQhullTol);
    }
  }
}

// The wider friction cone contains the narrower one: with equal edges every old generator is a mixture of new ones.
TEST(EpsilonProperty, DoesNotFallWithFriction) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const std::vector<Contact> contacts = randomContacts(seed, 4 + seed % 4, 0.3);
    double before = 0;
    for (const double friction : {0.2, 0.4, 0.7, 1.1}) {
      const WrenchMatrix w = wrenchesOf(contacts, friction, 6);
      const bool closed = testing::provedVerdict(w) == ForceClosure::closed;
      const double now = closed ? epsilon(w) : 0;
      EXPECT_GE(now, before - kRoundingTol) << "friction " << friction;
      before = now;
    }
  }
}

TEST(EpsilonProperty, InvariantUnderRotationOrderAndUnit) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = wrenchesOf(randomContacts(seed, 4 + seed % 6, 0.3), 0.5);
    if (testing::provedVerdict(w) != ForceClosure::closed) continue;
    const double value = epsilon(w);
    EXPECT_NEAR(epsilon(randomRotation(seed) * w), value, kRoundingTol);
    EXPECT_NEAR(epsilon(w.rowwise().reverse()), value, kRoundingTol);
    EXPECT_NEAR(epsilon(1e-6 * w) * 1e6, value, kRoundingTol);
    EXPECT_NEAR(epsilon(1e6 * w) * 1e-6, value, kRoundingTol);
    EXPECT_NEAR(epsilon(w.replicate(1, 2)), value, kRoundingTol);
  }
}

// From contacts to verdict and epsilon, as a worker does it: once it has seen the sizes, nothing comes from the heap.
TEST(EpsilonProperty, SecondPassAllocatesNothing) {
  if (!testing::countsAllocations()) GTEST_SKIP() << "a sanitizer has its own malloc";
  std::vector<std::vector<Contact>> sets;
  for (int seed = 0; seed < 60; ++seed) sets.push_back(randomContacts(seed, 3 + seed % 6, 0.3));
  sets.push_back(boxContacts(2));
  FrictionCones cones({{0, 0, 0}, 1, 0.5, 8});
  double sum[2] = {0, 0};
  for (int pass = 0; pass < 2; ++pass) {
    const long before = testing::allocations();
    for (const std::vector<Contact>& contacts : sets) {
      const WrenchView w = cones.wrenches(contacts);
      const ForceClosureResult closure = testForceClosure(w);
      if (closure.verdict == ForceClosure::closed) sum[pass] += epsilonMetric(w, closure);
    }
    if (pass == 1) {
      EXPECT_EQ(testing::allocations() - before, 0);
    } else {
      EXPECT_GT(testing::allocations() - before, 0);
    }
  }
  EXPECT_GT(sum[0], 1);
  EXPECT_EQ(sum[0], sum[1]);
}

// A hull only grows with more points, and a point inside changes nothing.
TEST(EpsilonProperty, GrowsWithContactsOnly) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const std::vector<Contact> contacts = randomContacts(seed, 8, 0.3);
    const WrenchMatrix all = wrenchesOf(contacts, 0.5);
    const WrenchMatrix few = all.leftCols(8 * 5);
    if (testing::provedVerdict(few) != ForceClosure::closed) continue;
    EXPECT_GE(epsilon(all), epsilon(few) - kRoundingTol);
    WrenchMatrix more(6, 48);
    more << few, 0.5 * few.leftCols(8) + 0.5 * few.rightCols(8);
    EXPECT_NEAR(epsilon(more), epsilon(few), kRoundingTol);
  }
}

// No plane that holds all wrenches is nearer: epsilon = min over unit d of max d . w, tried on random d.
TEST(EpsilonProperty, NoDirectionIsWeaker) {
  for (int seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = wrenchesOf(randomContacts(seed, 6, 0.3), 0.5);
    if (testing::provedVerdict(w) != ForceClosure::closed) continue;
    const double value = epsilon(w);
    for (int i = 0; i < 100; ++i) {
      const Vector6 d = randomRotation(100 * seed + i).col(0);
      EXPECT_GE((d.transpose() * w).maxCoeff(), value - kRoundingTol);
    }
  }
}

}  // namespace
}  // namespace handhold
