#include "core/random.h"
#include "quality/force_closure.h"
#include "quality/polar.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include <Eigen/Core>

namespace handhold {
namespace {

using polar::Matrix6;
using polar::StartSimplex;
using polar::Support;
using polar::Vector6;

// A point sees a facet when it lies farther than this, times R, beyond the facet's plane. Rounding of n . p / |n| is
// below 1e-15 R, so coplanar wrenches (symmetric contacts, duplicates) are never seen.
constexpr double kPlaneTolerance = 1e-12;
// Wrenches that differ by about the tolerance can be seen by one facet and not by the next, and the horizon tears. A
// further try moves every coordinate by up to kShift R: epsilon moves by no more than the longest shift, 5e-11 R, well
// within kEpsilonTolerance. Nothing is coplanar any more, and the tolerance comes down to ten roundings.
constexpr double kShift = 2e-11;
constexpr double kShiftedPlaneTolerance = 1e-14;
constexpr int kTries = 6;
// Beyond it a set is not from a grasp: 32 contacts with 8 edges make 1,400 facets.
constexpr std::size_t kFacetLimit = std::size_t{1} << 20;
constexpr int kColumnLimit = 65534;  // vertices are 16-bit numbers, one is w0

/// A side of a facet, the ridge that misses vertices[side], as one number.
using Place = std::uint32_t;
constexpr Place kNone = ~Place{0};
constexpr Place placeOf(std::uint32_t facet, int side) { return facet << 3 | static_cast<Place>(side); }
constexpr std::uint32_t facetOf(Place place) { return place >> 3; }
constexpr int sideOf(Place place) { return static_cast<int>(place & 7); }

/// A facet of the inner polytope: a vertex n of the polar about the centre c, with n . (v - c) = 1 at its six vertices
/// v. Two cache lines.
struct alignas(64) Facet {
  Vector6 normal;
  double norm = 0;                       // |n|
  double distance = 0;                   // (1 + n . c) / |n|, of the plane from the origin
  double height = 0;                     // n . (p - c) for the point p of `pass`
  std::array<Place, 6> neighbours = {};  // [k] across the ridge that misses vertices[k]
  std::array<std::uint16_t, 6> vertices = {};
  std::uint32_t pass = 0;
  bool seen = false;  // by the point of `pass`
  bool alive = false;
};

/// Half of a pair of new facets that share p and four other vertices.
struct HalfLink {
  std::uint64_t key = 0;  // sum of the codes of the four vertices
  std::uint32_t pass = 0;
  Place place = kNone;
};

/// The inner polytope, kept between calls for its memory.
class InnerPolytope {
 public:
  /// Radius of the largest ball about the origin in the hull of the columns; NaN when rounding stopped the expansion.
  double expand(const WrenchMatrix& wrenches, const ForceClosureResult& closure, double radius, double planeTolerance);

 private:
  void start(const WrenchMatrix& wrenches, const ForceClosureResult& closure);
  std::uint32_t nearestFacet();
  bool insert(const Vector6& point, int column, std::uint32_t first, double upper);
  void measure(Facet& facet) const;
  void lookFrom(const Vector6& point, Facet& facet) const;
  void collectSeen(const Vector6& point, std::uint32_t first);
  bool coverRidge(Place ridge, int column, double upper);
  bool link(std::uint64_t key, Place place);
  std::uint32_t newFacet();
  void propose(std::uint32_t facet);
  bool planesHold(const WrenchMatrix& wrenches, const Vector6& interiorPoint) const;

  double planeTolerance_ = 0;         // times R
  Vector6 center_ = Vector6::Zero();  // c
  double radius_ = 0;                 // R
  std::uint32_t pass_ = 0;
  int unpaired_ = 0;
  std::vector<Facet> facets_;
  std::vector<std::uint32_t> free_;
  std::vector<std::uint32_t> seen_;
  std::vector<Place> horizon_;                             // the seen sides
  std::vector<HalfLink> links_;                            // open addressing, a power of two
  std::vector<std::pair<double, std::uint32_t>> nearest_;  // heap of (-distance, facet); stale when it differs
  std::vector<char> isVertex_;
  std::vector<std::uint64_t> codes_;  // of the vertices, 64 random bits each
};

std::uint32_t InnerPolytope::newFacet() {
  if (free_.empty()) {
    facets_.emplace_back();
    return static_cast<std::uint32_t>(facets_.size() - 1);
  }
  const std::uint32_t index = free_.back();
  free_.pop_back();
  return index;
}

void InnerPolytope::propose(std::uint32_t facet) {
  nearest_.emplace_back(-facets_[facet].distance, facet);
  std::push_heap(nearest_.begin(), nearest_.end());
}

/// Seven facets of {six basis columns, w0}; w0 is vertex number n. Facet k misses corner k.
void InnerPolytope::start(const WrenchMatrix& wrenches, const ForceClosureResult& closure) {
  facets_.clear();
  free_.clear();
  nearest_.clear();
  isVertex_.assign(wrenches.cols(), 0);
  const RandomStream codes(0);
  for (std::size_t vertex = codes_.size(); vertex <= isVertex_.size(); ++vertex) codes_.push_back(codes.bits(vertex));
  const Matrix6 basis = polar::basisColumns(wrenches, closure.basis);
  center_ = (basis.rowwise().sum() + closure.interiorPoint) / 7;
  const StartSimplex simplex = polar::startSimplex(basis.colwise() - center_, closure.interiorPoint - center_);
  for (int k = 0; k < 7; ++k) {
    const std::uint32_t index = newFacet();
    Facet& facet = facets_[index];
    facet.normal = simplex.normals[k];
    measure(facet);
    facet.alive = true;
    for (int corner = 0, side = 0; corner < 7; ++corner) {
      if (corner == k) continue;
      facet.vertices[side] = static_cast<std::uint16_t>(corner < 6 ? closure.basis[corner] : wrenches.cols());
      facet.neighbours[side++] = placeOf(static_cast<std::uint32_t>(corner), k < corner ? k : k - 1);
    }
    propose(index);
  }
  for (const int column : closure.basis) isVertex_[column] = 1;
}

/// The facet nearest to the origin; kNone when rounding left none.
std::uint32_t InnerPolytope::nearestFacet() {
  while (!nearest_.empty()) {
    const auto [minusDistance, index] = nearest_.front();
    if (facets_[index].alive && facets_[index].distance == -minusDistance) return index;
    std::pop_heap(nearest_.begin(), nearest_.end());
    nearest_.pop_back();
  }
  return kNone;
}

void InnerPolytope::measure(Facet& facet) const {
  facet.norm = facet.normal.norm();
  facet.distance = (1 + facet.normal.dot(center_)) / facet.norm;
}

void InnerPolytope::lookFrom(const Vector6& point, Facet& facet) const {
  facet.height = facet.normal.dot(point);
  facet.seen = facet.height - 1 > planeTolerance_ * facet.norm;
  facet.pass = pass_;
}

/// Facets seen from the point, by flood from one of them, and the ridges where seen meets hidden.
void InnerPolytope::collectSeen(const Vector6& point, std::uint32_t first) {
  seen_.assign(1, first);
  horizon_.clear();
  lookFrom(point, facets_[first]);
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const std::uint32_t index = seen_[i];
    for (int side = 0; side < 6; ++side) {
      const std::uint32_t across = facetOf(facets_[index].neighbours[side]);
      Facet& neighbour = facets_[across];
      if (neighbour.pass != pass_) {
        lookFrom(point, neighbour);
        if (neighbour.seen) seen_.push_back(across);
      }
      if (!neighbour.seen) horizon_.push_back(placeOf(index, side));
    }
  }
}

/// Joins two new facets across the ridge of p and the four vertices in `key`; false when a third one has that ridge.
/// Two ridges of one key, were it ever to happen, make a third one too.
bool InnerPolytope::link(std::uint64_t key, Place place) {
  const std::size_t mask = links_.size() - 1;
  for (std::size_t slot = key & mask;; slot = (slot + 1) & mask) {
    HalfLink& half = links_[slot];
    if (half.pass != pass_) {
      half = {key, pass_, place};
      ++unpaired_;
      return true;
    }
    if (half.key != key) continue;
    if (half.place == kNone) return false;
    facets_[facetOf(place)].neighbours[sideOf(place)] = half.place;
    facets_[facetOf(half.place)].neighbours[sideOf(half.place)] = place;
    half.place = kNone;
    --unpaired_;
    return true;
  }
}

/// The facet through a ridge of the horizon and the new point. Its polar vertex lies on the edge from the hidden G to
/// the seen V, where n . p = 1 (README.md, equation (9); p is taken from c):
///     n = n_G + alpha (n_V - n_G),   alpha = (1 - n_G . p) / (n_V . p - n_G . p) in [0, 1)
bool InnerPolytope::coverRidge(Place ridge, int column, double upper) {
  const std::uint32_t index = newFacet();
  Facet& facet = facets_[index];
  const Facet& seen = facets_[facetOf(ridge)];
  const int newSide = sideOf(ridge);  // p takes the place of the vertex that the ridge misses
  const Place hiddenPlace = seen.neighbours[newSide];
  Facet& hidden = facets_[facetOf(hiddenPlace)];
  // A point that lies on the plane of G within the tolerance may be a little beyond it: G's plane is kept.
  const double below = std::max(0.0, 1 - hidden.height);
  const double alpha = below / (below + (seen.height - 1));
  facet.normal = hidden.normal + alpha * (seen.normal - hidden.normal);
  measure(facet);
  facet.pass = 0;
  facet.alive = true;
  // A facet beyond the upper bound is never the nearest one at the end.
  if (facet.distance <= upper + kEpsilonTolerance * radius_) propose(index);

  facet.vertices = seen.vertices;
  facet.vertices[newSide] = static_cast<std::uint16_t>(column);
  facet.neighbours[newSide] = hiddenPlace;
  hidden.neighbours[sideOf(hiddenPlace)] = placeOf(index, newSide);
  std::uint64_t others = 0;
  for (const std::uint16_t vertex : facet.vertices) others += codes_[vertex];
  others -= codes_[column];
  for (int side = 0; side < 6; ++side) {
    if (side != newSide && !link(others - codes_[facet.vertices[side]], placeOf(index, side))) return false;
  }
  return true;
}

/// Adds a point outside the facet `first`; false when rounding made the horizon no sphere.
bool InnerPolytope::insert(const Vector6& point, int column, std::uint32_t first, double upper) {
  if (++pass_ == 0) {  // once in 2^32 passes old marks could look new
    for (HalfLink& half : links_) half.pass = 0;
    for (Facet& facet : facets_) facet.pass = 0;
    pass_ = 1;
  }
  isVertex_[column] = 1;
  collectSeen(point, first);
  const std::size_t slots = std::bit_ceil(std::max<std::size_t>(512, 8 * horizon_.size()));
  if (links_.size() < slots) links_.assign(slots, {});
  const std::size_t most = facets_.size() + horizon_.size();
  if (most > kFacetLimit) return false;
  if (most > facets_.capacity()) facets_.reserve(2 * most);  // references stay valid while ridges are covered
  unpaired_ = 0;
  for (const Place ridge : horizon_) {
    if (!coverRidge(ridge, column, upper)) return false;
  }
  for (const std::uint32_t index : seen_) {
    facets_[index].alive = false;
    free_.push_back(index);
  }
  return unpaired_ == 0;
}

/// Does each facet's plane pass through its six vertices still? Normals are sums over a chain of facets; a chain that
/// began at a flat simplex may have lost digits.
bool InnerPolytope::planesHold(const WrenchMatrix& wrenches, const Vector6& interiorPoint) const {
  const double tolerance = 0.1 * kEpsilonTolerance * radius_;
  for (const Facet& facet : facets_) {
    if (!facet.alive) continue;
    double worst = 0;
    for (const std::uint16_t vertex : facet.vertices) {
      const Vector6 v = vertex < wrenches.cols() ? Vector6(wrenches.col(vertex)) : interiorPoint;
      const double at = facet.normal.dot(v - center_);
      worst = std::max(worst, std::abs(at - 1));
    }
    if (!(worst <= tolerance * facet.norm)) return false;
  }
  return true;
}

double InnerPolytope::expand(const WrenchMatrix& wrenches, const ForceClosureResult& closure, double radius,
                             double planeTolerance) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  planeTolerance_ = planeTolerance * radius;
  radius_ = radius;
  start(wrenches, closure);
  double upper = HUGE_VAL;
  while (true) {
    const std::uint32_t nearest = nearestFacet();
    if (nearest == kNone) return kNaN;
    const Facet& facet = facets_[nearest];
    const Support support = polar::supportColumn(wrenches, facet.normal);
    if (support.column < 0) return kNaN;
    upper = std::min(upper, support.value / facet.norm);
    const Vector6 point = wrenches.col(support.column) - center_;
    if (facet.normal.dot(point) - 1 <= planeTolerance_ * facet.norm) {
      return facet.distance > 0 && planesHold(wrenches, closure.interiorPoint) ? facet.distance : kNaN;
    }
    if (isVertex_[support.column]) return kNaN;  // a vertex beyond its own polytope
    if (!insert(point, support.column, nearest, upper)) return kNaN;
  }
}

/// The columns in another order, each moved a little: another start simplex, and no two facets in one plane.
WrenchMatrix shiftedWrenches(const WrenchMatrix& wrenches, double radius, int attempt) {
  const RandomStream stream = RandomStream(static_cast<std::uint64_t>(attempt));
  const int n = static_cast<int>(wrenches.cols());
  WrenchMatrix shifted(6, n);
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k < 6; ++k) {
      const double shift = kShift * radius * (2 * stream.uniform(static_cast<std::uint64_t>(6 * j + k)) - 1);
      shifted(k, (j + attempt * n / kTries) % n) = wrenches(k, j) + shift;
    }
  }
  return shifted;
}

}  // namespace

double epsilonMetric(const WrenchMatrix& wrenches, const ForceClosureResult& closure) {
  thread_local InnerPolytope polytope;
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const double radius = polar::wrenchRadius(wrenches);
  if (closure.verdict != ForceClosure::closed || !std::isfinite(radius) || wrenches.cols() > kColumnLimit) return kNaN;
  double epsilon = polytope.expand(wrenches, closure, radius, kPlaneTolerance);
  for (int attempt = 1; attempt < kTries && std::isnan(epsilon); ++attempt) {
    const WrenchMatrix shifted = shiftedWrenches(wrenches, radius, attempt);
    const ForceClosureResult shiftedClosure = testForceClosure(shifted);
    if (shiftedClosure.verdict != ForceClosure::closed) continue;
    epsilon = polytope.expand(shifted, shiftedClosure, radius, kShiftedPlaneTolerance);
  }
  return epsilon;
}

}  // namespace handhold
