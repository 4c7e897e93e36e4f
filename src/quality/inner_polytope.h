#pragma once

#include "core/random.h"
#include "quality/columns.h"
#include "quality/polar.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

// The guided double description of epsilon; no other library includes it.
namespace handhold::polar {

// A point sees a facet when it lies farther than this, times R, beyond the facet's plane. Rounding of n . p / |n| is
// below 1e-15 R, so coplanar wrenches (symmetric contacts, duplicates) are never seen.
inline constexpr double kPlaneTolerance = 1e-12;
// Wrenches that differ by about the tolerance can be seen by one facet and not by the next, and the horizon tears. A
// further try moves every coordinate by up to kShift R: epsilon moves by no more than the longest shift, 5e-11 R, well
// within kEpsilonTolerance. Nothing is coplanar any more, and the tolerance comes down to ten roundings.
inline constexpr double kShift = 2e-11;
inline constexpr double kShiftedPlaneTolerance = 1e-14;
inline constexpr int kTries = 6;
// Beyond it a set is not from a grasp: 32 contacts with 8 edges make 1,400 facets.
inline constexpr std::size_t kFacetLimit = std::size_t{1} << 20;
inline constexpr int kVertexLimit = 65535;  // vertices are 16-bit numbers

/// A side of a facet, the ridge that misses vertices[side], as one number.
using Place = std::uint32_t;
constexpr Place kNone = ~Place{0};
constexpr Place placeOf(std::uint32_t facet, int side) { return facet << 3 | static_cast<Place>(side); }
constexpr std::uint32_t facetOf(Place place) { return place >> 3; }
constexpr int sideOf(Place place) { return static_cast<int>(place & 7); }

/// A facet of the inner polytope: a vertex n of the polar about the centre c, with n . (v - c) = 1 at its six vertices
/// v. Two cache lines: what is mixed, and the rest. What every facet is asked for lies in dense arrays of Memory.
struct alignas(64) Facet {
  std::array<double, 8> normal = {};     // n, then n . c, which mixes as n does, then 0
  std::array<Place, 6> neighbours = {};  // [k] across the ridge that misses vertices[k]
  std::array<std::uint16_t, 6> vertices = {};
  bool alive = false;
};
static_assert(sizeof(Facet) == 128);

/// The normals of eight facets, coordinate by coordinate.
struct alignas(64) NormalBlock : std::array<std::array<double, 8>, 6> {};

/// Finds the pairs of new facets that share p and four other vertices. Open addressing.
class RidgeTable {
 public:
  /// Forgets all pairs; about `nSlots` places, of which few should be taken: a collision costs a misprediction.
  void begin(std::size_t nSlots) {
    const std::size_t size = std::bit_ceil(nSlots);
    if (halves_.size() < size) halves_.assign(size, {});
    mask_ = size - 1;
    if (++pass_ == 0) {  // once in 2^32 passes old marks could look new
      for (Half& half : halves_) half.pass = 0;
      pass_ = 1;
    }
  }

  /// The other facet's place of the ridge; the facet's own when it is the first, kNone when it is a third. Two ridges
  /// of one key, were it ever to happen, make a third one too. `key`: the sum of the codes of the four vertices.
  HANDHOLD_INLINE Place join(std::uint64_t key, Place place) {
    std::size_t slot = key & mask_;
    while (halves_[slot].pass == pass_ && halves_[slot].key != key) slot = (slot + 1) & mask_;
    Half& half = halves_[slot];
    const bool isSecond = half.pass == pass_;
    const Place other = isSecond ? half.place : place;
    half = {key, pass_, isSecond ? kNone : place};
    return other;
  }

 private:
  struct Half {
    std::uint64_t key = 0;
    std::uint32_t pass = 0;
    Place place = kNone;
  };
  std::vector<Half> halves_;
  std::size_t mask_ = 0;
  std::uint32_t pass_ = 0;
};

/// v - c, or p - c, and two zeros.
struct alignas(64) Point : std::array<double, 8> {};

struct Vertices {
  void reserve(std::size_t nVertices);

  std::vector<Point> points;
  std::vector<std::uint64_t> codes;  // 64 random bits each
};

inline void Vertices::reserve(std::size_t nVertices) {
  const RandomStream stream(0);
  while (codes.size() < nVertices) {
    codes.push_back(stream.bits(codes.size()));
    points.push_back({});
  }
}

/// The largest |n . v - 1| of a facet's vertices.
template <int W>
HANDHOLD_INLINE double planeError(const std::array<double, 8>& normal, const std::array<std::uint16_t, 6>& vertices,
                                  const std::vector<Point>& points) {
  const Lanes<W> n = Lanes<W>::load(normal.data());
  double worst = 0;
  for (const std::uint16_t vertex : vertices) {
    worst = std::max(worst, std::abs(sum(n * Lanes<W>::load(points[vertex].data())) - 1));
  }
  return worst;
}

/// The memory of an inner polytope, kept between calls. Branches that no processor could foresee (is a neighbour seen,
/// is a pair complete) are written as arithmetic: lists have room for one more than they hold, and an entry that is not
/// wanted is written over by the next.
struct Memory {
  void reserve(std::size_t nFacetsWanted);

  std::vector<Facet> facets;
  std::vector<NormalBlock> normals;
  std::vector<double> norms;          // |n|
  std::vector<double> heights;        // n . (p - c) for the last point p
  std::vector<double> excess;         // > 0 where the last point sees the facet
  std::vector<std::uint32_t> passes;  // the last in which the facet was looked at
  std::vector<double> distances;      // of the planes from the origin; infinite when dead
  std::vector<std::uint32_t> free;
  std::vector<std::uint32_t> seen;
  std::vector<Place> horizon;  // the seen sides
  RidgeTable ridges;
  Vertices vertices;
  std::uint32_t nFacets = 0;  // with the free ones
  std::uint32_t pass = 0;
};

/// Room for so many facets.
inline void Memory::reserve(std::size_t nFacetsWanted) {
  if (nFacetsWanted <= facets.size()) return;
  const std::size_t size = std::bit_ceil(std::max<std::size_t>(nFacetsWanted, 1024));
  facets.resize(size);
  normals.resize(size / 8);
  norms.resize(size);
  heights.resize(size);
  excess.resize(size);
  passes.resize(size);
  distances.resize(size, HUGE_VAL);
  free.resize(size);
  seen.resize(size + 1);
  horizon.resize(6 * size + 1);
}

/// An inner polytope by vectors of W doubles: start, then insert the points that its user finds beyond its facets.
template <int W>
class InnerPolytope {
 public:
  InnerPolytope(Memory& memory, double radius, double planeTolerance)
      : memory_(memory), planeTolerance_(planeTolerance * radius), epsilonTolerance_(kEpsilonTolerance * radius) {}

  /// The simplex {basis, interior point}; vertices[k] is the number of corner k, the last that of the interior point.
  HANDHOLD_INLINE void start(const Matrix6& basis, const Vector6& interiorPoint, const std::array<int, 7>& vertices);
  /// The facet nearest to the origin; kNone when rounding left none.
  HANDHOLD_INLINE std::uint32_t nearestFacet() const;
  HANDHOLD_INLINE void setPoint(int vertex, const double* v);
  /// Adds a vertex beyond the facet `first`; false when rounding made the horizon no sphere.
  HANDHOLD_INLINE bool insert(int vertex, std::uint32_t first);
  /// Does each facet's plane pass through its six vertices still? Normals are sums over a chain of facets; a chain that
  /// began at a flat simplex may have lost digits.
  HANDHOLD_INLINE bool planesHold() const;
  /// A point farther beyond a plane sees it [wrench].
  double planeTolerance() const { return planeTolerance_; }

 private:
  HANDHOLD_INLINE void measure(std::uint32_t index);
  HANDHOLD_INLINE void measureHeights(const Point& p);
  HANDHOLD_INLINE void collectSeen(std::uint32_t first);
  HANDHOLD_INLINE bool coverRidge(Place ridge, int vertex);
  HANDHOLD_INLINE bool link(std::uint64_t key, Place place);
  HANDHOLD_INLINE std::uint32_t newFacet();

  Point center_ = {};  // c
  Memory& memory_;
  double planeTolerance_;    // [wrench]
  double epsilonTolerance_;  // [wrench]
  std::size_t nFree_ = 0;
  std::size_t nSeen_ = 0;
  std::size_t nHorizon_ = 0;
  int unpaired_ = 0;
};

template <int W>
HANDHOLD_INLINE Lanes<W> lanesOf(const std::array<double, 8>& a) {
  return Lanes<W>::load(a.data());
}

/// The index of the least of n distances, the lowest among equals; kNone when all are infinite.
template <int W>
HANDHOLD_INLINE std::uint32_t nearestOf(const double* distances, std::uint32_t n) {
  const Lanes<W> none = Lanes<W>::all(HUGE_VAL);
  Lanes<W> best = none;
  Lanes<W> bestBlock = Lanes<W>::all(0);
  Lanes<W> block = bestBlock;
  for (std::uint32_t i = 0; i < n; i += 8) {
    const Lanes<W> distance = Lanes<W>::load(distances + i);
    const auto nearer = best > distance;
    best = select(nearer, distance, best);
    bestBlock = select(nearer, block, bestBlock);
    block = block + Lanes<W>::all(8);
  }
  const double distance = least(best);
  if (!(distance < HUGE_VAL)) return kNone;
  const auto isBest = best == Lanes<W>::all(distance);
  return static_cast<std::uint32_t>(least(select(isBest, bestBlock + laneNumbers<W>(), none)));
}

template <int W>
std::uint32_t InnerPolytope<W>::newFacet() {
  return nFree_ > 0 ? memory_.free[--nFree_] : memory_.nFacets++;
}

template <int W>
void InnerPolytope<W>::setPoint(int vertex, const double* v) {
  for (int k = 0; k < 6; ++k) memory_.vertices.points[vertex][k] = v[k] - center_[k];
}

/// |n|, and the distance (1 + n . c) / |n|.
template <int W>
void InnerPolytope<W>::measure(std::uint32_t index) {
  const Facet& facet = memory_.facets[index];
  NormalBlock& block = memory_.normals[index / 8];
  for (int k = 0; k < 6; ++k) block[k][index % 8] = facet.normal[k];
  const Lanes<W> n = lanesOf<W>(facet.normal);
  const auto isNormal = laneNumbers<W>() <= Lanes<W>::all(5);
  const double norm = std::sqrt(sum(select(isNormal, n * n, Lanes<W>::all(0))));
  memory_.norms[index] = norm;
  memory_.distances[index] = (1 + facet.normal[6]) / norm;
}

/// Facet k misses corner k.
template <int W>
void InnerPolytope<W>::start(const Matrix6& basis, const Vector6& interiorPoint, const std::array<int, 7>& vertices) {
  memory_.reserve(7);
  std::fill_n(memory_.distances.begin(), memory_.nFacets, HUGE_VAL);  // of the last call
  memory_.nFacets = 0;
  const Vector6 center = (basis.rowwise().sum() + interiorPoint) / 7;
  for (int k = 0; k < 6; ++k) center_[k] = center[k];
  const StartSimplex simplex = startSimplex(basis.colwise() - center, interiorPoint - center);
  for (int k = 0; k < 7; ++k) setPoint(vertices[k], k < 6 ? basis.col(k).data() : interiorPoint.data());
  for (int k = 0; k < 7; ++k) {
    Facet& facet = memory_.facets[newFacet()];
    for (int i = 0; i < 6; ++i) facet.normal[i] = simplex.normals[k][i];
    facet.normal[6] = simplex.normals[k].dot(center);
    measure(static_cast<std::uint32_t>(k));
    facet.alive = true;
    for (int corner = 0, side = 0; corner < 7; ++corner) {
      if (corner == k) continue;
      facet.vertices[side] = static_cast<std::uint16_t>(vertices[corner]);
      facet.neighbours[side++] = placeOf(static_cast<std::uint32_t>(corner), k < corner ? k : k - 1);
    }
  }
}

template <int W>
std::uint32_t InnerPolytope<W>::nearestFacet() const {
  return nearestOf<W>(memory_.distances.data(), memory_.nFacets);
}

/// How far the point lies beyond every facet's plane; of dead facets it means nothing.
template <int W>
void InnerPolytope<W>::measureHeights(const Point& p) {
  const Lanes<W> one = Lanes<W>::all(1);
  for (std::uint32_t i = 0; i < memory_.nFacets; i += 8) {
    const NormalBlock& block = memory_.normals[i / 8];
    const auto term = [&](int k) { return lanesOf<W>(block[k]) * p[k]; };
    const Lanes<W> height = ((term(0) + term(4)) + term(2)) + ((term(1) + term(5)) + term(3));
    const Lanes<W> tolerance = Lanes<W>::load(memory_.norms.data() + i) * planeTolerance_;
    height.store(memory_.heights.data() + i);
    ((height - one) - tolerance).store(memory_.excess.data() + i);
  }
}

/// Facets seen from the point, by flood from one of them, and the ridges where seen meets hidden. The first time that a
/// facet is looked at from a neighbour it joins the list.
template <int W>
void InnerPolytope<W>::collectSeen(std::uint32_t first) {
  const Facet* const facets = memory_.facets.data();
  const double* const excess = memory_.excess.data();
  std::uint32_t* const passes = memory_.passes.data();
  std::uint32_t* const seenList = memory_.seen.data();
  Place* const horizon = memory_.horizon.data();
  const std::uint32_t pass = memory_.pass;
  std::size_t nSeen = 1, nHorizon = 0;
  passes[first] = pass;
  seenList[0] = first;
  for (std::size_t i = 0; i < nSeen; ++i) {
    const std::uint32_t index = seenList[i];
    for (int side = 0; side < 6; ++side) {
      const std::uint32_t across = facetOf(facets[index].neighbours[side]);
      const bool isSeen = excess[across] > 0;
      const bool isNew = passes[across] != pass;
      passes[across] = pass;
      seenList[nSeen] = across;
      nSeen += static_cast<std::size_t>(isSeen & isNew);
      horizon[nHorizon] = placeOf(index, side);
      nHorizon += static_cast<std::size_t>(!isSeen);
    }
  }
  nSeen_ = nSeen;
  nHorizon_ = nHorizon;
}

/// Joins two new facets across the ridge of p and the four vertices in `key`; false when a third one has that ridge.
template <int W>
bool InnerPolytope<W>::link(std::uint64_t key, Place place) {
  const Place other = memory_.ridges.join(key, place);  // the first waits beside itself
  if (other == kNone) return false;
  memory_.facets[facetOf(place)].neighbours[sideOf(place)] = other;
  memory_.facets[facetOf(other)].neighbours[sideOf(other)] = place;
  unpaired_ += other == place ? 1 : -1;
  return true;
}

/// The facet through a ridge of the horizon and the new point. Its polar vertex lies on the edge from the hidden G to
/// the seen V, where n . p = 1 (README.md, equation (9); p is taken from c):
///     n = n_G + alpha (n_V - n_G),   alpha = (1 - n_G . p) / (n_V . p - n_G . p) in [0, 1)
template <int W>
bool InnerPolytope<W>::coverRidge(Place ridge, int vertex) {
  const std::uint32_t index = newFacet();
  Facet& facet = memory_.facets[index];
  const Facet& seen = memory_.facets[facetOf(ridge)];
  const int missed = sideOf(ridge);
  const Place hiddenPlace = seen.neighbours[missed];
  Facet& hidden = memory_.facets[facetOf(hiddenPlace)];
  // A point that lies on the plane of G within the tolerance may be a little beyond it: G's plane is kept.
  const double below = std::max(0.0, 1 - memory_.heights[facetOf(hiddenPlace)]);
  const double alpha = below / (below + (memory_.heights[facetOf(ridge)] - 1));
  const Lanes<W> g = lanesOf<W>(hidden.normal);
  (g + (lanesOf<W>(seen.normal) - g) * alpha).store(facet.normal.data());
  measure(index);
  memory_.passes[index] = 0;
  facet.alive = true;

  facet.vertices = seen.vertices;  // the last takes the place of the one that the ridge misses, p comes last
  facet.vertices[missed] = facet.vertices[5];
  facet.vertices[5] = static_cast<std::uint16_t>(vertex);
  facet.neighbours[5] = hiddenPlace;
  hidden.neighbours[sideOf(hiddenPlace)] = placeOf(index, 5);
  std::uint64_t ridgeCode = 0;
  for (int side = 0; side < 5; ++side) ridgeCode += memory_.vertices.codes[facet.vertices[side]];
  for (int side = 0; side < 5; ++side) {
    if (!link(ridgeCode - memory_.vertices.codes[facet.vertices[side]], placeOf(index, side))) return false;
  }
  return true;
}

template <int W>
bool InnerPolytope<W>::insert(int vertex, std::uint32_t first) {
  if (++memory_.pass == 0) {  // once in 2^32 passes old marks could look new
    std::fill(memory_.passes.begin(), memory_.passes.end(), 0);
    memory_.pass = 1;
  }
  measureHeights(memory_.vertices.points[vertex]);
  collectSeen(first);
  // A ridge of the horizon brings 2.5 keys.
  memory_.ridges.begin(std::max<std::size_t>(2048, 32 * nHorizon_));
  unpaired_ = 0;
  if (memory_.nFacets + nHorizon_ > kFacetLimit) return false;
  memory_.reserve(memory_.nFacets + nHorizon_);  // references stay valid while ridges are covered
  for (std::size_t i = 0; i < nHorizon_; ++i) {
    if (!coverRidge(memory_.horizon[i], vertex)) return false;
  }
  for (std::size_t i = 0; i < nSeen_; ++i) {
    const std::uint32_t index = memory_.seen[i];
    memory_.facets[index].alive = false;
    memory_.distances[index] = HUGE_VAL;
    memory_.free[nFree_++] = index;
  }
  return unpaired_ == 0;
}

template <int W>
bool InnerPolytope<W>::planesHold() const {
  for (std::uint32_t i = 0; i < memory_.nFacets; ++i) {
    const Facet& facet = memory_.facets[i];
    if (!facet.alive) continue;
    const double worst = planeError<W>(facet.normal, facet.vertices, memory_.vertices.points);
    if (!(worst <= 0.1 * epsilonTolerance_ * memory_.norms[i])) return false;
  }
  return true;
}

}  // namespace handhold::polar
