#include "simulate/actuation.h"

#include "core/random.h"
#include "support/toy_hands.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kStep = 1e-6;           // rad or m, of the differences
constexpr double kDifferenceTol = 1e-8;  // m: their error is step^2, rounding is 1e-16 / step

Hand shipped(const std::string& name) { return loadHand(HANDHOLD_SOURCE_DIR "/hands/" + name); }

VectorXd randomPosition(const Hand& hand, const RandomStream& stream) {
  VectorXd q(hand.joints.size());
  for (Eigen::Index j = 0; j < q.size(); ++j) {
    const Joint& joint = hand.joints[static_cast<std::size_t>(j)];
    q[j] = joint.lower + (joint.upper - joint.lower) * stream.uniform(static_cast<std::uint64_t>(j));
  }
  return followMimics(hand, q);
}

/// A contact on every link, anywhere near it.
std::vector<Contact> contactsOnLinks(const Hand& hand, const VectorXd& q, const Eigen::Isometry3d& X_OH) {
  const std::vector<Eigen::Isometry3d> X_HL = forwardKinematics(hand, q);
  std::vector<Contact> contacts;
  for (std::size_t link = 0; link < hand.links.size(); ++link) {
    const Vector3d p = X_OH * X_HL[link] * Vector3d(0.01, -0.02, 0.03);
    contacts.push_back({p, Vector3d::UnitX(), static_cast<std::uint16_t>(link)});
  }
  return contacts;
}

/// Central difference of the contact points, carried by their links, along a change of the joints: (3, nContacts).
Eigen::MatrixXd pointVelocities(const Hand& hand, const VectorXd& q, const VectorXd& dq, const Eigen::Isometry3d& X_OH,
                                const std::vector<Contact>& contacts) {
  const auto at = [&](double step) { return forwardKinematics(hand, q + step * dq); };
  const auto now = at(0), before = at(-kStep), after = at(kStep);
  Eigen::MatrixXd velocity(3, contacts.size());
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const std::size_t link = contacts[i].link;
    const Vector3d p = (X_OH * now[link]).inverse() * contacts[i].position;
    velocity.col(static_cast<Eigen::Index>(i)) = (X_OH * (after[link] * p) - X_OH * (before[link] * p)) / (2 * kStep);
  }
  return velocity;
}

/// Velocities of the contact points by a column of the actuation.
Eigen::MatrixXd pointVelocities(const Actuation& actuation, Eigen::Index column, const std::vector<Contact>& contacts,
                                const Vector3d& center) {
  Eigen::MatrixXd velocity(3, contacts.size());
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    const auto twist = actuation.motion.col(column).segment<6>(6 * static_cast<Eigen::Index>(i));
    velocity.col(static_cast<Eigen::Index>(i)) = twist.head<3>() + twist.tail<3>().cross(contacts[i].position - center);
  }
  return velocity;
}

/// Of a joint by itself or with all that follow it.
VectorXd direction(const Hand& hand, std::size_t joint, bool withFollowers) {
  VectorXd dq = VectorXd::Unit(static_cast<Eigen::Index>(hand.joints.size()), static_cast<Eigen::Index>(joint));
  if (withFollowers) {
    const VectorXd zero = VectorXd::Zero(dq.size());
    dq = followMimics(hand, dq) - followMimics(hand, zero);
  }
  return dq;
}

class ShippedHands : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Actuation, ShippedHands, ::testing::Values("barrett", "hrp2", "jaw"));

// The limits, joint by joint: each drive with its followers, each follower alone; against differences of the
// kinematics.
TEST_P(ShippedHands, MotionsAreDerivativesOfTheKinematics) {
  const Hand hand = shipped(GetParam());
  for (int seed = 0; seed < 5; ++seed) {
    const RandomStream stream = RandomStream(7).child(static_cast<std::uint64_t>(seed));
    const VectorXd q = randomPosition(hand, stream);
    Eigen::Isometry3d X_OH(Eigen::AngleAxisd(1 + seed, Vector3d(1, 2, -1).normalized()));
    X_OH.translation() = Vector3d(0.1, -0.05, 0.2);
    const Vector3d center(0.02, 0.03, -0.04);
    const std::vector<Contact> contacts = contactsOnLinks(hand, q, X_OH);
    const Actuation actuation = actuationOf(hand, q, X_OH, contacts, center);
    ASSERT_EQ(actuation.motion.cols(), static_cast<Eigen::Index>(hand.joints.size()));  // all have efforts
    for (std::size_t j = 0; j < hand.joints.size(); ++j) {
      const bool isDrive = hand.joints[j].mimicOf < 0;
      const Eigen::MatrixXd expected = pointVelocities(hand, q, direction(hand, j, isDrive), X_OH, contacts);
      const Eigen::MatrixXd found = pointVelocities(actuation, static_cast<Eigen::Index>(j), contacts, center);
      EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), kDifferenceTol) << hand.joints[j].name;
      EXPECT_EQ(actuation.effort[static_cast<Eigen::Index>(j)], hand.joints[j].effort);
    }
  }
}

// A distal joint that went on alone no longer loads the drive of the joint before it.
TEST(Actuation, AnOpenClutchIsADriveOfItsOwn) {
  const Hand hand = shipped("barrett");
  const auto indexOfJoint = [&](const std::string& name) {
    std::size_t i = 0;
    while (hand.joints[i].name != name) ++i;
    return i;
  };
  const std::size_t finger = indexOfJoint("finger_1"), distal = indexOfJoint("finger_1_distal");
  VectorXd q = VectorXd::Zero(static_cast<Eigen::Index>(hand.joints.size()));
  q[static_cast<Eigen::Index>(finger)] = 0.8;
  q = followMimics(hand, q);
  q[static_cast<Eigen::Index>(distal)] += 1e-7;  // a position stored as a 32-bit float
  for (const bool isOpen : {false, true}) {
    if (isOpen) q[static_cast<Eigen::Index>(distal)] += 0.2;
    const Eigen::Isometry3d X_OH = Eigen::Isometry3d::Identity();
    const std::vector<Contact> contacts = contactsOnLinks(hand, q, X_OH);
    const Actuation actuation = actuationOf(hand, q, X_OH, contacts, Vector3d::Zero());
    ASSERT_EQ(actuation.motion.cols(), static_cast<Eigen::Index>(hand.joints.size()));
    const Eigen::MatrixXd found =
        pointVelocities(actuation, static_cast<Eigen::Index>(finger), contacts, Vector3d::Zero());
    const Eigen::MatrixXd expected = pointVelocities(hand, q, direction(hand, finger, !isOpen), X_OH, contacts);
    EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), kDifferenceTol);
    EXPECT_EQ(actuation.effort[static_cast<Eigen::Index>(distal)], hand.joints[distal].effort);
  }
}

TEST(Actuation, JointsWithoutEffortOrContactLimitNothing) {
  Hand hand = testing::makeJaw(true);
  const VectorXd q = VectorXd::Constant(2, 0.02);
  const std::vector<Contact> contacts = contactsOnLinks(hand, q, Eigen::Isometry3d::Identity());
  const auto limits = [&](const std::vector<Contact>& some) {
    return actuationOf(hand, q, Eigen::Isometry3d::Identity(), some, Vector3d::Zero());
  };
  EXPECT_FALSE(hasEffortLimits(hand));
  EXPECT_EQ(limits(contacts).effort.size(), 0);
  EXPECT_EQ(limits(contacts).motion.rows(), 6 * static_cast<Eigen::Index>(contacts.size()));
  hand.joints[0].effort = 20;  // the drive: both jaws
  EXPECT_TRUE(hasEffortLimits(hand));
  ASSERT_EQ(limits(contacts).effort.size(), 1);
  EXPECT_EQ(limits(contacts).effort[0], 20);
  EXPECT_EQ(limits({contacts[0]}).effort.size(), 0);  // the palm
  ASSERT_EQ(limits({contacts[2]}).effort.size(), 1);  // the follower loads its drive
  hand.joints[1].effort = 12;                         // and its own transmission
  ASSERT_EQ(limits({contacts[2]}).effort.size(), 2);
  EXPECT_EQ(limits({contacts[1]}).effort.size(), 1);
  EXPECT_EQ(limits({}).effort.size(), 0);
}

// The coupled jaw about a box: by hand, its pads press with half the drive's force each.
TEST(Actuation, LoadOfACoupledJaw) {
  Hand hand = testing::makeJaw(true);
  hand.joints[0].effort = 20;
  const VectorXd q = VectorXd::Constant(2, 0.02);
  std::vector<Contact> contacts;
  for (const double y : {-0.01, 0.01}) {
    for (const double z : {0.02, 0.04}) {
      contacts.push_back({{0.02, y, z}, {-1, 0, 0}, 1});
      contacts.push_back({{-0.02, y, z}, {1, 0, 0}, 2});
    }
  }
  const Vector3d center(0, 0, 0.03);
  TaskWrenches weight(6, 2);
  weight << Vector3d::UnitY(), -Vector3d::UnitZ(), Eigen::Matrix<double, 3, 2>::Zero();
  LoadMarginSolver solver({center, 0.03, 0.4, 8});
  const Actuation actuation = actuationOf(hand, q, Eigen::Isometry3d::Identity(), contacts, center);
  EXPECT_NEAR(solver.solve(contacts, actuation, weight).load, 2 * 0.4 * 10, 1e-5);
}

}  // namespace
}  // namespace handhold
