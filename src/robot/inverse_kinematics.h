#pragma once

#include "robot/chain.h"

#include <memory>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Tolerances and effort of inverse kinematics.
struct IkSettings {
  double linearTolerance = 1e-6;   // m
  double angularTolerance = 1e-6;  // rad
  int restarts = 40;               // numeric: seeds tried after `near`, from a stream keyed by the seed's number
  int iterations = 60;             // numeric: steps a seed
  int leadingSteps = 9;            // closed form with joints in front of its six: values tried for each of them
};

/// All joint positions within the limits that bring the tip of a chain to a pose.
/// Closed form where the last six joints, or all, have three axes that meet in a point (Pieper 1968) and the others are
/// parallel or meet; joints in front of these six are sampled, `near` first. Else damped least squares with restarts.
/// @note Const; safe from many threads. Deterministic: equal questions give equal answers.
class InverseKinematics {
 public:
  virtual ~InverseKinematics() = default;
  /// @param X_AT       wanted pose of the tip in the arm's base, rigid
  /// @param near       (n) the present posture: solutions come nearest first (largest joint change, weights 1)
  /// @param solutions  every one distinct (1e-4), within limits, residual within the tolerances; empty: unreachable, or
  ///                   (numeric) not found
  virtual void solve(const Eigen::Isometry3d& X_AT, const Eigen::VectorXd& near,
                     std::vector<Eigen::VectorXd>& solutions) const = 0;
  /// Is every solution found, up to sampled leading joints?
  virtual bool isClosedForm() const = 0;
};

/// The best that the chain's geometry allows.
std::unique_ptr<InverseKinematics> makeInverseKinematics(const ArmChain& chain, const IkSettings& settings = {});
/// The numeric solver for any chain.
std::unique_ptr<InverseKinematics> makeNumericInverseKinematics(const ArmChain& chain, const IkSettings& settings = {});

/// Follows a tip that moved a little: Newton from `q`, which ends at a solution of X_AT near it. False when the
/// residual stays above the tolerances, a limit stands in the way, or a joint moves by more than `maxStep` [rad or m].
bool followTip(const ArmChain& chain, const Eigen::Isometry3d& X_AT, double maxStep, const IkSettings& settings,
               Eigen::VectorXd& q);

}  // namespace handhold
