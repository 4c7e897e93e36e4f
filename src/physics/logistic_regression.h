#pragma once

#include <Eigen/Core>

namespace handhold {

/// P(y = 1 | x) = 1 / (1 + exp(-(intercept + coefficients . x))).
struct LogisticFit {
  double intercept = 0;
  Eigen::VectorXd coefficients;  // (k)
  int iterations = 0;
  double gradient = 0;  // largest component left, by which it was judged to have converged
};

/// Minimises by Newton's method, with steps halved until the sum falls (Hosmer, Lemeshow 2000, chapter 2; le Cessie,
/// van Houwelingen 1992 for the ridge),
///
///     - sum_i [y_i log P_i + (1 - y_i) log(1 - P_i)] + ridge / 2 |coefficients|^2                                (1)
///
/// The intercept is not drawn towards zero: the mean probability is the share of ones. With a ridge the optimum is
/// finite though a plane separates the classes, as long as both occur.
/// @param X      (n, k) a row an observation; columns of like scale, so that one ridge fits all
/// @param y      (n) 0 or 1, both
/// @param ridge  >= 0; 0 only where no plane separates the classes
/// @note  Const; safe from many threads. Equal arguments give equal bits.
LogisticFit fitLogistic(const Eigen::MatrixXd& X, const Eigen::VectorXd& y, double ridge);

}  // namespace handhold
