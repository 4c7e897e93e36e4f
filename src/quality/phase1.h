#pragma once

#include "quality/columns.h"
#include "quality/force_closure.h"
#include "quality/lanes.h"
#include "quality/polar.h"

#include <array>
#include <cmath>

#include <Eigen/Core>

// The six-row simplex method that the linearised and the true cone share; no other library includes it.
namespace handhold::polar {

// Elements of u = B^-1 w are of order one. A smaller pivot would only amplify rounding.
inline constexpr double kPivotTolerance = 1e-11;
// Ratios nearer than this are equal, and an artificial leaves first.
inline constexpr double kRatioTolerance = 1e-13;
// The start simplex must hold a ball of this radius, times R: a thousand times the rounding of its facets' planes.
inline constexpr double kStartRadius = 1e-12;
// B^-1 after a few pivots: I - B^-1 B is squared by each step of Newton's method, two of which reach rounding from
// here.
inline constexpr double kInverseError = 1e-5;

/// Six numbers, and two zeros to fill a vector.
struct alignas(64) Array8 : std::array<double, 8> {};

/// Six vectors: the columns of a 6 x 6 matrix, whose lanes are its rows. Lanes 6 and 7 are zero.
template <int W>
using MatrixColumns = std::array<Lanes<W>, 6>;

template <int W>
HANDHOLD_INLINE Array8 stored(const Lanes<W>& a) {
  Array8 array;
  a.store(array.data());
  return array;
}

HANDHOLD_INLINE double norm(const Array8& a) {
  return std::sqrt(((a[0] * a[0] + a[1] * a[1]) + (a[2] * a[2] + a[3] * a[3])) + (a[4] * a[4] + a[5] * a[5]));
}

HANDHOLD_INLINE Vector6 vectorOf(const Array8& a) { return Eigen::Map<const Vector6>(a.data()); }

/// Phase 1:  min sum of artificials,  W lambda + sum of artificials = -w0.
template <int W>
struct Phase1 {
  MatrixColumns<W> inverse;       // B^-1
  Lanes<W> x;                     // values of the basic variables
  Lanes<W> rank;                  // 8 (column + 1) + r in row r, an artificial is column -1: the order of leaving
  std::array<Array8, 6> columns;  // B; not set where an artificial is
  std::array<int, 6> basis;       // column in row r; negative: artificial
  int nArtificials = 6;
};

enum class Phase1End { balanced, separated, stuck };

/// Basis of artificials with columns +-R e_k, so that their values are positive.
template <int W>
HANDHOLD_INLINE void startFromArtificials(const Array8& w0, double radius, Phase1<W>& phase) {
  Array8 x{};
  for (int k = 0; k < 6; ++k) {
    Array8 column{};
    column[k] = (w0[k] > 0 ? -1 : 1) / radius;
    phase.inverse[k] = Lanes<W>::load(column.data());
    x[k] = std::abs(w0[k]) / radius;
  }
  phase.x = Lanes<W>::load(x.data());
  phase.rank = laneNumbers<W>();
  phase.basis.fill(-1);
}

/// pi = c_B B^-1, costs 1 for artificials and 0 for wrenches.
template <int W>
HANDHOLD_INLINE Array8 multipliers(const Phase1<W>& phase) {
  const auto isArtificial = phase.rank <= Lanes<W>::all(7);
  Array8 pi{};
  for (int k = 0; k < 6; ++k) pi[k] = sum(select(isArtificial, phase.inverse[k], Lanes<W>::all(0)));
  return pi;
}

/// Row whose variable reaches zero first as the column with u = B^-1 w enters; -1: none.
/// Among equals an artificial leaves (and never returns), then the lowest column.
template <int W>
HANDHOLD_INLINE int leavingRow(const Phase1<W>& phase, const Lanes<W>& u) {
  const Lanes<W> none = Lanes<W>::all(HUGE_VAL);
  const Lanes<W> ratio = select(u > Lanes<W>::all(kPivotTolerance), phase.x / u, none);
  const double best = least(ratio);
  if (!(best < HUGE_VAL)) return -1;
  const auto isTie = ratio <= Lanes<W>::all(best + kRatioTolerance);
  return static_cast<int>(least(select(isTie, phase.rank, none))) & 7;
}

/// B^-1 and x after column w takes row r: row r becomes q = row r / u_r, and u_i q leaves every other row i.
template <int W>
HANDHOLD_INLINE void pivot(Phase1<W>& phase, const Lanes<W>& u, int leaving, int entering, const Array8& w) {
  const auto isLeaving = laneNumbers<W>() == Lanes<W>::all(leaving);
  const double scale = 1 / stored(u)[leaving];
  for (Lanes<W>& column : phase.inverse) {
    const Lanes<W> q = Lanes<W>::all(stored(column)[leaving] * scale);
    column = select(isLeaving, q, column - u * q);
  }
  const Lanes<W> theta = Lanes<W>::all(stored(phase.x)[leaving] * scale);
  phase.x = select(isLeaving, theta, larger(phase.x - u * theta, Lanes<W>::all(0)));
  phase.rank = select(isLeaving, Lanes<W>::all(8 * (entering + 1) + leaving), phase.rank);
  phase.nArtificials -= phase.basis[leaving] < 0;
  phase.basis[leaving] = entering;
  phase.columns[leaving] = w;
}

/// One step of Newton's method for B^-1, M <- M + (I - M B) M; returns the largest size of an entry of I - M B before.
template <int W>
HANDHOLD_INLINE double improveInverse(const std::array<Array8, 6>& b, MatrixColumns<W>& m) {
  MatrixColumns<W> error;
  Lanes<W> squares = Lanes<W>::all(0);
  for (int k = 0; k < 6; ++k) {
    const auto isDiagonal = laneNumbers<W>() == Lanes<W>::all(k);
    error[k] = select(isDiagonal, Lanes<W>::all(1), Lanes<W>::all(0)) - mixture(m, b[k].data());
    squares = squares + error[k] * error[k];
  }
  for (Lanes<W>& column : m) column = column + mixture(error, stored(column).data());
  return std::sqrt(sum(squares));
}

/// Solves for lambda anew, with the columns themselves, and asks that the origin is inside by a margin: equation (5),
/// with facet k in lane k and n_0 in lanes 6 and 7.
template <int W>
HANDHOLD_INLINE bool certified(const Phase1<W>& phase, const Array8& w0, double radius) {
  MatrixColumns<W> m = phase.inverse;
  if (!(improveInverse(phase.columns, m) < kInverseError) || !(improveInverse(phase.columns, m) < kInverseError)) {
    return false;
  }
  const Lanes<W> zero = Lanes<W>::all(0);
  const auto isBeyond = laneNumbers<W>() > Lanes<W>::all(5);
  const Lanes<W> lambda = zero - mixture(m, w0.data());
  const double total = 1 + sum(lambda);
  const double leastWeight = least(select(isBeyond, Lanes<W>::all(1), lambda));

  MatrixColumns<W> b;
  for (int k = 0; k < 6; ++k) b[k] = Lanes<W>::load(phase.columns[k].data());
  const Lanes<W> residual = mixture(b, stored(lambda).data()) + Lanes<W>::load(w0.data());
  const double error = std::sqrt(sum(residual * residual)) / total;

  const Lanes<W> scale = Lanes<W>::all(total) / select(isBeyond, Lanes<W>::all(1), lambda);
  Lanes<W> squares = zero;  // |n_k|^2
  for (int k = 0; k < 6; ++k) {
    const Lanes<W> n = Lanes<W>::all(sum(m[k])) - scale * m[k];
    squares = squares + n * n;
  }
  const double inradius = 1 / std::sqrt(largest(squares));
  // Comparisons are written so that NaN refuses.
  return leastWeight > kBalanceTolerance * total && 1 > kBalanceTolerance * total && sum(squares) < HUGE_VAL &&
         inradius > kStartRadius * radius && error < 0.1 * inradius;
}

}  // namespace handhold::polar
