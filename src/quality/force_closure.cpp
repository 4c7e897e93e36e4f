#include "quality/force_closure.h"

#include "quality/polar.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Core>

namespace handhold {
namespace {

using polar::Matrix6;
using polar::Support;
using polar::Vector6;

constexpr int kAttempts = 4;      // mixtures w0 tried before a set is given up
constexpr int kPivotLimit = 400;  // 5 to 8 pivots are usual
constexpr int kBlandAfter = 60;   // pivots; then Bland's rule, which cannot cycle

// Elements of u = B^-1 w are of order one. A smaller pivot would only amplify rounding.
constexpr double kPivotTolerance = 1e-11;
// Ratios nearer than this are equal, and an artificial leaves first.
constexpr double kRatioTolerance = 1e-13;
// The start simplex must hold a ball of this radius, times R: a thousand times the rounding of its facets' planes.
constexpr double kStartRadius = 1e-12;

/// Phase 1:  min sum of artificials,  W lambda + sum of artificials = -w0.
struct Phase1 {
  Matrix6 inverse;           // B^-1
  Vector6 x;                 // values of the basic variables
  std::array<int, 6> basis;  // column in row r; negative: artificial
};

enum class Phase1End { balanced, separated, stuck };

/// Basis of artificials with columns +-R e_k, so that their values are positive.
Phase1 artificialBasis(const Vector6& rhs, double radius) {
  Phase1 phase;
  phase.inverse.setZero();
  for (int k = 0; k < 6; ++k) phase.inverse(k, k) = (rhs[k] < 0 ? -1 : 1) / radius;
  phase.x = rhs.cwiseAbs() / radius;
  phase.basis.fill(-1);
  return phase;
}

/// pi = c_B B^-1, costs 1 for artificials and 0 for wrenches; zero when no artificial is left.
Vector6 multipliers(const Phase1& phase) {
  Vector6 pi = Vector6::Zero();
  for (int r = 0; r < 6; ++r) {
    if (phase.basis[r] < 0) pi += phase.inverse.row(r).transpose();
  }
  return pi;
}

/// The column that enters: the farthest along pi; after many pivots the first that improves (Bland's rule).
Support enteringColumn(const WrenchMatrix& wrenches, const Vector6& pi, double least, int step) {
  if (step >= kBlandAfter) {
    for (int j = 0; j < wrenches.cols(); ++j) {
      const double value = pi.dot(wrenches.col(j));
      if (value > least) return {j, value};
    }
  }
  return polar::supportColumn(wrenches, pi);
}

/// Row whose variable reaches zero first as the column with u = B^-1 w enters; -1: none.
/// Among equals an artificial leaves (and never returns), then the lowest column.
int leavingRow(const Phase1& phase, const Vector6& u) {
  int leaving = -1;
  double best = 0;
  for (int r = 0; r < 6; ++r) {
    if (u[r] <= kPivotTolerance) continue;
    const double ratio = phase.x[r] / u[r];
    const bool tie = leaving >= 0 && std::abs(ratio - best) <= kRatioTolerance;
    if (leaving < 0 || (!tie && ratio < best) || (tie && phase.basis[r] < phase.basis[leaving])) {
      leaving = r;
      best = ratio;
    }
  }
  return leaving;
}

void pivot(Phase1& phase, const Vector6& u, int leaving, int entering) {
  const Eigen::Matrix<double, 1, 6> row = phase.inverse.row(leaving) / u[leaving];
  const double theta = phase.x[leaving] / u[leaving];
  for (int r = 0; r < 6; ++r) {
    phase.inverse.row(r) -= u[r] * row;
    phase.x[r] = std::max(0.0, phase.x[r] - u[r] * theta);
  }
  phase.inverse.row(leaving) = row;
  phase.x[leaving] = theta;
  phase.basis[leaving] = entering;
}

/// Pivots until the artificials are gone (balanced) or no column reaches beyond the plane pi . w = 0 (separated).
Phase1End solvePhase1(const WrenchMatrix& wrenches, double radius, Phase1& phase, Vector6& direction) {
  for (int step = 0; step < kPivotLimit; ++step) {
    const Vector6 pi = multipliers(phase);
    if (*std::min_element(phase.basis.begin(), phase.basis.end()) >= 0) return Phase1End::balanced;
    const double length = pi.norm();
    const double least = kSeparationTolerance * radius * length;
    const Support entering = enteringColumn(wrenches, pi, least, step);
    if (entering.column < 0) return Phase1End::stuck;  // pi is not a number
    if (entering.value <= least) {
      direction = pi / length;
      return Phase1End::separated;
    }
    const Vector6 u = phase.inverse * wrenches.col(entering.column);
    const int leaving = leavingRow(phase, u);
    if (leaving < 0) return Phase1End::stuck;
    pivot(phase, u, leaving, entering.column);
  }
  return Phase1End::stuck;
}

/// w0 = 0.7 w_lead + 0.3 sum c_j w_j / sum c_j. The leading wrench keeps w0 away from the origin, where a balanced set
/// has its mean; unequal weights c_j in [0.5, 1.5) break the ties of symmetric sets.
Vector6 strictMixture(const WrenchMatrix& wrenches, int lead) {
  constexpr double kGoldenFraction = 0.6180339887498949;
  Vector6 sum = Vector6::Zero();
  double total = 0;
  double fraction = kGoldenFraction;
  for (int j = 0; j < wrenches.cols(); ++j) {
    sum += (0.5 + fraction) * wrenches.col(j);
    total += 0.5 + fraction;
    fraction += kGoldenFraction;
    if (fraction >= 1) fraction -= 1;
  }
  return 0.7 * wrenches.col(lead) + (0.3 / total) * sum;
}

/// Recomputes lambda from the columns themselves and asks that the origin is inside by a margin.
bool certified(const WrenchMatrix& wrenches, double radius, const ForceClosureResult& result) {
  const Matrix6 basis = polar::basisColumns(wrenches, result.basis);
  const polar::StartSimplex simplex = polar::startSimplex(basis, result.interiorPoint);
  const double sum = 1 + simplex.lambda.sum();
  const double residual = (basis * simplex.lambda + result.interiorPoint).norm() / sum;
  // Comparisons are written so that NaN refuses.
  return simplex.lambda.minCoeff() > kBalanceTolerance * sum && 1 > kBalanceTolerance * sum &&
         simplex.inradius > kStartRadius * radius && residual < 0.1 * simplex.inradius;
}

ForceClosureResult notClosed(const Vector6& direction) {
  ForceClosureResult result;
  result.verdict = ForceClosure::notClosed;
  result.separatingDirection = direction;
  return result;
}

}  // namespace

ForceClosureResult testForceClosure(const WrenchMatrix& wrenches) {
  const double radius = polar::wrenchRadius(wrenches);
  if (!std::isfinite(radius)) return {};
  if (radius == 0) return notClosed(Vector6::Unit(0));  // no column, or only zeros: any plane separates

  // The plane across the mean settles a good share of the sets that are not closed.
  const Vector6 sum = wrenches.rowwise().sum();
  const Vector6 away = -sum / sum.norm();  // NaN when the columns cancel: then no column supports it
  const Support beyond = polar::supportColumn(wrenches, away);
  if (beyond.column >= 0 && beyond.value <= kSeparationTolerance * radius) return notClosed(away);

  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    ForceClosureResult result;
    result.interiorPoint = strictMixture(wrenches, static_cast<int>(attempt * wrenches.cols() / kAttempts));
    Phase1 phase = artificialBasis(-result.interiorPoint, radius);
    Vector6 direction;
    const Phase1End end = solvePhase1(wrenches, radius, phase, direction);
    if (end == Phase1End::separated) return notClosed(direction);
    result.basis = phase.basis;
    if (end == Phase1End::balanced && certified(wrenches, radius, result)) {
      result.verdict = ForceClosure::closed;
      return result;
    }
  }
  return {};
}

}  // namespace handhold
