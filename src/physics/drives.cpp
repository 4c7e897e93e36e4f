#include "physics/drives.h"

#include "quality/force_closure.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

using Eigen::Vector3d;

// A closing joint has the reflected inertia of a geared motor; one that closing does not move that of a worm gear.
constexpr double kTurnStiffness = 20, kTurnArmature = 0.005;    // N m / rad, kg m^2
constexpr double kSlideStiffness = 2000, kSlideArmature = 0.3;  // N / m, kg
constexpr double kHeld = 20;                                    // times the inertia and 60 times the stiffness
constexpr double kOverdamped = 1.2;

constexpr double kFriction = 0.3, kTorqueLength = 0.05;
constexpr double kSumWeight = 0.09, kSizeWeight = 0.001;
constexpr int kSweeps = 300;

Drive makeDrive(const Hand& hand, int index, bool holds) {
  const Joint& joint = hand.joints[index];
  Drive drive;
  drive.joint = index;
  drive.holds = holds;
  const bool turns = joint.type == JointType::revolute;
  drive.armature = (turns ? kTurnArmature : kSlideArmature) * (holds ? kHeld : 1);
  drive.stiffness = (turns ? kTurnStiffness : kSlideStiffness) * (holds ? 3 * kHeld : 1);
  drive.damping = kOverdamped * 2 * std::sqrt(drive.stiffness * drive.armature);
  drive.effort = holds ? 0 : joint.effort;
  return drive;
}

/// The x of equation (2), by coordinate descent.
Eigen::VectorXd balance(const WrenchMatrix& W) {
  const Eigen::Index n = W.cols();
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
  Eigen::Matrix<double, 6, 1> wrench = Eigen::Matrix<double, 6, 1>::Zero();  // W x
  double sum = 0;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    double change = 0;
    for (Eigen::Index i = 0; i < n; ++i) {
      const double slope = W.col(i).dot(wrench) + kSumWeight * (sum - 1) + kSizeWeight * x[i];
      const double curvature = W.col(i).squaredNorm() + kSumWeight + kSizeWeight;
      const double step = std::max(-slope / curvature, -x[i]);
      x[i] += step;
      wrench += step * W.col(i);
      sum += step;
      change = std::max(change, std::abs(step));
    }
    if (change < 1e-9) break;
  }
  return x;
}

/// Force times motion: what the joint must exert for its links to press with the forces f (O frame) at the contacts.
double jointTorque(const Hand& hand, int index, const std::vector<Eigen::Isometry3d>& X_OL,
                   std::span<const Contact> contacts, const std::vector<Vector3d>& forces) {
  const Joint& joint = hand.joints[index];
  const Eigen::Isometry3d X_OJ = X_OL[joint.parentLink] * joint.X_PJ;
  const Vector3d axis = X_OJ.linear() * joint.axis;
  const std::vector<bool> moves = linksMovedBy(hand, index, false);
  double torque = 0;
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    if (!moves[contacts[i].link]) continue;
    const Vector3d motion =
        joint.type == JointType::revolute ? axis.cross(contacts[i].position - X_OJ.translation()) : axis;
    torque += motion.dot(forces[i]);
  }
  return torque;
}

}  // namespace

std::vector<Drive> drivesOf(const Hand& hand) {
  std::vector<bool> isBreakaway(hand.joints.size(), false), closes(hand.joints.size(), false);
  for (const ClosingJoint& closing : hand.closing) {
    closes[closing.joint] = true;
    if (closing.breakawayJoint >= 0) isBreakaway[closing.breakawayJoint] = closes[closing.breakawayJoint] = true;
  }
  std::vector<Drive> drives;
  std::vector<int> driveOf(hand.joints.size(), -1);
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    // A chain of mimics ends at a joint of its own, or at one that can break away.
    double multiplier = 1;
    int driver = static_cast<int>(i);
    while (hand.joints[driver].mimicOf >= 0 && !isBreakaway[driver]) {
      multiplier *= hand.joints[driver].mimicMultiplier;
      driver = hand.joints[driver].mimicOf;
    }
    const bool follows = driver != static_cast<int>(i) && closes[driver];
    if (!follows) {
      driveOf[i] = static_cast<int>(drives.size());
      drives.push_back(makeDrive(hand, static_cast<int>(i), !closes[i]));
      if (isBreakaway[i]) drives.back().breaksFrom = hand.joints[i].mimicOf;
    } else {
      if (driveOf[driver] < 0) {
        driveOf[driver] = static_cast<int>(drives.size());
        drives.push_back(makeDrive(hand, driver, false));
      }
      drives[driveOf[driver]].followers.emplace_back(static_cast<int>(i), multiplier);
    }
  }
  return drives;
}

double closingTarget(const Hand& hand, const Drive& drive, const GraspPosture& posture, double s) {
  const auto breakawayOf = [&](int joint) {
    for (const ClosingJoint& closing : hand.closing) {
      if (closing.joint == joint) return closing.breakawayJoint;
    }
    return -1;
  };
  const double from = posture.preshape[drive.joint], to = posture.joints[drive.joint];
  const bool isOuter = drive.breaksFrom >= 0;
  const int outer = isOuter ? drive.joint : breakawayOf(drive.joint);
  if (outer < 0) return std::lerp(from, to, s);
  const int inner = isOuter ? drive.breaksFrom : drive.joint;
  const Joint& joint = hand.joints[outer];
  const double coupled =
      std::clamp(joint.mimicMultiplier * posture.joints[inner] + joint.mimicOffset, joint.lower, joint.upper);
  const double first = std::abs(posture.joints[inner] - posture.preshape[inner]);
  const double second = std::abs(posture.joints[outer] - coupled);
  const double way = s * (first + second);
  const double innerShare = first > 0 ? std::min(1.0, way / first) : 1;
  if (!isOuter) return std::lerp(from, to, innerShare);
  const double outerShare = second > 0 ? std::max(0.0, way - first) / second : 1;
  return std::lerp(from, coupled, innerShare) + outerShare * (to - coupled);
}

Squeeze balancedSqueeze(const Hand& hand, const std::vector<Drive>& drives, const GraspPosture& posture,
                        const Vector3d& centerOfMass, double normalForce) {
  Squeeze squeeze;
  squeeze.torque = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(drives.size()));
  if (posture.contacts.empty()) return squeeze;
  const WrenchMatrix W = frictionConeWrenches(posture.contacts, {centerOfMass, kTorqueLength, kFriction, 8, 0});
  const Eigen::VectorXd x = balance(W);
  const double sum = x.sum();
  if (sum <= 0) return squeeze;
  const Eigen::Index edges = W.cols() / static_cast<Eigen::Index>(posture.contacts.size());
  std::vector<Vector3d> forces(posture.contacts.size(), Vector3d::Zero());
  for (Eigen::Index i = 0; i < W.cols(); ++i) forces[i / edges] += x[i] * W.col(i).head<3>();
  std::vector<Eigen::Isometry3d> X_OL = forwardKinematics(hand, posture.joints);
  for (Eigen::Isometry3d& X : X_OL) X = posture.X_OH * X;
  double scale = normalForce / sum;
  for (std::size_t d = 0; d < drives.size(); ++d) {
    double& torque = squeeze.torque[static_cast<Eigen::Index>(d)];
    torque = jointTorque(hand, drives[d].joint, X_OL, posture.contacts, forces);
    for (const auto& [joint, multiplier] : drives[d].followers) {
      torque += multiplier * jointTorque(hand, joint, X_OL, posture.contacts, forces);
    }
    if (drives[d].effort > 0 && std::abs(torque) * scale > drives[d].effort) {
      scale = drives[d].effort / std::abs(torque);
    }
  }
  squeeze.torque *= scale;
  squeeze.normalForce = scale * sum;
  squeeze.residual = (W * x).norm() / sum;
  return squeeze;
}

}  // namespace handhold
