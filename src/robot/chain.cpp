#include "robot/chain.h"

#include "robot/robot.h"

#include <algorithm>

namespace handhold {

ArmChain makeChain(const Robot& robot, int arm) {
  const Arm& source = robot.arms[arm];
  std::vector<int> links;  // from the one after the base to the tip
  for (int link = source.tipLink; link != source.baseLink; link = robot.body.links[link].parentLink) {
    links.push_back(link);
  }
  std::reverse(links.begin(), links.end());
  ArmChain chain;
  Eigen::Isometry3d& X = chain.X_tip;  // from the last step on
  for (const int index : links) {
    const Link& link = robot.body.links[index];
    if (link.joint < 0) {
      X = X * link.X_PL;
      continue;
    }
    const Joint& joint = robot.body.joints[link.joint];
    chain.steps.push_back({joint.type, X * joint.X_PJ, joint.axis, joint.lower, joint.upper});
    X = Eigen::Isometry3d::Identity();
  }
  return chain;
}

namespace {

/// X <- X M(q), the motion of one joint.
void move(const ArmChain::Step& step, double q, Eigen::Isometry3d& X) {
  if (step.type == JointType::revolute) {
    X.linear() = (X.linear() * Eigen::AngleAxisd(q, step.axis).toRotationMatrix()).eval();
  } else {
    X.translation() += X.linear() * (q * step.axis);
  }
}

}  // namespace

Eigen::Isometry3d tipPose(const ArmChain& chain, const Eigen::VectorXd& q) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const ArmChain::Step& step = chain.steps[i];
    X = X * step.X;
    move(step, q[i], X);
  }
  return X * chain.X_tip;
}

Eigen::Isometry3d tipPose(const ArmChain& chain, const Eigen::VectorXd& q,
                          Eigen::Matrix<double, 6, Eigen::Dynamic>& J) {
  J.resize(6, chain.size());
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const ArmChain::Step& step = chain.steps[i];
    X = X * step.X;
    // The axis, and where it is: the tip's part follows when the tip is known.
    J.col(i) << X.translation(), X.linear() * step.axis;
    move(step, q[i], X);
  }
  X = X * chain.X_tip;
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const Eigen::Vector3d origin = J.col(i).head<3>(), axis = J.col(i).tail<3>();
    if (chain.steps[i].type == JointType::revolute) {
      J.col(i).head<3>() = axis.cross(X.translation() - origin);
    } else {
      J.col(i) << axis, Eigen::Vector3d::Zero();
    }
  }
  return X;
}

Eigen::Vector3d shoulderPoint(const ArmChain& chain) {
  constexpr Eigen::Index kArmJoints = 6, kShoulderJoints = 2;
  constexpr double kParallel = 1e-6;  // relative size of a direction in which the axes leave the point free
  const Eigen::Index first = std::max<Eigen::Index>(0, chain.size() - kArmJoints);
  const Eigen::Index n = std::min(chain.size() - first, kShoulderJoints);
  std::vector<Eigen::Vector3d> origins, axes;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  for (Eigen::Index i = 0; i < first + n; ++i) {
    X = X * chain.steps[i].X;  // at q = 0 no joint moves anything
    if (i < first) continue;
    origins.push_back(X.translation());
    axes.push_back(X.linear() * chain.steps[i].axis);
    mean += X.translation() / static_cast<double>(n);
  }
  // Least squares of the distances to the axes; along what parallel axes leave free, the mean of their origins.
  Eigen::Matrix3d normalMatrix = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - axes[i] * axes[i].transpose();
    normalMatrix += across;
    right += across * (origins[i] - mean);
  }
  Eigen::CompleteOrthogonalDecomposition<Eigen::Matrix3d> solver;
  solver.setThreshold(kParallel);
  solver.compute(normalMatrix);
  return mean + solver.solve(right);
}

}  // namespace handhold
