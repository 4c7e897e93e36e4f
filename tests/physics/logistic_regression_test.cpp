// Logistic regression against closed forms.
#include "physics/logistic_regression.h"

#include "core/random.h"

#include <cmath>

#include <gtest/gtest.h>

namespace handhold {
namespace {

/// `count` equal observations below those that are there.
void addRows(double x, double y, int count, Eigen::MatrixXd& X, Eigen::VectorXd& all) {
  const Eigen::Index n = X.rows();
  X.conservativeResize(n + count, 1);
  all.conservativeResize(n + count);
  X.bottomRows(count).setConstant(x);
  all.tail(count).setConstant(y);
}

// The maximum likelihood of a 2 x 2 table: the intercept is the log odds at x = 0, the slope their difference.
TEST(LogisticRegression, IsTheLogOddsOfATable) {
  Eigen::MatrixXd X(0, 1);
  Eigen::VectorXd y;
  addRows(0, 1, 7, X, y), addRows(0, 0, 21, X, y);
  addRows(1, 1, 30, X, y), addRows(1, 0, 6, X, y);
  const LogisticFit fit = fitLogistic(X, y, 0);
  EXPECT_NEAR(fit.intercept, std::log(7.0 / 21), 1e-8);
  EXPECT_NEAR(fit.coefficients[0], std::log(30.0 / 6) - std::log(7.0 / 21), 1e-8);
}

TEST(LogisticRegression, WithoutFeaturesIsTheShareOfOnes) {
  const Eigen::VectorXd y{{1, 0, 0, 0, 1}};
  EXPECT_NEAR(fitLogistic(Eigen::MatrixXd(5, 0), y, 1).intercept, std::log(2.0 / 3), 1e-9);
}

// At the optimum X^T (P - y) + ridge beta = 0; of the intercept, the mean probability is the share of ones.
TEST(LogisticRegressionProperty, TheGradientIsZeroAtTheOptimum) {
  constexpr Eigen::Index n = 60, k = 3;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    Eigen::MatrixXd X(n, k);
    Eigen::VectorXd y(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j < k; ++j) X(i, j) = random.normal(static_cast<std::uint64_t>(i * k + j));
      y[i] = X(i, 0) - X(i, 1) + random.child(1).normal(static_cast<std::uint64_t>(i)) > 0 ? 1 : 0;
    }
    const double ridge = 0.1 * static_cast<double>(1 + seed);
    const LogisticFit fit = fitLogistic(X, y, ridge);
    const Eigen::VectorXd P = 1 / (1 + (-((X * fit.coefficients).array() + fit.intercept)).exp());
    EXPECT_NEAR((P - y).sum(), 0, 1e-7);
    EXPECT_LT((X.transpose() * (P - y) + ridge * fit.coefficients).cwiseAbs().maxCoeff(), 1e-7);
  }
}

// A plane separates the classes: without a ridge the coefficient would grow for ever.
TEST(LogisticRegression, SeparableClassesStayFinite) {
  Eigen::MatrixXd X(0, 1);
  Eigen::VectorXd y;
  addRows(-1, 0, 50, X, y), addRows(1, 1, 50, X, y);
  const LogisticFit fit = fitLogistic(X, y, 1);
  ASSERT_TRUE(std::isfinite(fit.coefficients[0]));
  // Of the symmetric table: beta = 100 / (1 + exp(beta)).
  EXPECT_NEAR(fit.coefficients[0], 100 / (1 + std::exp(fit.coefficients[0])), 1e-6);
  EXPECT_NEAR(fit.intercept, 0, 1e-8);
  EXPECT_LT(fit.gradient, 1e-8);
}

// A step of Newton's method from zero would overshoot: one observation among many far out.
TEST(LogisticRegression, ConvergesFromFarOutObservations) {
  Eigen::MatrixXd X(0, 1);
  Eigen::VectorXd y;
  addRows(0, 0, 200, X, y), addRows(0, 1, 1, X, y), addRows(40, 1, 3, X, y), addRows(-30, 1, 1, X, y);
  const LogisticFit fit = fitLogistic(X, y, 0.01);
  EXPECT_LT(fit.gradient, 1e-6);
}

}  // namespace
}  // namespace handhold
