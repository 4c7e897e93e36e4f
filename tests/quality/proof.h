#pragma once

#include "quality/force_closure.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace handhold::testing {

/// Checks the proof that comes with a verdict, from the columns alone, and returns the verdict.
inline ForceClosure provedVerdict(const WrenchMatrix& wrenches) {
  const ForceClosureResult result = testForceClosure(wrenches);
  if (result.verdict == ForceClosure::notClosed) {
    const double radius = wrenches.cols() ? wrenches.colwise().norm().maxCoeff() : 0;
    // The unit vector and the product round once more here.
    EXPECT_NEAR(result.separatingDirection.norm(), 1, 1e-14);
    for (int j = 0; j < wrenches.cols(); ++j) {
      EXPECT_LE(result.separatingDirection.dot(wrenches.col(j)), (kSeparationTolerance + 1e-15) * radius);
    }
  }
  if (result.verdict == ForceClosure::closed) {
    Eigen::Matrix<double, 6, 6> basis;
    for (int k = 0; k < 6; ++k) basis.col(k) = wrenches.col(result.basis[k]);
    const Eigen::FullPivLU<Eigen::Matrix<double, 6, 6>> lu(basis);
    EXPECT_TRUE(lu.isInvertible());
    const Eigen::Matrix<double, 6, 1> lambda = lu.solve(-result.interiorPoint);
    EXPECT_GT(lambda.minCoeff(), 0.9 * kBalanceTolerance);  // solved by another factorisation
    const double radius = wrenches.colwise().norm().maxCoeff();
    EXPECT_LE((basis * lambda + result.interiorPoint).norm(), 1e-13 * (1 + lambda.sum()) * radius);
  }
  return result.verdict;
}

}  // namespace handhold::testing
