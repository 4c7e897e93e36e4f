#include "quality/force_closure.h"

#include "quality/columns.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Core>

namespace handhold {
namespace {

using lanes::Lanes;
using polar::Columns;
using polar::InstructionSet;
using polar::Support;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr int kAttempts = 16;     // mixtures w0 tried before a set is given up
constexpr int kPivotLimit = 400;  // 5 to 8 pivots are usual
constexpr int kBlandAfter = 60;   // pivots; then Bland's rule, which cannot cycle

// Elements of u = B^-1 w are of order one. A smaller pivot would only amplify rounding.
constexpr double kPivotTolerance = 1e-11;
// Ratios nearer than this are equal, and an artificial leaves first.
constexpr double kRatioTolerance = 1e-13;
// The start simplex must hold a ball of this radius, times R: a thousand times the rounding of its facets' planes.
constexpr double kStartRadius = 1e-12;
// B^-1 after a few pivots: I - B^-1 B is squared by each step of Newton's method, two of which reach rounding from
// here.
constexpr double kInverseError = 1e-5;

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

HANDHOLD_INLINE Array8 columnOf(const WrenchView& wrenches, int j) {
  Array8 w{};
  for (int k = 0; k < 6; ++k) w[k] = wrenches(k, j);
  return w;
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
  phase.rank = polar::laneNumbers<W>();
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

/// The column that enters: the farthest along pi; after many pivots the first that improves (Bland's rule).
template <int W>
HANDHOLD_INLINE Support enteringColumn(const WrenchView& wrenches, const Columns& columns, const Array8& pi,
                                       double leastValue, int step) {
  if (step >= kBlandAfter) {
    for (int j = 0; j < columns.n; ++j) {
      const double value = vectorOf(pi).dot(wrenches.col(j));
      if (value > leastValue) return {j, value};
    }
  }
  return polar::supportColumn<W>(columns, pi.data());
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
  const auto isLeaving = polar::laneNumbers<W>() == Lanes<W>::all(leaving);
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

/// Pivots until the artificials are gone (balanced) or no column reaches beyond the plane pi . w = 0 (separated).
template <int W>
HANDHOLD_INLINE Phase1End solvePhase1(const WrenchView& wrenches, const Columns& columns, double radius,
                                      Phase1<W>& phase, Vector6& direction) {
  for (int step = 0; step < kPivotLimit; ++step) {
    if (phase.nArtificials == 0) return Phase1End::balanced;
    const Array8 pi = multipliers(phase);
    const double length = norm(pi);
    const double leastValue = kSeparationTolerance * radius * length;
    const Support entering = enteringColumn<W>(wrenches, columns, pi, leastValue, step);
    if (entering.column < 0) return Phase1End::stuck;  // pi is not a number
    if (entering.value <= leastValue) {
      direction = vectorOf(pi) / length;
      return Phase1End::separated;
    }
    const Array8 w = columnOf(wrenches, entering.column);
    const Lanes<W> u = mixture(phase.inverse, w.data());
    const int leaving = leavingRow(phase, u);
    if (leaving < 0) return Phase1End::stuck;
    pivot(phase, u, leaving, entering.column, w);
  }
  return Phase1End::stuck;
}

/// What a pass over all columns finds.
struct Survey {
  double radius = 0;  // R; not finite when a column is not
  Array8 mean{};      // sum c_j w_j / sum c_j
};

/// Unequal weights c_j in [0.5, 1.5), again from the start after 64 columns.
constexpr std::array<double, 64> kWeights = [] {
  std::array<double, 64> weights{};
  double fraction = 0;
  for (double& weight : weights) {
    fraction += 0.6180339887498949;  // of the golden ratio
    fraction -= fraction >= 1 ? 1 : 0;
    weight = 0.5 + fraction;
  }
  return weights;
}();

template <int W>
HANDHOLD_INLINE Survey surveyed(const Columns& columns) {
  MatrixColumns<W> sums;
  sums.fill(Lanes<W>::all(0));
  Lanes<W> weights = Lanes<W>::all(0), squares = weights, mostSquare = weights;
  for (int b = 0; b < columns.nBlocks; ++b) {
    Lanes<W> square = Lanes<W>::all(0);
    const auto isPadding = polar::laneNumbers<W>() > Lanes<W>::all(columns.n - 8 * b - 1);
    const Lanes<W> c = select(isPadding, Lanes<W>::all(0), Lanes<W>::load(kWeights.data() + 8 * (b % 8)));
    for (int k = 0; k < 6; ++k) {
      const Lanes<W> w = polar::coordinate<W>(columns.blocks[b], k);
      sums[k] = sums[k] + c * w;
      square = square + w * w;
    }
    weights = weights + c;
    mostSquare = larger(square, mostSquare);
    squares = squares + square;  // a NaN survives a sum, not a maximum
  }
  Survey survey;
  survey.radius = std::isfinite(sum(squares)) ? std::sqrt(largest(mostSquare)) : HUGE_VAL;
  const double scale = 1 / sum(weights);
  for (int k = 0; k < 6; ++k) survey.mean[k] = sum(sums[k]) * scale;
  return survey;
}

/// w0 = 0.7 w_lead + 0.3 sum c_j w_j / sum c_j. The leading wrench keeps w0 away from the origin, where a balanced set
/// has its mean; unequal weights c_j break the ties of symmetric sets.
HANDHOLD_INLINE Array8 strictMixture(const WrenchView& wrenches, const Array8& mean, int lead) {
  Array8 w0{};
  for (int k = 0; k < 6; ++k) w0[k] = 0.7 * wrenches(k, lead) + 0.3 * mean[k];
  return w0;
}

/// One step of Newton's method for B^-1, M <- M + (I - M B) M; returns the largest size of an entry of I - M B before.
template <int W>
HANDHOLD_INLINE double improveInverse(const std::array<Array8, 6>& b, MatrixColumns<W>& m) {
  MatrixColumns<W> error;
  Lanes<W> squares = Lanes<W>::all(0);
  for (int k = 0; k < 6; ++k) {
    const auto isDiagonal = polar::laneNumbers<W>() == Lanes<W>::all(k);
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
  const auto isBeyond = polar::laneNumbers<W>() > Lanes<W>::all(5);
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

ForceClosureResult notClosed(const Vector6& direction) {
  ForceClosureResult result;
  result.verdict = ForceClosure::notClosed;
  result.separatingDirection = direction;
  return result;
}

template <int W>
HANDHOLD_INLINE ForceClosureResult decide(const WrenchView& wrenches, std::vector<polar::ColumnBlock>& scratch) {
  const Columns columns = polar::packColumns(wrenches, scratch);
  const Survey survey = surveyed<W>(columns);
  if (columns.n == 0 || survey.radius == 0) return notClosed(Vector6::Unit(0));  // any plane separates
  if (!std::isfinite(survey.radius)) return {};

  // The plane across the mean settles a good share of the sets that are not closed.
  const double length = norm(survey.mean);
  Array8 away{};
  for (int k = 0; k < 6; ++k) away[k] = -survey.mean[k] / length;  // NaN when the columns cancel: no column supports it
  const Support beyond = polar::supportColumn<W>(columns, away.data());
  if (beyond.column >= 0 && beyond.value <= kSeparationTolerance * survey.radius) return notClosed(vectorOf(away));

  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Array8 w0 = strictMixture(wrenches, survey.mean, attempt * columns.n / kAttempts);
    Phase1<W> phase;
    startFromArtificials(w0, survey.radius, phase);
    Vector6 direction;
    const Phase1End end = solvePhase1(wrenches, columns, survey.radius, phase, direction);
    if (end == Phase1End::separated) return notClosed(direction);
    if (end == Phase1End::balanced && certified(phase, w0, survey.radius)) {
      ForceClosureResult result;
      result.verdict = ForceClosure::closed;
      result.basis = phase.basis;
      result.interiorPoint = vectorOf(w0);
      return result;
    }
  }
  return {};
}

ForceClosureResult decideBaseline(const WrenchView& wrenches, std::vector<polar::ColumnBlock>& scratch) {
  return decide<2>(wrenches, scratch);
}
#ifdef __x86_64__
[[gnu::target("avx2")]] ForceClosureResult decideAvx2(const WrenchView& wrenches,
                                                      std::vector<polar::ColumnBlock>& scratch) {
  return decide<4>(wrenches, scratch);
}
[[gnu::target("avx512f,avx512dq,avx512vl")]] ForceClosureResult decideAvx512(const WrenchView& wrenches,
                                                                             std::vector<polar::ColumnBlock>& scratch) {
  return decide<8>(wrenches, scratch);
}
#endif

}  // namespace

ForceClosureResult polar::testForceClosure(const WrenchView& wrenches, InstructionSet set) {
  thread_local std::vector<ColumnBlock> scratch;
#ifdef __x86_64__
  if (set == InstructionSet::avx512) return decideAvx512(wrenches, scratch);
  if (set == InstructionSet::avx2) return decideAvx2(wrenches, scratch);
#endif
  return decideBaseline(wrenches, scratch);
}

ForceClosureResult testForceClosure(const WrenchView& wrenches) {
  return polar::testForceClosure(wrenches, polar::instructionSet());
}

polar::InstructionSet polar::instructionSet() {
  static const InstructionSet best = [] {
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) {
      return InstructionSet::avx512;
    }
    if (__builtin_cpu_supports("avx2")) return InstructionSet::avx2;
#endif
    return InstructionSet::baseline;
  }();
  return best;
}

const char* polar::name(InstructionSet set) {
  constexpr const char* kNames[] = {"baseline", "AVX2", "AVX-512"};
  return kNames[static_cast<int>(set)];
}

}  // namespace handhold
