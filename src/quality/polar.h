#pragma once

#include "quality/force_closure.h"

#include <array>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/LU>

// What the simplex method and the double description share; no other library includes it.
namespace handhold::polar {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// R = max |w|, the unit of every distance in wrench space; not finite when a column is not.
inline double wrenchRadius(const WrenchView& wrenches) {
  double largest = 0;
  double total = 0;  // a NaN survives a sum, not a maximum
  for (int j = 0; j < wrenches.cols(); ++j) {
    const double square = wrenches.col(j).squaredNorm();
    largest = square > largest ? square : largest;
    total += square;
  }
  return std::isfinite(total) ? std::sqrt(largest) : HUGE_VAL;
}

/// The simplex {b_1 .. b_6, w0} about the origin, as the balance of its corners and the planes of its facets.
struct StartSimplex {
  Vector6 lambda;                  // B lambda = -w0
  std::array<Vector6, 7> normals;  // [k < 6] misses b_k, [6] misses w0; n . v = 1 at the six others
  double inradius = 0;             // min 1 / |n|
};

/// With M = B^-1 and S = 1 + sum lambda:  n_6 = M^T 1,  n_k = n_6 - (S / lambda_k) M^T e_k.
/// lambda and the normals hold infinities when B is singular; inradius is then 0 or NaN.
inline StartSimplex startSimplex(const Matrix6& basis, const Vector6& interiorPoint) {
  StartSimplex simplex;
  const Matrix6 inverse = Eigen::PartialPivLU<Matrix6>(basis).inverse();
  simplex.lambda = -(inverse * interiorPoint);
  const double sum = 1 + simplex.lambda.sum();
  simplex.normals[6] = inverse.colwise().sum().transpose();
  double largest = simplex.normals[6].squaredNorm();
  for (int k = 0; k < 6; ++k) {
    simplex.normals[k] = simplex.normals[6] - (sum / simplex.lambda[k]) * inverse.row(k).transpose();
    largest = std::fmax(largest, simplex.normals[k].squaredNorm());
  }
  simplex.inradius = 1 / std::sqrt(largest);
  return simplex;
}

inline Matrix6 basisColumns(const WrenchView& wrenches, const std::array<int, 6>& basis) {
  Matrix6 columns;
  for (int k = 0; k < 6; ++k) columns.col(k) = wrenches.col(basis[k]);
  return columns;
}

}  // namespace handhold::polar
