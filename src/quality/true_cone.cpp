#include "quality/true_cone.h"

#include "core/random.h"
#include "quality/columns.h"
#include "quality/near_facets.h"
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
using polar::EightWrenches;
using polar::InstructionSet;
using polar::Phase1;
using polar::Phase1End;
using polar::product;
using polar::Vector6;
using Block = TrueCones::Block;

constexpr int kAttempts = 8;      // mixtures w0 tried before a set is given up
constexpr int kPivotLimit = 200;  // 7 to 15 pivots are usual; more within 1e-4 of the critical friction

/// The cones of one set of contacts at one friction.
struct ContactCones {
  const Block* blocks;
  int nBlocks;
  int n;
  double friction;
  double torsion;  // e / s; 0: point contacts
  double radius;   // R, no less than the longest wrench of K(mu); not finite when a contact is not
};

/// From the middle of a contact's ball: the wrench c_i + mu (x t_i + y b_i + z r_i).
struct Offset {
  double x = 0, y = 0, z = 0;  // z is 0 of point contacts
};

/// Where K(mu) reaches farthest along a direction.
struct Reach {
  int contact = -1;
  double value = -HUGE_VAL;
  Offset offset;
};

/// d . w of one lane, the same sum as polar::product.
HANDHOLD_INLINE double productAt(const EightWrenches& w, int lane, const double* d) {
  return ((w[0][lane] * d[0] + w[1][lane] * d[1]) + (w[2][lane] * d[2] + w[3][lane] * d[3])) +
         (w[4][lane] * d[4] + w[5][lane] * d[5]);
}

/// d . r_i; r_i = (0; e n_i / s) is made from the normal, which is the force of c_i.
template <int W>
HANDHOLD_INLINE Lanes<W> torsionProduct(const ContactCones& cones, const Block& block, const double* d) {
  const EightWrenches& n = block.center;
  return ((Lanes<W>::load(n[0].data()) * d[3] + Lanes<W>::load(n[1].data()) * d[4]) +
          Lanes<W>::load(n[2].data()) * d[5]) *
         cones.torsion;
}

/// (d . t_i, d . b_i, d . r_i) of one contact.
HANDHOLD_INLINE Offset pullAt(const ContactCones& cones, int contact, const double* d) {
  const Block& block = cones.blocks[contact / 8];
  const int lane = contact % 8;
  const EightWrenches& n = block.center;
  return {productAt(block.t, lane, d), productAt(block.b, lane, d),
          ((n[0][lane] * d[3] + n[1][lane] * d[4]) + n[2][lane] * d[5]) * cones.torsion};
}

HANDHOLD_INLINE double length(const Offset& p) { return std::sqrt((p.x * p.x + p.y * p.y) + p.z * p.z); }

template <int W>
HANDHOLD_INLINE Lanes<W> squareRoot(const Lanes<W>& a) {
  alignas(64) std::array<double, 8> values;
  a.store(values.data());
  for (double& value : values) value = std::sqrt(value);
  return Lanes<W>::load(values.data());
}

/// h(d) and its point, equation (11); the lowest contact among equals, none when no product is a number.
template <int W>
HANDHOLD_INLINE Reach farthest(const ContactCones& cones, const double* d) {
  auto largest = polar::Largest<W>::none();
  for (int i = 0; i < cones.nBlocks; ++i) {
    const Block& block = cones.blocks[i];
    const Lanes<W> x = product<W>(block.t, d), y = product<W>(block.b, d);
    Lanes<W> squares = x * x + y * y;
    if (cones.torsion > 0) {
      const Lanes<W> z = torsionProduct<W>(cones, block, d);
      squares = squares + z * z;
    }
    largest.add(product<W>(block.center, d) + squareRoot(squares) * cones.friction);
  }
  const polar::Support support = largest.support();
  Reach reach{support.column, support.value, {}};
  if (reach.contact < 0) return reach;
  const Offset pull = pullAt(cones, reach.contact, d);
  const double size = length(pull);
  // Without a pull the normal force is as far as any.
  if (size > 0) reach.offset = {pull.x / size, pull.y / size, pull.z / size};
  return reach;
}

HANDHOLD_INLINE Array8 pointOf(const ContactCones& cones, int contact, const Offset& offset) {
  const Block& block = cones.blocks[contact / 8];
  const int lane = contact % 8;
  Array8 w{};
  for (int k = 0; k < 6; ++k) {
    w[k] = block.center[k][lane] + cones.friction * (offset.x * block.t[k][lane] + offset.y * block.b[k][lane]);
  }
  if (cones.torsion > 0) {
    const double moment = cones.friction * cones.torsion * offset.z;
    for (int k = 0; k < 3; ++k) w[3 + k] += moment * block.center[k][lane];
  }
  return w;
}

/// Offsets without order, within sqrt(1/2) of the middle, and weights in [0.5, 1.5), again from the start after 64
/// contacts.
struct MixtureTable {
  std::array<Offset, 64> offset;
  std::array<double, 64> weight;
};

const MixtureTable& mixtureTable() {
  static const MixtureTable table = [] {
    MixtureTable filled{};
    for (int i = 0; i < 64; ++i) {
      const double turns = 0.6180339887498949 * (i + 1), other = 0.7548776662466927 * (i + 1);
      const double twist = 0.5497004779019703 * (i + 1);
      filled.offset[i] = {0.5 * std::cos(2 * std::numbers::pi * turns), 0.5 * std::sin(2 * std::numbers::pi * turns),
                          (twist - std::floor(twist)) - 0.5};
      filled.weight[i] = 0.5 + (other - std::floor(other));
    }
    return filled;
  }();
  return table;
}

/// w0 = 0.7 q_lead + 0.3 sum c_j q_j / sum c_j, one point q_j inside the ball of every contact. As in the linearised
/// test; what is off the balls' centres keeps w0 out of the flat that symmetric contacts span.
Array8 strictMixture(const ContactCones& cones, int attempt) {
  const MixtureTable& table = mixtureTable();
  const auto pointInside = [&](int i, int shift) { return pointOf(cones, i, table.offset[(i + shift) % 64]); };
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
HANDHOLD_INLINE void startSearch(const ContactCones& cones, int attempt, Search<W>& search) {
  search.w0 = strictMixture(cones, attempt);
  startFromArtificials(search.w0, cones.radius, search.phase);
  search.phase.nArtificials = 6;
  search.nEntered = 0;
}

/// Pivots until the artificials are gone (balanced) or K(mu) is behind the plane pi . w = 0 (separated). Each column is
/// made as it enters.
template <int W>
HANDHOLD_INLINE Phase1End solvePhase1(const ContactCones& cones, Search<W>& search) {
  for (int step = 0; step < kPivotLimit; ++step) {
    if (search.phase.nArtificials == 0) return Phase1End::balanced;
    search.direction = multipliers(search.phase);
    const Reach entering = farthest<W>(cones, search.direction.data());
    if (entering.contact < 0) return Phase1End::stuck;  // pi is not a number
    if (entering.value <= kSeparationTolerance * cones.radius * norm(search.direction)) return Phase1End::separated;
    const Array8 w = pointOf(cones, entering.contact, entering.offset);
    const Lanes<W> u = mixture(search.phase.inverse, w.data());
    const int leaving = leavingRow(search.phase, u);
    if (leaving < 0) return Phase1End::stuck;
    pivot(search.phase, u, leaving, search.nEntered++, w);
  }
  return Phase1End::stuck;
}

/// Is the origin strictly inside K(mu)? `search` then holds the proof: the basis and w0, or the direction.
template <int W>
HANDHOLD_INLINE ForceClosure decide(const ContactCones& cones, int firstAttempt, Search<W>& search) {
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
/// when rounding stopped it. Every point is moved by up to kShift R, in each attempt elsewhere.
template <int W>
HANDHOLD_INLINE bool expand(const ContactCones& cones, const Search<W>& start, int attempt, polar::NearMemory& memory,
                            EpsilonBounds& bounds) {
  const RandomStream stream(static_cast<std::uint64_t>(attempt));
  const double shift = polar::kShift * cones.radius;
  const auto shifted = [&](int vertex, Array8 v) {
    for (int k = 0; k < 6; ++k) v[k] += shift * (2 * stream.uniform(6 * vertex + k) - 1);
    return v;
  };
  polar::Matrix6 basis;
  for (int k = 0; k < 6; ++k) basis.col(k) = polar::vectorOf(shifted(k, start.phase.columns[k]));
  polar::NearFacets<W> polytope(memory, cones.radius);
  polytope.start(basis, polar::vectorOf(shifted(6, start.w0)));
  double upper = HUGE_VAL;
  while (true) {
    const std::uint32_t nearest = polytope.nearest();
    if (nearest == polar::kNone) return false;
    const polar::NearFacet& facet = memory.facets[nearest];
    const double lower = memory.distances[nearest], norm = memory.norms[nearest];
    const Reach reach = farthest<W>(cones, facet.normal.data());
    if (reach.contact < 0) return false;
    upper = std::min(upper, reach.value / norm);
    const double tolerance = kEpsilonTolerance * cones.radius;
    if (!(lower <= upper + tolerance)) return false;  // rounding: (8) does not hold
    const bool isOnPlane = reach.value - facet.normal[6] - 1 <= tolerance * norm;
    if (isOnPlane || upper - lower <= kBoundsGap * upper) {
      bounds.lower = std::min(lower, upper);
      bounds.upper = upper;
      bounds.facets = polytope.nBuilt();
      return lower > 0 && polytope.planesHold();
    }
    const Array8 p = shifted(polytope.nVertices(), pointOf(cones, reach.contact, reach.offset));
    if (!polytope.insert(p.data(), upper + tolerance)) return false;
  }
}

polar::NearMemory& threadMemory() {
  thread_local polar::NearMemory memory;
  return memory;
}

template <int W>
HANDHOLD_INLINE void answer(const ContactCones& cones, ForceClosure& verdict) {
  Search<W> search;
  verdict = decide<W>(cones, 0, search);
}

template <int W>
HANDHOLD_INLINE void answer(const ContactCones& cones, EpsilonBounds& bounds) {
  polar::NearMemory& memory = threadMemory();
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

/// The largest friction at which K is behind the plane d . w = 0:  min over i of -(d . c_i) / |(d . t_i, d . b_i,
/// d . r_i)|.
double separatedFriction(const ContactCones& cones, const Array8& d) {
  double least = HUGE_VAL;
  for (int i = 0; i < cones.n; ++i) {
    const double size = length(pullAt(cones, i, d.data()));
    if (size > 0) least = std::min(least, -productAt(cones.blocks[i / 8].center, i % 8, d.data()) / size);
  }
  return least;
}

/// K grows with the friction, so phase 1 of a friction that is too small is a start for every larger one: w0 and the
/// columns of its basis are in K still.
template <int W>
HANDHOLD_INLINE void answer(ContactCones cones, CriticalFriction& result) {
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

// One function for each instruction set and question.
template <class Answer>
void answerBaseline(const ContactCones& cones, Answer& result) {
  answer<2>(cones, result);
}
#ifdef __x86_64__
template <class Answer>
[[gnu::target("avx2")]] void answerAvx2(const ContactCones& cones, Answer& result) {
  answer<4>(cones, result);
}
#endif

template <class Answer>
Answer answerBy(InstructionSet set, const ContactCones& cones) {
  Answer result{};
#ifdef __x86_64__
  if (set == InstructionSet::avx2) return answerAvx2(cones, result), result;
#endif
  return answerBaseline(cones, result), result;
}

/// R(mu) = max over i of |c_i| + mu sqrt(|t_i|^2 + |b_i|^2 + |r_i|^2), no less than any |w|.
ContactCones conesOf(const std::vector<Block>& blocks, int n, const WrenchModel& model) {
  const double torsion = model.torsionRadius / model.torqueScale;
  ContactCones cones{blocks.data(), (n + 7) / 8, n, model.friction, torsion, 0};
  double total = 0;  // a NaN survives a sum, not a maximum
  for (int i = 0; i < n; ++i) {
    const Block& block = blocks[i / 8];
    double center = 0, tangents = torsion * torsion;
    for (int k = 0; k < 6; ++k) {
      const double c = block.center[k][i % 8], t = block.t[k][i % 8], b = block.b[k][i % 8];
      center += c * c;
      tangents += t * t + b * b;
    }
    const double radius = std::sqrt(center) + model.friction * std::sqrt(tangents);
    cones.radius = std::max(cones.radius, radius);
    total += radius;
  }
  if (!std::isfinite(total)) cones.radius = HUGE_VAL;
  return cones;
}

}  // namespace

TrueCones::TrueCones(const WrenchModel& model) : TrueCones(model, polar::instructionSet()) {}

TrueCones::TrueCones(const WrenchModel& model, polar::InstructionSet set) : model_(model), set_(set) {
  assert(model.torqueScale > 0 && model.friction >= 0 && model.torsionRadius >= 0);
}

void TrueCones::setContacts(std::span<const Contact> contacts) {
  const std::size_t nBlocks = (contacts.size() + 7) / 8;
  if (blocks_.size() < nBlocks) blocks_.resize(nBlocks);
  for (std::size_t i = 0; i < 8 * nBlocks; ++i) {
    const Contact& contact = contacts[i < contacts.size() ? i : 0];
    const TangentBasis tangents = tangentBasis(contact.normal);
    const Eigen::Vector3d arm = (contact.position - model_.centerOfMass) / model_.torqueScale;
    const auto set = [&](EightWrenches& w, const Eigen::Vector3d& f) {
      const Eigen::Vector3d torque = arm.cross(f);
      for (int k = 0; k < 3; ++k) w[k][i % 8] = f[k];
      for (int k = 0; k < 3; ++k) w[k + 3][i % 8] = torque[k];
    };
    set(blocks_[i / 8].center, contact.normal);
    set(blocks_[i / 8].t, tangents.t);
    set(blocks_[i / 8].b, tangents.b);
  }
}

template <class Answer>
Answer TrueCones::ask(std::span<const Contact> contacts) {
  setContacts(contacts);
  return answerBy<Answer>(set_, conesOf(blocks_, static_cast<int>(contacts.size()), model_));
}

ForceClosure TrueCones::testForceClosure(std::span<const Contact> contacts) { return ask<ForceClosure>(contacts); }

EpsilonBounds TrueCones::epsilonBounds(std::span<const Contact> contacts) { return ask<EpsilonBounds>(contacts); }

CriticalFriction TrueCones::criticalFriction(std::span<const Contact> contacts) {
  return ask<CriticalFriction>(contacts);
}

}  // namespace handhold
