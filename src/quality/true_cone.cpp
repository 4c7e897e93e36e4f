#include "quality/true_cone.h"

#include "core/random.h"
#include "quality/columns.h"
#include "quality/inner_polytope.h"
#include "quality/phase1.h"
#include "quality/polar.h"
#include "quality/tangent_basis.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace handhold {
namespace {

using lanes::Lanes;
using polar::Array8;
using polar::InstructionSet;
using polar::Phase1;
using polar::Phase1End;
using polar::Vector6;
using Block = TrueCones::Block;

constexpr int kAttempts = 8;      // mixtures w0 tried before a set is given up
constexpr int kPivotLimit = 200;  // 7 to 15 pivots are usual; more within 1e-4 of the critical friction

/// The cones of one set of contacts at one friction.
struct Cones {
  const Block* blocks;
  int nBlocks;
  int n;
  double friction;
  double radius;  // R, no less than the longest wrench of K(mu); not finite when a contact is not
};

/// Where K(mu) reaches farthest along a direction: c_i + mu (x t_i + y b_i).
struct Reach {
  int contact = -1;
  double value = -HUGE_VAL;
  double x = 0, y = 0;
};

template <int W>
HANDHOLD_INLINE Lanes<W> product(const std::array<std::array<double, 8>, 6>& w, const double* d) {
  const auto term = [&](int k) { return Lanes<W>::load(w[k].data()) * d[k]; };
  return ((term(0) + term(1)) + (term(2) + term(3))) + (term(4) + term(5));
}

/// The same sum of one lane.
HANDHOLD_INLINE double productAt(const std::array<std::array<double, 8>, 6>& w, int lane, const double* d) {
  const auto term = [&](int k) { return w[k][lane] * d[k]; };
  return ((term(0) + term(1)) + (term(2) + term(3))) + (term(4) + term(5));
}

template <int W>
HANDHOLD_INLINE Lanes<W> squareRoot(const Lanes<W>& a) {
  alignas(64) std::array<double, 8> values;
  a.store(values.data());
  for (double& value : values) value = std::sqrt(value);
  return Lanes<W>::load(values.data());
}

/// h(d) and its point, equation (11); the lowest contact among equals, none when no product is a number.
template <int W>
HANDHOLD_INLINE Reach farthest(const Cones& cones, const double* d) {
  Lanes<W> best = Lanes<W>::all(-HUGE_VAL);
  Lanes<W> bestBlock = Lanes<W>::all(0);
  Lanes<W> block = Lanes<W>::all(0);
  for (int i = 0; i < cones.nBlocks; ++i) {
    const Lanes<W> x = product<W>(cones.blocks[i].t, d);
    const Lanes<W> y = product<W>(cones.blocks[i].b, d);
    const Lanes<W> value = product<W>(cones.blocks[i].center, d) + squareRoot(x * x + y * y) * cones.friction;
    const auto better = value > best;
    best = select(better, value, best);
    bestBlock = select(better, block, bestBlock);
    block = block + Lanes<W>::all(1);
  }
  Reach reach;
  const double value = largest(best);
  if (value == -HUGE_VAL) return reach;
  const auto isBest = best == Lanes<W>::all(value);
  const Lanes<W> index = bestBlock * 8.0 + polar::laneNumbers<W>();
  reach.contact = static_cast<int>(least(select(isBest, index, Lanes<W>::all(HUGE_VAL))));
  reach.value = value;
  const Block& winner = cones.blocks[reach.contact / 8];
  const double x = productAt(winner.t, reach.contact % 8, d);
  const double y = productAt(winner.b, reach.contact % 8, d);
  const double length = std::sqrt(x * x + y * y);
  reach.x = length > 0 ? x / length : 0;  // without a pull the normal force is as far as any
  reach.y = length > 0 ? y / length : 0;
  return reach;
}

HANDHOLD_INLINE Array8 pointOf(const Cones& cones, int contact, double x, double y) {
  const Block& block = cones.blocks[contact / 8];
  const int lane = contact % 8;
  Array8 w{};
  for (int k = 0; k < 6; ++k) {
    w[k] = block.center[k][lane] + cones.friction * (x * block.t[k][lane] + y * block.b[k][lane]);
  }
  return w;
}

/// Angles without order, and weights in [0.5, 1.5), again from the start after 64 contacts.
struct MixtureTable {
  std::array<double, 64> x, y, weight;
};

const MixtureTable& mixtureTable() {
  static const MixtureTable table = [] {
    MixtureTable filled{};
    for (int i = 0; i < 64; ++i) {
      const double turns = 0.6180339887498949 * (i + 1), other = 0.7548776662466927 * (i + 1);
      filled.x[i] = 0.5 * std::cos(2 * std::numbers::pi * turns);
      filled.y[i] = 0.5 * std::sin(2 * std::numbers::pi * turns);
      filled.weight[i] = 0.5 + (other - std::floor(other));
    }
    return filled;
  }();
  return table;
}

/// w0 = 0.7 q_lead + 0.3 sum c_j q_j / sum c_j, one point q_j inside the disc of every contact. As in the linearised
/// test; what is off the discs' centres keeps w0 out of the flat that symmetric contacts span.
Array8 strictMixture(const Cones& cones, int attempt) {
  const MixtureTable& table = mixtureTable();
  const auto pointInside = [&](int i, int shift) {
    return pointOf(cones, i, table.x[(i + shift) % 64], table.y[(i + shift) % 64]);
  };
  Array8 sum{};
  double weights = 0;
  for (int i = 0; i < cones.n; ++i) {
    const Array8 q = pointInside(i, 0);
    const double weight = table.weight[i % 64];
    for (int k = 0; k < 6; ++k) sum[k] += weight * q[k];
    weights += weight;
  }
  const Array8 lead = pointInside(attempt * cones.n / kAttempts, 7 * attempt);
  Array8 w0{};
  for (int k = 0; k < 6; ++k) w0[k] = 0.7 * lead[k] + 0.3 * (sum[k] / weights);
  return w0;
}

/// Phase 1 under way: -w0 by the basis.
template <int W>
struct Search {
  Phase1<W> phase;
  Array8 w0;
  Array8 direction;  // pi
  int nEntered = 0;
};

template <int W>
HANDHOLD_INLINE void startSearch(const Cones& cones, int attempt, Search<W>& search) {
  search.w0 = strictMixture(cones, attempt);
  startFromArtificials(search.w0, cones.radius, search.phase);
  search.phase.nArtificials = 6;
  search.nEntered = 0;
}

/// Pivots until the artificials are gone (balanced) or K(mu) is behind the plane pi . w = 0 (separated). Each column is
/// made as it enters.
template <int W>
HANDHOLD_INLINE Phase1End solvePhase1(const Cones& cones, Search<W>& search) {
  for (int step = 0; step < kPivotLimit; ++step) {
    if (search.phase.nArtificials == 0) return Phase1End::balanced;
    search.direction = multipliers(search.phase);
    const Reach entering = farthest<W>(cones, search.direction.data());
    if (entering.contact < 0) return Phase1End::stuck;  // pi is not a number
    if (entering.value <= kSeparationTolerance * cones.radius * norm(search.direction)) return Phase1End::separated;
    const Array8 w = pointOf(cones, entering.contact, entering.x, entering.y);
    const Lanes<W> u = mixture(search.phase.inverse, w.data());
    const int leaving = leavingRow(search.phase, u);
    if (leaving < 0) return Phase1End::stuck;
    pivot(search.phase, u, leaving, search.nEntered++, w);
  }
  return Phase1End::stuck;
}

/// Is the origin strictly inside K(mu)? `search` then holds the proof: the basis and w0, or the direction.
template <int W>
HANDHOLD_INLINE ForceClosure decide(const Cones& cones, int firstAttempt, Search<W>& search) {
  if (cones.n == 0) return ForceClosure::notClosed;  // any plane separates
  if (!std::isfinite(cones.radius)) return ForceClosure::failed;
  for (int attempt = firstAttempt; attempt < kAttempts; ++attempt) {
    startSearch(cones, attempt, search);
    const Phase1End end = solvePhase1(cones, search);
    if (end == Phase1End::separated) return ForceClosure::notClosed;
    if (end == Phase1End::balanced && certified(search.phase, search.w0, cones.radius)) return ForceClosure::closed;
  }
  return ForceClosure::failed;
}

/// Grows the simplex of the verdict until its nearest facet is within kBoundsGap of the least h(d) / |d| found; false
/// when rounding stopped it. A try after the first moves every new point by up to kShift R.
template <int W>
HANDHOLD_INLINE bool expand(const Cones& cones, const Search<W>& start, int attempt, polar::Memory& memory,
                            EpsilonBounds& bounds) {
  polar::Matrix6 basis;
  for (int k = 0; k < 6; ++k) basis.col(k) = polar::vectorOf(start.phase.columns[k]);
  const double planeTolerance = attempt == 0 ? polar::kPlaneTolerance : polar::kShiftedPlaneTolerance;
  const double shift = attempt == 0 ? 0 : polar::kShift * cones.radius;
  const RandomStream stream(static_cast<std::uint64_t>(attempt));
  polar::InnerPolytope<W> polytope(memory, cones.radius, planeTolerance);
  memory.reserveVertices(7);
  polytope.start(basis, polar::vectorOf(start.w0), {0, 1, 2, 3, 4, 5, 6});
  double upper = HUGE_VAL;
  for (int vertex = 7; vertex < polar::kVertexLimit; ++vertex) {
    const std::uint32_t nearest = polytope.nearestFacet();
    if (nearest == polar::kNone) return false;
    const polar::Facet& facet = memory.facets[nearest];
    const double norm = memory.norms[nearest], lower = memory.distances[nearest];
    const Reach reach = farthest<W>(cones, facet.normal.data());
    if (reach.contact < 0) return false;
    upper = std::min(upper, reach.value / norm);
    const double tolerance = kEpsilonTolerance * cones.radius;
    if (!(lower <= upper + tolerance)) return false;  // rounding: (8) does not hold
    const bool isOnPlane = reach.value - facet.normal[6] - 1 <= polytope.planeTolerance() * norm;
    if (isOnPlane || upper - lower <= kBoundsGap * upper) {
      bounds.lower = std::min(lower, upper);
      bounds.upper = upper;
      bounds.facets = static_cast<int>(memory.nFacets);
      return lower > 0 && polytope.planesHold();
    }
    Array8 p = pointOf(cones, reach.contact, reach.x, reach.y);
    for (int k = 0; shift > 0 && k < 6; ++k) p[k] += shift * (2 * stream.uniform(6 * vertex + k) - 1);
    memory.reserveVertices(static_cast<std::size_t>(vertex) + 1);
    polytope.setPoint(vertex, p.data());
    if (!polytope.insert(vertex, nearest)) return false;
  }
  return false;
}

template <int W>
HANDHOLD_INLINE void boundEpsilon(const Cones& cones, polar::Memory& memory, EpsilonBounds& bounds) {
  Search<W> search;
  for (int attempt = 0; attempt < polar::kTries; ++attempt) {
    const ForceClosure verdict = decide<W>(cones, attempt, search);
    if (verdict == ForceClosure::notClosed) {
      bounds = {verdict, 0, 0, 0};
      return;
    }
    if (verdict == ForceClosure::failed) break;
    if (expand<W>(cones, search, attempt, memory, bounds)) {
      bounds.verdict = verdict;
      return;
    }
  }
  bounds = {};
}

/// The largest friction at which K is behind the plane d . w = 0:  min over i of -(d . c_i) / |(d . t_i, d . b_i)|.
double separatedFriction(const Cones& cones, const Array8& d) {
  double least = HUGE_VAL;
  for (int i = 0; i < cones.n; ++i) {
    const Block& block = cones.blocks[i / 8];
    const double x = productAt(block.t, i % 8, d.data()), y = productAt(block.b, i % 8, d.data());
    const double along = productAt(block.center, i % 8, d.data());
    const double length = std::sqrt(x * x + y * y);
    if (length > 0) least = std::min(least, -along / length);
  }
  return least;
}

/// K grows with the friction, so phase 1 of a friction that is too small is a start for every larger one: w0 and the
/// columns of its basis are in K still.
template <int W>
HANDHOLD_INLINE void findCriticalFriction(Cones cones, CriticalFriction& result) {
  result = {};
  Search<W> search, tooSmall;
  result.verdict = decide<W>(cones, 0, search);
  if (result.verdict != ForceClosure::closed) return;
  double below = 0, closed = cones.friction;
  bool hasStart = false;
  // Where a test has no answer, another place in the interval is asked.
  constexpr std::array<double, 3> kPlaces = {0.5, 0.35, 0.65};
  std::size_t place = 0;
  while (closed > kLeastFriction && closed - below > std::min(kFrictionTolerance, kFrictionShare * closed)) {
    cones.friction = below + kPlaces[place] * (closed - below);
    ForceClosure verdict = ForceClosure::failed;
    if (hasStart) {
      search = tooSmall;
      const Phase1End end = solvePhase1(cones, search);
      if (end == Phase1End::separated) verdict = ForceClosure::notClosed;
      if (end == Phase1End::balanced && certified(search.phase, search.w0, cones.radius))
        verdict = ForceClosure::closed;
    }
    if (verdict == ForceClosure::failed) verdict = decide<W>(cones, 0, search);
    if (verdict == ForceClosure::failed) {
      if (++place < kPlaces.size()) continue;
      result.verdict = ForceClosure::failed;
      return;
    }
    place = 0;
    if (verdict == ForceClosure::closed) {
      closed = cones.friction;
    } else {
      below = std::clamp(separatedFriction(cones, search.direction), cones.friction, closed);
      tooSmall = search;
      hasStart = true;
    }
  }
  result.below = below;
  result.friction = closed;
}

ForceClosure decideBaseline(const Cones& cones) {
  Search<2> search;
  return decide<2>(cones, 0, search);
}
void boundBaseline(const Cones& cones, polar::Memory& memory, EpsilonBounds& bounds) {
  boundEpsilon<2>(cones, memory, bounds);
}
void criticalBaseline(const Cones& cones, CriticalFriction& result) { findCriticalFriction<2>(cones, result); }
#ifdef __x86_64__
#define HANDHOLD_AVX2 [[gnu::target("avx2")]]
#define HANDHOLD_AVX512 [[gnu::target("avx512f,avx512dq,avx512vl")]]
HANDHOLD_AVX2 ForceClosure decideAvx2(const Cones& cones) {
  Search<4> search;
  return decide<4>(cones, 0, search);
}
HANDHOLD_AVX2 void boundAvx2(const Cones& cones, polar::Memory& memory, EpsilonBounds& bounds) {
  boundEpsilon<4>(cones, memory, bounds);
}
HANDHOLD_AVX2 void criticalAvx2(const Cones& cones, CriticalFriction& result) {
  findCriticalFriction<4>(cones, result);
}
HANDHOLD_AVX512 ForceClosure decideAvx512(const Cones& cones) {
  Search<8> search;
  return decide<8>(cones, 0, search);
}
HANDHOLD_AVX512 void boundAvx512(const Cones& cones, polar::Memory& memory, EpsilonBounds& bounds) {
  boundEpsilon<8>(cones, memory, bounds);
}
HANDHOLD_AVX512 void criticalAvx512(const Cones& cones, CriticalFriction& result) {
  findCriticalFriction<8>(cones, result);
}
#endif

/// R(mu) = max over i of |c_i| + mu sqrt(|t_i|^2 + |b_i|^2), no less than any |w|.
Cones conesOf(const std::vector<Block>& blocks, int n, double friction) {
  Cones cones{blocks.data(), (n + 7) / 8, n, friction, 0};
  double total = 0;  // a NaN survives a sum, not a maximum
  for (int i = 0; i < n; ++i) {
    const Block& block = blocks[i / 8];
    double center = 0, tangents = 0;
    for (int k = 0; k < 6; ++k) {
      const double c = block.center[k][i % 8], t = block.t[k][i % 8], b = block.b[k][i % 8];
      center += c * c;
      tangents += t * t + b * b;
    }
    const double radius = std::sqrt(center) + friction * std::sqrt(tangents);
    cones.radius = std::max(cones.radius, radius);
    total += radius;
  }
  if (!std::isfinite(total)) cones.radius = HUGE_VAL;
  return cones;
}

}  // namespace

TrueCones::TrueCones(const WrenchModel& model) : TrueCones(model, polar::instructionSet()) {}

TrueCones::TrueCones(const WrenchModel& model, polar::InstructionSet set) : model_(model), set_(set) {
  assert(model.torqueScale > 0 && model.friction >= 0);
}

void TrueCones::setContacts(std::span<const Contact> contacts) {
  nContacts_ = static_cast<int>(contacts.size());
  const std::size_t nBlocks = (contacts.size() + 7) / 8;
  if (blocks_.size() < nBlocks) blocks_.resize(nBlocks);
  for (std::size_t i = 0; i < 8 * nBlocks; ++i) {
    const Contact& contact = contacts[i < contacts.size() ? i : 0];
    const TangentBasis tangents = tangentBasis(contact.normal);
    const Eigen::Vector3d arm = (contact.position - model_.centerOfMass) / model_.torqueScale;
    const auto set = [&](std::array<std::array<double, 8>, 6>& w, const Eigen::Vector3d& f) {
      const Eigen::Vector3d torque = arm.cross(f);
      for (int k = 0; k < 3; ++k) w[k][i % 8] = f[k];
      for (int k = 0; k < 3; ++k) w[k + 3][i % 8] = torque[k];
    };
    set(blocks_[i / 8].center, contact.normal);
    set(blocks_[i / 8].t, tangents.t);
    set(blocks_[i / 8].b, tangents.b);
  }
}

ForceClosure TrueCones::testForceClosure(std::span<const Contact> contacts) {
  setContacts(contacts);
  const Cones cones = conesOf(blocks_, nContacts_, model_.friction);
#ifdef __x86_64__
  if (set_ == InstructionSet::avx512) return decideAvx512(cones);
  if (set_ == InstructionSet::avx2) return decideAvx2(cones);
#endif
  return decideBaseline(cones);
}

EpsilonBounds TrueCones::epsilonBounds(std::span<const Contact> contacts) {
  thread_local polar::Memory memory;
  setContacts(contacts);
  const Cones cones = conesOf(blocks_, nContacts_, model_.friction);
  EpsilonBounds bounds;
#ifdef __x86_64__
  if (set_ == InstructionSet::avx512) return boundAvx512(cones, memory, bounds), bounds;
  if (set_ == InstructionSet::avx2) return boundAvx2(cones, memory, bounds), bounds;
#endif
  return boundBaseline(cones, memory, bounds), bounds;
}

CriticalFriction TrueCones::criticalFriction(std::span<const Contact> contacts) {
  setContacts(contacts);
  const Cones cones = conesOf(blocks_, nContacts_, model_.friction);
  CriticalFriction result;
#ifdef __x86_64__
  if (set_ == InstructionSet::avx512) return criticalAvx512(cones, result), result;
  if (set_ == InstructionSet::avx2) return criticalAvx2(cones, result), result;
#endif
  return criticalBaseline(cones, result), result;
}

}  // namespace handhold
