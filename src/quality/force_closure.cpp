#include "quality/force_closure.h"

#include "quality/columns.h"
#include "quality/phase1.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Core>

namespace handhold {
namespace {

using lanes::Lanes;
using polar::Array8;
using polar::Columns;
using polar::InstructionSet;
using polar::MatrixColumns;
using polar::Phase1;
using polar::Phase1End;
using polar::Support;
using polar::Vector6;
using polar::vectorOf;

constexpr int kAttempts = 16;     // mixtures w0 tried before a set is given up
constexpr int kPivotLimit = 400;  // 5 to 8 pivots are usual
constexpr int kBlandAfter = 60;   // pivots; then Bland's rule, which cannot cycle

HANDHOLD_INLINE Array8 columnOf(const WrenchView& wrenches, int j) {
  Array8 w{};
  for (int k = 0; k < 6; ++k) w[k] = wrenches(k, j);
  return w;
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
#endif

}  // namespace

ForceClosureResult polar::testForceClosure(const WrenchView& wrenches, InstructionSet set) {
  thread_local std::vector<ColumnBlock> scratch;
#ifdef __x86_64__
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
    if (__builtin_cpu_supports("avx2")) return InstructionSet::avx2;
#endif
    return InstructionSet::baseline;
  }();
  return best;
}

const char* polar::name(InstructionSet set) {
  constexpr const char* kNames[] = {"baseline", "AVX2"};
  return kNames[static_cast<int>(set)];
}

}  // namespace handhold
