#include "quality/force_closure.h"

#include "quality/columns.h"
#include "quality/cone_wrenches.h"
#include "quality/proof.h"
#include "quality/references.h"
#include "support/random_contacts.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <Eigen/QR>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::provedVerdict;
using testing::randomContacts;
using testing::wrenchesOf;

// GLPK stops at 1e-9 and its margin is a weight of at most 1 / n; no random set of ours has one between.
constexpr double kGlpkMargin = 1e-10;

/// Contacts at the corners of a regular n-gon on the unit circle in the xy plane, pressing towards its centre.
std::vector<Contact> ring(int nContacts) {
  std::vector<Contact> contacts;
  for (int i = 0; i < nContacts; ++i) {
    const double angle = 2 * std::numbers::pi * i / nContacts;
    const Eigen::Vector3d p(std::cos(angle), std::sin(angle), 0);
    contacts.push_back({p, -p, 0});
  }
  return contacts;
}

std::array<std::uint64_t, 6> bits(const Eigen::Matrix<double, 6, 1>& v) {
  return std::bit_cast<std::array<std::uint64_t, 6>>(std::array{v[0], v[1], v[2], v[3], v[4], v[5]});
}

// Two opposed point contacts cannot resist a torque about the line between them.
TEST(ForceClosure, TwoOpposedPointContactsAreNotClosed) {
  for (const double friction : {0.0, 0.1, 0.8, 5.0}) {
    for (int edges = 3; edges < 13; ++edges) {
      EXPECT_EQ(provedVerdict(wrenchesOf(ring(2), friction, edges)), ForceClosure::notClosed);
    }
  }
}

// Three contacts around the equator hold with friction; without, no force leaves the plane.
TEST(ForceClosure, ThreeContactsOnTheEquatorNeedFriction) {
  EXPECT_EQ(provedVerdict(wrenchesOf(ring(3), 0.4)), ForceClosure::closed);
  EXPECT_EQ(provedVerdict(wrenchesOf(ring(3), 0.01)), ForceClosure::closed);
  EXPECT_EQ(provedVerdict(wrenchesOf(ring(3), 0)), ForceClosure::notClosed);
}

// Symmetric sets are where the simplex method cycles.
TEST(ForceClosure, SymmetricRingsAreClosed) {
  for (int nContacts = 3; nContacts <= 40; ++nContacts) {
    for (int edges = 3; edges <= 8; ++edges) {
      EXPECT_EQ(provedVerdict(wrenchesOf(ring(nContacts), 0.5, edges)), ForceClosure::closed)
          << nContacts << " " << edges;
    }
  }
}

TEST(ForceClosure, NoneAndOneAreNotClosed) {
  EXPECT_EQ(provedVerdict(WrenchMatrix(6, 0)), ForceClosure::notClosed);
  EXPECT_EQ(provedVerdict(WrenchMatrix::Zero(6, 20)), ForceClosure::notClosed);
  EXPECT_EQ(provedVerdict(WrenchMatrix::Ones(6, 1)), ForceClosure::notClosed);
  EXPECT_EQ(provedVerdict(wrenchesOf(ring(1))), ForceClosure::notClosed);
}

// Six columns and fewer never surround the origin; they may cancel exactly.
TEST(ForceClosure, CancellingColumnsOfLowRankAreNotClosed) {
  for (int pairs = 1; pairs <= 5; ++pairs) {
    WrenchMatrix w(6, 2 * pairs);
    w << WrenchMatrix::Identity(6, pairs), -WrenchMatrix::Identity(6, pairs);
    EXPECT_EQ(provedVerdict(w), ForceClosure::notClosed) << pairs;
  }
}

TEST(ForceClosure, DegenerateContactsAreNotClosed) {
  std::vector<Contact> collinear, onePoint, sameNormal, frictionless;
  for (const Contact& contact : randomContacts(3, 12)) {
    collinear.push_back({contact.position.x() * Eigen::Vector3d(0.6, 0.48, 0.64), contact.normal, 0});
    onePoint.push_back({{0.3, 0.2, -0.1}, contact.normal, 0});
    sameNormal.push_back({contact.position, {0.6, 0, 0.8}, 0});
    frictionless.push_back(contact);
  }
  EXPECT_EQ(provedVerdict(wrenchesOf(collinear)), ForceClosure::notClosed);  // no torque about the line
  EXPECT_EQ(provedVerdict(wrenchesOf(onePoint)), ForceClosure::notClosed);   // no torque about the point
  EXPECT_EQ(provedVerdict(wrenchesOf(sameNormal)), ForceClosure::notClosed);
  EXPECT_EQ(provedVerdict(wrenchesOf(frictionless, 0)), ForceClosure::notClosed);  // a sphere spins freely
}

TEST(ForceClosure, DuplicatedContactsChangeNothing) {
  for (int seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::vector<Contact> contacts = randomContacts(seed, 4, 0.3);
    const ForceClosure once = provedVerdict(wrenchesOf(contacts));
    const std::vector<Contact> copy = contacts;
    for (int repeat = 0; repeat < 3; ++repeat) contacts.insert(contacts.end(), copy.begin(), copy.end());
    EXPECT_EQ(provedVerdict(wrenchesOf(contacts)), once);
  }
}

TEST(ForceClosure, ColumnsThatAreNotFiniteFail) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), HUGE_VAL, -HUGE_VAL}) {
    for (const int where : {0, 17, 6 * 24 - 1}) {
      WrenchMatrix w = wrenchesOf(ring(3));
      w.data()[where] = bad;
      EXPECT_EQ(testForceClosure(w).verdict, ForceClosure::failed);
    }
  }
}

// The cube {-1, 1}^6 moved along x: the origin leaves it at 1.
TEST(ForceClosure, OriginNearTheBoundary) {
  for (const double depth : {1e-3, 1e-6, 1e-8, 2.5e-9, 0.0, -1e-12, -1e-9, -1e-6}) {
    SCOPED_TRACE("depth " + std::to_string(depth));
    WrenchMatrix w(6, 64);
    for (int j = 0; j < 64; ++j) {
      for (int k = 0; k < 6; ++k) w(k, j) = ((j >> k & 1) ? 1 : -1) + (k == 0 ? 1 - depth : 0);
    }
    EXPECT_EQ(provedVerdict(w), depth > 0 ? ForceClosure::closed : ForceClosure::notClosed);
  }
}

// Noise of 1e-16 in a flat set must not pass for a sixth dimension.
TEST(ForceClosure, RoundingIsNoDimension) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream stream(seed);
    std::vector<Contact> contacts = ring(2);
    const Eigen::Vector3d axis = testing::randomUnitVector(stream, 0);
    contacts[0] = {axis, -axis, 0};
    contacts[1] = {-axis, axis, 0};
    contacts.push_back({0.3 * axis, testing::randomUnitVector(stream, 2), 0});  // on the same line
    EXPECT_EQ(provedVerdict(wrenchesOf(contacts, 0.7)), ForceClosure::notClosed);
  }
}

// The verdict does not hang on the basis or the unit in which wrenches are written.
TEST(ForceClosureProperty, RotationAndScaleChangeNothing) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = wrenchesOf(randomContacts(seed, 2 + seed % 6, 0.3));
    const ForceClosure verdict = provedVerdict(w);
    Eigen::Matrix<double, 6, 6> random;
    for (int k = 0; k < 36; ++k) random.data()[k] = RandomStream(seed).uniform(k) - 0.5;
    const Eigen::Matrix<double, 6, 6> rotation =
        Eigen::HouseholderQR<Eigen::Matrix<double, 6, 6>>(random).householderQ();
    EXPECT_EQ(provedVerdict(rotation * w), verdict);
    EXPECT_EQ(provedVerdict(1e-12 * w), verdict);
    EXPECT_EQ(provedVerdict(1e12 * w), verdict);
    EXPECT_EQ(provedVerdict(w.rowwise().reverse()), verdict);
  }
}

// Among equal columns the first one enters: padding and copies behind it are never named.
TEST(ForceClosureProperty, CopiesAreNeverInTheBasis) {
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = wrenchesOf(randomContacts(seed, 5, 0.3), 0.5, 3 + seed % 6);
    const ForceClosureResult result = testForceClosure(w.replicate(1, 3));
    if (result.verdict != ForceClosure::closed) continue;
    for (const int column : result.basis) EXPECT_LT(column, w.cols());
  }
}

/// Closed, open, flat, duplicated and badly scaled sets, of every number of columns up to 8 x 8.
WrenchMatrix variedWrenches(int seed) {
  const int nContacts = 1 + seed % 8;
  WrenchMatrix w = wrenchesOf(randomContacts(seed, nContacts, 0.1 * (seed % 5)), 0.1 * (seed % 7), 3 + seed / 8 % 6);
  if (seed % 11 == 0) w.rightCols(w.cols() / 2) = w.leftCols(w.cols() / 2).eval();
  if (seed % 13 == 0) w.row(seed % 6) *= 1e-9;
  if (seed % 17 == 0) w.row(seed % 6).setZero();
  if (seed % 19 == 0) w *= std::pow(10.0, seed % 60 - 30);
  return w;
}

// One binary, equal datasets on every machine: each instruction set that this machine has gives the same bits.
TEST(InstructionSets, GiveEqualBitsOnTenThousandSets) {
  using polar::InstructionSet;
  if (polar::instructionSet() == InstructionSet::baseline) GTEST_SKIP() << "this machine has one set only";
  int nClosed = 0;
  for (int seed = 0; seed < 10000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = variedWrenches(seed);
    const ForceClosureResult baseline = polar::testForceClosure(w, InstructionSet::baseline);
    const double epsilon = polar::epsilonMetric(w, baseline, InstructionSet::baseline);
    nClosed += baseline.verdict == ForceClosure::closed;
    const ForceClosureResult result = polar::testForceClosure(w, InstructionSet::avx2);
    ASSERT_EQ(result.verdict, baseline.verdict);
    ASSERT_EQ(result.basis, baseline.basis);
    ASSERT_EQ(bits(result.interiorPoint), bits(baseline.interiorPoint));
    ASSERT_EQ(bits(result.separatingDirection), bits(baseline.separatingDirection));
    ASSERT_EQ(std::bit_cast<std::uint64_t>(polar::epsilonMetric(w, result, InstructionSet::avx2)),
              std::bit_cast<std::uint64_t>(epsilon));
  }
  EXPECT_GT(nClosed, 2000);
  EXPECT_LT(nClosed, 8000);
}

// The definition in DESIGN.md: rank W = 6 and max t > 0.
TEST(ForceClosureAgainstGlpk, AgreesOnRandomContacts) {
  int nClosed = 0;
  for (int seed = 0; seed < 1000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = wrenchesOf(randomContacts(seed, 2 + seed % 7, 0.3), 0.1 + 0.1 * (seed % 5), 3 + seed % 6);
    const double margin = testing::glpkMargin(w);
    ASSERT_FALSE(std::isnan(margin));
    const bool closed = testing::hasFullRank(w) && margin > kGlpkMargin;
    EXPECT_EQ(provedVerdict(w), closed ? ForceClosure::closed : ForceClosure::notClosed) << "margin " << margin;
    nClosed += closed;
  }
  EXPECT_GT(nClosed, 200);  // both answers are tried
  EXPECT_LT(nClosed, 800);
}

}  // namespace
}  // namespace handhold
