#include "core/random.h"
#include "quality/columns.h"
#include "quality/force_closure.h"
#include "quality/inner_polytope.h"
#include "quality/polar.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include <Eigen/Core>

namespace handhold {
namespace {

using polar::Columns;
using polar::InstructionSet;
using polar::kPlaneTolerance;
using polar::kShift;
using polar::kShiftedPlaneTolerance;
using polar::kTries;
using polar::Support;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kColumnLimit = polar::kVertexLimit - 1;  // one vertex is w0

/// Kept between calls.
struct Scratch {
  polar::Memory polytope;
  std::vector<polar::ColumnBlock> columnBlocks;
  std::vector<char> isVertex;
};

/// Radius of the largest ball about the origin in the hull of the columns; NaN when rounding stopped the expansion.
/// Column j is vertex j, w0 is vertex n.
template <int W>
HANDHOLD_INLINE double expand(Scratch& scratch, const WrenchView& wrenches, const ForceClosureResult& closure,
                              double radius, double planeTolerance) {
  const int n = static_cast<int>(wrenches.cols());
  polar::Memory& memory = scratch.polytope;
  const Columns columns = polar::packColumns(wrenches, scratch.columnBlocks);
  memory.vertices.reserve(static_cast<std::size_t>(n) + 1);
  scratch.isVertex.assign(n, 0);
  std::array<int, 7> vertices;
  for (int k = 0; k < 6; ++k) scratch.isVertex[vertices[k] = closure.basis[k]] = 1;
  vertices[6] = n;
  polar::InnerPolytope<W> polytope(memory, radius, planeTolerance);
  polytope.start(polar::basisColumns(wrenches, closure.basis), closure.interiorPoint, vertices);
  double upper = HUGE_VAL;
  while (true) {
    const std::uint32_t nearest = polytope.nearestFacet();
    if (nearest == polar::kNone) return kNaN;
    const polar::Facet& facet = memory.facets[nearest];
    const double norm = memory.norms[nearest];
    const Support support = polar::supportColumn<W>(columns, facet.normal.data());
    if (support.column < 0) return kNaN;
    upper = std::min(upper, support.value / norm);
    // Rounding: (8) does not hold.
    if (!(memory.distances[nearest] <= upper + kEpsilonTolerance * radius)) return kNaN;
    if (support.value - facet.normal[6] - 1 <= polytope.planeTolerance() * norm) {
      const double distance = memory.distances[nearest];
      return distance > 0 && polytope.planesHold() ? distance : kNaN;
    }
    if (scratch.isVertex[support.column]) return kNaN;  // a vertex beyond its own polytope
    scratch.isVertex[support.column] = 1;
    polytope.setPoint(support.column, wrenches.col(support.column).data());
    if (!polytope.insert(support.column, nearest)) return kNaN;
  }
}

double expandBaseline(Scratch& scratch, const WrenchView& wrenches, const ForceClosureResult& closure, double radius,
                      double planeTolerance) {
  return expand<2>(scratch, wrenches, closure, radius, planeTolerance);
}
#ifdef __x86_64__
[[gnu::target("avx2")]] double expandAvx2(Scratch& scratch, const WrenchView& wrenches,
                                          const ForceClosureResult& closure, double radius, double planeTolerance) {
  return expand<4>(scratch, wrenches, closure, radius, planeTolerance);
}
#endif

double expanded(InstructionSet set, const WrenchView& wrenches, const ForceClosureResult& closure, double radius,
                double planeTolerance) {
  thread_local Scratch scratch;
#ifdef __x86_64__
  if (set == InstructionSet::avx2) return expandAvx2(scratch, wrenches, closure, radius, planeTolerance);
#endif
  return expandBaseline(scratch, wrenches, closure, radius, planeTolerance);
}

/// The columns in another order, each moved a little: another start simplex, and no two facets in one plane.
Eigen::Map<const WrenchMatrix> shiftedWrenches(const WrenchView& wrenches, double radius, int attempt) {
  thread_local std::vector<double> memory;
  const RandomStream stream = RandomStream(static_cast<std::uint64_t>(attempt));
  const int n = static_cast<int>(wrenches.cols());
  memory.resize(6 * static_cast<std::size_t>(n));
  Eigen::Map<WrenchMatrix> shifted(memory.data(), 6, n);
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k < 6; ++k) {
      const double shift =
          kShift * radius * (2 * stream.uniform(6 * static_cast<std::uint64_t>(j) + static_cast<std::uint64_t>(k)) - 1);
      shifted(k, (j + attempt * n / kTries) % n) = wrenches(k, j) + shift;
    }
  }
  return {memory.data(), 6, n};
}

}  // namespace

double polar::epsilonMetric(const WrenchView& wrenches, const ForceClosureResult& closure, InstructionSet set) {
  const double radius = polar::wrenchRadius(wrenches);
  if (closure.verdict != ForceClosure::closed || !std::isfinite(radius) || wrenches.cols() > kColumnLimit) return kNaN;
  double epsilon = expanded(set, wrenches, closure, radius, kPlaneTolerance);
  for (int attempt = 1; attempt < kTries && std::isnan(epsilon); ++attempt) {
    const WrenchView shifted = shiftedWrenches(wrenches, radius, attempt);
    const ForceClosureResult shiftedClosure = polar::testForceClosure(shifted, set);
    if (shiftedClosure.verdict != ForceClosure::closed) continue;
    epsilon = expanded(set, shifted, shiftedClosure, radius, kShiftedPlaneTolerance);
  }
  return epsilon;
}

double epsilonMetric(const WrenchView& wrenches, const ForceClosureResult& closure) {
  return polar::epsilonMetric(wrenches, closure, polar::instructionSet());
}

}  // namespace handhold
