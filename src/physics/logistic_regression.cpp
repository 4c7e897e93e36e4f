#include "physics/logistic_regression.h"

#include <cmath>

#include <Eigen/Cholesky>

namespace handhold {
namespace {

constexpr int kMostIterations = 100, kMostHalvings = 40;
constexpr double kSumRounding = 1e-13;  // of the sum, relative
constexpr double kConverged = 1e-10;    // of the gradient, an observation

/// log(1 + exp(z)) without overflow.
double softplus(double z) { return std::max(z, 0.0) + std::log1p(std::exp(-std::abs(z))); }

/// Equation (1), with the intercept in front of the coefficients and a column of ones in front of X.
struct Objective {
  Eigen::MatrixXd X;        // (n, 1 + k)
  Eigen::VectorXd y, pull;  // pull: the ridge of each coefficient, 0 for the intercept

  double value(const Eigen::VectorXd& b) const {
    const Eigen::VectorXd z = X * b;
    double sum = 0.5 * b.cwiseAbs2().dot(pull);
    for (Eigen::Index i = 0; i < z.size(); ++i) sum += softplus(z[i]) - y[i] * z[i];
    return sum;
  }

  Eigen::VectorXd probabilities(const Eigen::VectorXd& b) const { return 1 / (1 + (-(X * b)).array().exp()); }
};

}  // namespace

LogisticFit fitLogistic(const Eigen::MatrixXd& X, const Eigen::VectorXd& y, double ridge) {
  const Eigen::Index n = X.rows(), k = X.cols();
  Objective objective{Eigen::MatrixXd(n, 1 + k), y, Eigen::VectorXd::Constant(1 + k, ridge)};
  objective.X << Eigen::VectorXd::Ones(n), X;
  objective.pull[0] = 0;
  LogisticFit fit;
  Eigen::VectorXd b = Eigen::VectorXd::Zero(1 + k);
  double value = objective.value(b);
  for (;; ++fit.iterations) {
    const Eigen::VectorXd p = objective.probabilities(b);
    const Eigen::VectorXd gradient = objective.X.transpose() * (p - y) + objective.pull.cwiseProduct(b);
    fit.gradient = gradient.cwiseAbs().maxCoeff();
    if (fit.gradient <= kConverged * static_cast<double>(n) || fit.iterations == kMostIterations) break;
    const Eigen::VectorXd weights = p.array() * (1 - p.array());
    Eigen::MatrixXd hessian = objective.X.transpose() * weights.asDiagonal() * objective.X;
    hessian.diagonal() += objective.pull;
    const Eigen::VectorXd step = hessian.ldlt().solve(gradient);
    double length = 1;
    const double highest = value + kSumRounding * std::max(1.0, value);  // the sum itself is rounded
    for (int i = 0; i < kMostHalvings && objective.value(b - length * step) > highest; ++i) length /= 2;
    b -= length * step;
    value = objective.value(b);
  }
  fit.intercept = b[0];
  fit.coefficients = b.tail(k);
  return fit;
}

}  // namespace handhold
