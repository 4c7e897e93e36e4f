#include "quality/force_closure.h"
#include "support/random_contacts.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace handhold {
namespace {

// A dozen products of numbers near one: rounding stays below 20 units in the last place.
constexpr double kRoundingTol = 5e-15;

// The contact at +x pushes along -x; its tangents are then +-y and +-z, and only the torque p x f / s is left to check.
TEST(FrictionConeWrenches, OneContactIsAsByHand) {
  const std::vector<Contact> contacts = {{{3, 0, 0}, {-1, 0, 0}, 0}};
  const WrenchMatrix w = frictionConeWrenches(contacts, {{1, 0, 0}, 2, 0.5, 4});
  ASSERT_EQ(w.cols(), 4);
  for (int j = 0; j < 4; ++j) {
    SCOPED_TRACE("edge " + std::to_string(j));
    EXPECT_NEAR(w(0, j), -1, kRoundingTol);
    EXPECT_NEAR(std::hypot(w(1, j), w(2, j)), 0.5, kRoundingTol);
    EXPECT_NEAR(std::abs(w(1, j)) + std::abs(w(2, j)), 0.5, kRoundingTol);  // along an axis
    EXPECT_NEAR(w(3, j), 0, kRoundingTol);
    EXPECT_NEAR(w(4, j), -w(2, j), kRoundingTol);  // (2, 0, 0) x f / 2 = (0, -f_z, f_y)
    EXPECT_NEAR(w(5, j), w(1, j), kRoundingTol);
  }
}

// Columns come contact by contact, and the arm is taken from the centre of mass.
TEST(FrictionConeWrenches, ColumnsFollowTheContacts) {
  const std::vector<Contact> contacts = testing::randomContacts(1, 5, 0.4);
  const WrenchModel model{{0.1, -0.2, 0.3}, 1.7, 0.6, 6};
  const WrenchMatrix w = frictionConeWrenches(contacts, model);
  ASSERT_EQ(w.cols(), 30);
  for (int i = 0; i < 5; ++i) {
    const WrenchMatrix alone = frictionConeWrenches(std::vector<Contact>{contacts[i]}, model);
    EXPECT_EQ(alone, w.middleCols(6 * i, 6)) << "contact " << i;
  }
}

void expectCone(const Contact& contact, double friction) {
  const int m = 7;
  const WrenchMatrix w = frictionConeWrenches(std::vector<Contact>{contact}, {{0, 0, 0}, 1, friction, m});
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int j = 0; j < m; ++j) {
    const Eigen::Vector3d f = w.col(j).head<3>();
    const Eigen::Vector3d next = w.col((j + 1) % m).head<3>();
    EXPECT_NEAR(f.dot(contact.normal), 1, kRoundingTol);
    EXPECT_NEAR((f - contact.normal).norm(), friction, kRoundingTol);
    EXPECT_NEAR((next - f).norm(), 2 * friction * std::sin(std::numbers::pi / m), kRoundingTol);
    sum += f;
  }
  EXPECT_NEAR((sum / m - contact.normal).norm(), 0, kRoundingTol);
}

// Every generator has normal component 1 and tangential length mu, and the edges are evenly spread: the tangents are
// orthonormal, also where the formula changes branch (n_z = 0, -0) and at both poles.
TEST(FrictionConeWrenches, ConesAreRegular) {
  const double tiny = 1e-200;
  for (const Eigen::Vector3d& n : std::vector<Eigen::Vector3d>{{0, 0, 1},
                                                               {0, 0, -1},
                                                               {1, 0, 0.0},
                                                               {1, 0, -0.0},
                                                               {0, -1, tiny},
                                                               {0, -1, -tiny},
                                                               {0.6, 0.8, 0},
                                                               {1e-9, 0, -1}}) {
    SCOPED_TRACE(::testing::PrintToString(n.transpose()));
    expectCone({{0.3, -0.4, 0.5}, n, 0}, 0.8);
  }
  for (const Contact& contact : testing::randomContacts(7, 100)) expectCone(contact, 0.4);
}

/// Is w = (n + mu (x t + y b); arm x f + mu z e n / s) with x^2 + y^2 + z^2 = 1?
void expectOnEllipsoid(const Eigen::Matrix<double, 6, 1>& w, const Contact& contact, const WrenchModel& model) {
  const Eigen::Vector3d f = w.head<3>(), arm = (contact.position - model.centerOfMass) / model.torqueScale;
  const Eigen::Vector3d moment = (w.tail<3>() - arm.cross(f)) * model.torqueScale;  // N m, about the contact
  const double along = moment.dot(contact.normal);
  EXPECT_NEAR(f.dot(contact.normal), 1, kRoundingTol);
  EXPECT_NEAR((moment - along * contact.normal).norm(), 0, kRoundingTol);
  const double tangential = (f - contact.normal).norm() / model.friction;
  EXPECT_NEAR(std::hypot(tangential, along / (model.friction * model.torsionRadius)), 1, 1e-12);
}

// The edges of the point contact come first, what is added lies on the ellipsoid too, and the poles are among it.
TEST(SoftFingerWrenches, LieOnTheEllipsoid) {
  const WrenchModel point{{0.1, -0.2, 0.3}, 1.7, 0.6, 7};
  WrenchModel soft = point;
  soft.torsionRadius = 0.05;
  for (const Contact& contact : testing::randomContacts(3, 50, 0.4)) {
    const std::vector<Contact> one = {contact};
    const WrenchMatrix w = frictionConeWrenches(one, soft);
    ASSERT_EQ(w.cols(), 3 * 7 + 2);
    EXPECT_EQ(w.leftCols(7), frictionConeWrenches(one, point));
    double most = 0, least = 0;
    for (int j = 0; j < w.cols(); ++j) {
      expectOnEllipsoid(w.col(j), contact, soft);
      const Eigen::Vector3d arm = (contact.position - soft.centerOfMass) / soft.torqueScale;
      const double moment = (w.col(j).tail<3>() - arm.cross(w.col(j).head<3>())).dot(contact.normal);
      most = std::max(most, moment);
      least = std::min(least, moment);
    }
    EXPECT_NEAR(most, 0.6 * 0.05 / 1.7, kRoundingTol);
    EXPECT_NEAR(least, -0.6 * 0.05 / 1.7, kRoundingTol);
  }
}

// How far the generators of eight edges reach at least, of the ellipsoid: 0.885. Without the two parallels at 45
// degrees it would be 0.68, and what forces and moments do together would be the worst part of a grasp.
TEST(SoftFingerWrenches, FillTheEllipsoid) {
  const WrenchModel model{{0, 0, 0}, 1, 1, 8, 1};
  const std::vector<Contact> contacts = {{{0, 0, 0}, {0, 0, 1}, 0}};  // its wrenches are (x, y, 1; 0, 0, z)
  const WrenchMatrix w = frictionConeWrenches(contacts, model);
  const RandomStream stream(1);
  double all = 1, withoutParallels = 1;
  for (int i = 0; i < 20'000; ++i) {
    const Eigen::Vector3d d = testing::randomUnitVector(stream, 2 * static_cast<std::uint64_t>(i));
    double reach = -1, ofFew = -1;
    for (int j = 0; j < w.cols(); ++j) {
      const double value = d.x() * w(0, j) + d.y() * w(1, j) + d.z() * w(5, j);
      reach = std::max(reach, value);
      const bool isParallel = std::abs(std::abs(w(5, j)) - std::sqrt(0.5)) < 1e-9;
      if (!isParallel) ofFew = std::max(ofFew, value);
    }
    all = std::min(all, reach);
    withoutParallels = std::min(withoutParallels, ofFew);
  }
  EXPECT_NEAR(all, 0.885, 0.005);
  EXPECT_NEAR(withoutParallels, 0.68, 0.005);
}

// Kept memory holds nothing of the sets before, whatever their size.
TEST(FrictionConeWrenches, AreTheSameInKeptMemory) {
  const WrenchModel model{{0.1, -0.2, 0.3}, 1.7, 0.6, 6};
  FrictionCones cones(model);
  for (const int nContacts : {5, 12, 0, 3, 5}) {
    const std::vector<Contact> contacts = testing::randomContacts(7, nContacts, 0.4);
    EXPECT_EQ(WrenchMatrix(cones.wrenches(contacts)), frictionConeWrenches(contacts, model));
  }
}

TEST(FrictionConeWrenches, NoContactsGiveNoColumns) { EXPECT_EQ(frictionConeWrenches({}, {}).cols(), 0); }

TEST(FrictionConeWrenches, NotANumberStaysVisible) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Contact> contacts = {{{1, 0, 0}, {nan, 0, 0}, 0}};
  EXPECT_TRUE(frictionConeWrenches(contacts, {}).col(0).hasNaN());
}

}  // namespace
}  // namespace handhold
