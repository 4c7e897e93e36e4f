#pragma once

#include "quality/inner_polytope.h"
#include "quality/polar.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

// The double description of what is near the origin, for the bounds on the true cone; no other library includes it.
namespace handhold::polar {

// Beyond it, 150 MB of facets, a set is not from a grasp.
inline constexpr std::size_t kNearFacetLimit = std::size_t{1} << 18;

/// A facet of the inner polytope: a vertex n of the polar about the centre c, with n . (v - c) = 1 at its six vertices
/// v, and the six edges of the polar that begin there. Along e_k the planes of all but v_k are kept:
/// e_k . (v_k - c) = -1, e_k . (v_j - c) = 0. What every facet is asked for lies in dense arrays of NearMemory.
struct alignas(64) NearFacet {
  std::array<double, 8> normal = {};                // n, then n . c, then 0
  std::array<std::array<double, 8>, 7> edges = {};  // [i][k]: coordinate i of e_k; [6][k]: e_k . c
  std::uint64_t key = 0;                            // sum of the codes of the vertices
  std::array<Place, 6> neighbours = {};             // [k]: the other end of e_k; kNone where it is forgotten
  std::array<std::uint16_t, 6> vertices = {};
};

/// The memory of near facets, kept between calls.
struct NearMemory {
  void reserve(std::size_t nFacetsWanted);

  std::vector<NearFacet> facets;
  std::vector<NormalBlock> normals;
  std::vector<double> norms;      // |n|
  std::vector<double> beyond;     // n . (p - c) - 1 for the last point p; > 0: it sees the facet
  std::vector<double> distances;  // of the planes from the origin; infinite when there is no such facet
  std::vector<std::uint32_t> free, present;
  RidgeTable ridges;
  Vertices vertices;
  std::uint32_t nFacets = 0;  // with the free ones
};

/// Room for so many facets.
inline void NearMemory::reserve(std::size_t nFacetsWanted) {
  if (nFacetsWanted <= facets.size()) return;
  const std::size_t size = std::bit_ceil(std::max<std::size_t>(nFacetsWanted, 256));
  facets.resize(size);
  normals.resize(size / 8);
  norms.resize(size);
  beyond.resize(size);
  distances.resize(size, HUGE_VAL);
  free.resize(size);
  present.resize(size + 1);
}

/// The facets of an inner polytope that are no farther from the origin than a bound which never grows, by vectors of W
/// doubles: start, then insert the points that its user finds beyond its facets, no seven of them in one plane. Facets
/// that are farther away are forgotten: src/quality/README.md, equations (12a) and (12b).
template <int W>
class NearFacets {
 public:
  NearFacets(NearMemory& memory, double radius) : memory_(memory), radius_(radius) {}

  /// The simplex {basis, interior point}, vertices 0 to 6.
  HANDHOLD_INLINE void start(const Matrix6& basis, const Vector6& interiorPoint);
  /// The facet nearest to the origin; kNone when rounding left none.
  HANDHOLD_INLINE std::uint32_t nearest() const;
  /// Adds a vertex and forgets what is farther away than `bound`, a number; false when rounding contradicts itself.
  HANDHOLD_INLINE bool insert(const double* v, double bound);
  /// Does each facet's plane pass through its six vertices still? Edges are sums over a chain of facets; a chain that
  /// began at a flat simplex may have lost digits.
  HANDHOLD_INLINE bool planesHold() const;
  int nVertices() const { return nVertices_; }
  /// Facets that were near when they were made.
  int nBuilt() const { return nBuilt_; }

 private:
  /// A bit for each edge whose other end is not forgotten, and for those of them where it does not see the new point.
  struct Ends {
    unsigned known = 0, hidden = 0;
  };

  HANDHOLD_INLINE int addVertex(const double* v);
  HANDHOLD_INLINE void measure(std::uint32_t index);
  HANDHOLD_INLINE std::size_t forget(double bound);
  HANDHOLD_INLINE void measureHeights(const Point& p);
  HANDHOLD_INLINE Ends endsOf(std::uint32_t from) const;
  HANDHOLD_INLINE bool cutEdges(std::uint32_t from, int vertex, double bound);
  HANDHOLD_INLINE bool link(std::uint64_t key, Place place);
  HANDHOLD_INLINE std::uint32_t newFacet();
  HANDHOLD_INLINE void drop(std::uint32_t index);

  Point center_ = {};  // c
  NearMemory& memory_;
  double radius_;
  std::size_t nFree_ = 0;
  std::size_t linkMask_ = 0;
  int nVertices_ = 0;
  int nBuilt_ = 0;
};

template <int W>
std::uint32_t NearFacets<W>::newFacet() {
  ++nBuilt_;
  return nFree_ > 0 ? memory_.free[--nFree_] : memory_.nFacets++;
}

template <int W>
void NearFacets<W>::drop(std::uint32_t index) {
  memory_.distances[index] = HUGE_VAL;
  memory_.free[nFree_++] = index;
}

template <int W>
int NearFacets<W>::addVertex(const double* v) {
  memory_.vertices.reserve(static_cast<std::size_t>(nVertices_) + 1);
  for (int i = 0; i < 6; ++i) memory_.vertices.points[nVertices_][i] = v[i] - center_[i];
  return nVertices_++;
}

/// |n|, and the distance (1 + n . c) / |n|.
template <int W>
void NearFacets<W>::measure(std::uint32_t index) {
  const std::array<double, 8>& n = memory_.facets[index].normal;
  for (int i = 0; i < 6; ++i) memory_.normals[index / 8][i][index % 8] = n[i];
  const double norm =
      std::sqrt(((n[0] * n[0] + n[1] * n[1]) + (n[2] * n[2] + n[3] * n[3])) + (n[4] * n[4] + n[5] * n[5]));
  memory_.norms[index] = norm;
  memory_.distances[index] = (1 + n[6]) / norm;
}

/// Facet k misses corner k; its edges lead to the six others.
template <int W>
void NearFacets<W>::start(const Matrix6& basis, const Vector6& interiorPoint) {
  memory_.reserve(7);
  std::fill_n(memory_.distances.begin(), memory_.nFacets, HUGE_VAL);  // of the last call
  memory_.nFacets = 0;
  const Vector6 center = (basis.rowwise().sum() + interiorPoint) / 7;
  for (int i = 0; i < 6; ++i) center_[i] = center[i];
  for (int k = 0; k < 7; ++k) addVertex(k < 6 ? basis.col(k).data() : interiorPoint.data());
  const StartSimplex simplex = startSimplex(basis.colwise() - center, interiorPoint - center);
  for (int k = 0; k < 7; ++k) {
    const std::uint32_t index = newFacet();
    NearFacet& facet = memory_.facets[index];
    facet.key = 0;
    for (int i = 0; i < 6; ++i) facet.normal[i] = simplex.normals[k][i];
    facet.normal[6] = simplex.normals[k].dot(center);
    for (int j = 0, side = 0; j < 7; ++j) {
      if (j == k) continue;
      const Vector6 corner = (j < 6 ? Vector6(basis.col(j)) : interiorPoint) - center;
      const Vector6 edge = (simplex.normals[j] - simplex.normals[k]) / (1 - simplex.normals[j].dot(corner));
      for (int i = 0; i < 6; ++i) facet.edges[i][side] = edge[i];
      facet.edges[6][side] = edge.dot(center);
      facet.vertices[side] = static_cast<std::uint16_t>(j);
      facet.key += memory_.vertices.codes[j];
      facet.neighbours[side++] = placeOf(static_cast<std::uint32_t>(j), k < j ? k : k - 1);
    }
    measure(index);
  }
}

template <int W>
std::uint32_t NearFacets<W>::nearest() const {
  return nearestOf<W>(memory_.distances.data(), memory_.nFacets);
}

/// Lists what is left in NearMemory::present.
template <int W>
std::size_t NearFacets<W>::forget(double bound) {
  std::size_t nPresent = 0;
  for (std::uint32_t index = 0; index < memory_.nFacets; ++index) {
    const double distance = memory_.distances[index];
    memory_.present[nPresent] = index;
    nPresent += static_cast<std::size_t>(distance <= bound);
    if (distance <= bound || distance == HUGE_VAL) continue;
    for (const Place place : memory_.facets[index].neighbours) {
      if (place != kNone) memory_.facets[facetOf(place)].neighbours[sideOf(place)] = kNone;
    }
    drop(index);
  }
  return nPresent;
}

/// How far the point lies beyond every facet's plane, in units of the plane's distance from c.
template <int W>
void NearFacets<W>::measureHeights(const Point& p) {
  const Lanes<W> one = Lanes<W>::all(1);
  for (std::uint32_t i = 0; i < memory_.nFacets; i += 8) {
    (product<W>(memory_.normals[i / 8], p.data()) - one).store(memory_.beyond.data() + i);
  }
}

/// Joins two new facets across the ridge of p and the four vertices in `key`; false when a third one has that ridge. A
/// ridge that stays alone has its other end among what is forgotten.
template <int W>
bool NearFacets<W>::link(std::uint64_t key, Place place) {
  const Place other = memory_.ridges.join(key, place);
  if (other == kNone) return false;
  if (other == place) return true;
  memory_.facets[facetOf(place)].neighbours[sideOf(place)] = other;
  memory_.facets[facetOf(other)].neighbours[sideOf(other)] = place;
  return true;
}

/// a |a|, which compares as a does.
template <int W>
HANDHOLD_INLINE Lanes<W> squared(const Lanes<W>& a) {
  return a * larger(a, Lanes<W>::all(0) - a);
}

template <int W>
auto NearFacets<W>::endsOf(std::uint32_t from) const -> Ends {
  const std::array<Place, 6>& neighbours = memory_.facets[from].neighbours;
  Ends ends;
  for (int k = 0; k < 6; ++k) {
    const bool isKnown = neighbours[k] != kNone;
    const bool isHidden = memory_.beyond[isKnown ? facetOf(neighbours[k]) : from] <= 0;
    ends.known |= static_cast<unsigned>(isKnown) << k;
    ends.hidden |= static_cast<unsigned>(isKnown & isHidden) << k;
  }
  return ends;
}

/// Makes the facets through the new point and a ridge of one facet that are near, equation (12b).
template <int W>
bool NearFacets<W>::cutEdges(std::uint32_t from, int vertex, double bound) {
  constexpr unsigned kAllEdges = 63;
  const bool isSeen = memory_.beyond[from] > 0;
  const auto [known, hidden] = endsOf(from);
  const unsigned wanted = (kAllEdges & ~known) | (isSeen ? hidden : 0);  // that may meet the new plane
  if (wanted == 0) return true;
  const NearFacet& facet = memory_.facets[from];
  const Point& p = memory_.vertices.points[vertex];
  std::array<Lanes<W>, 7> edge, normal;
  // Unrolled, so that these live in registers.
#pragma GCC unroll 7
  for (int i = 0; i < 7; ++i) edge[i] = Lanes<W>::load(facet.edges[i].data());
  const Lanes<W> slope =
      ((edge[0] * p[0] + edge[1] * p[1]) + (edge[2] * p[2] + edge[3] * p[3])) + (edge[4] * p[4] + edge[5] * p[5]);
  const Lanes<W> t = Lanes<W>::all(-memory_.beyond[from]) / slope;
#pragma GCC unroll 7
  for (int i = 0; i < 7; ++i) normal[i] = Lanes<W>::all(facet.normal[i]) + t * edge[i];
  const Lanes<W> square =
      ((normal[0] * normal[0] + normal[1] * normal[1]) + (normal[2] * normal[2] + normal[3] * normal[3])) +
      (normal[4] * normal[4] + normal[5] * normal[5]);
  const Lanes<W> height = Lanes<W>::all(1) + normal[6];
  unsigned near = wanted & bitsOf(height * height <= square * (bound * bound));
  for (unsigned far = isSeen ? wanted & ~near : 0; far != 0; far &= far - 1) {
    const Place place = facet.neighbours[std::countr_zero(far)];
    if (place != kNone) memory_.facets[facetOf(place)].neighbours[sideOf(place)] = kNone;
  }
  // Past a forgotten end an edge's line may come out of what is forgotten again: there, bound |n| - n . c grows.
  const Lanes<W> along = ((normal[0] * edge[0] + normal[1] * edge[1]) + (normal[2] * edge[2] + normal[3] * edge[3])) +
                         (normal[4] * edge[4] + normal[5] * edge[5]);
  const unsigned meeting = bitsOf(isSeen ? Lanes<W>::all(0) > slope : slope > Lanes<W>::all(0));
  const unsigned before = bitsOf(squared(edge[6]) * square > squared(along) * (bound * bound));
  if ((near & known & ~meeting) != 0) return false;  // rounding
  near &= known | (meeting & before);
  if (near == 0) return true;

  alignas(64) std::array<double, 8> slopes;
  alignas(64) std::array<std::array<double, 8>, 7> normals;
  slope.store(slopes.data());
#pragma GCC unroll 7
  for (int i = 0; i < 7; ++i) normal[i].store(normals[i].data());
  for (unsigned rest = near; rest != 0; rest &= rest - 1) {
    const int k = std::countr_zero(rest);
    const Place place = facet.neighbours[k];
    const std::uint32_t index = newFacet();
    NearFacet& made = memory_.facets[index];
    const auto isLeaving = laneNumbers<W>() == Lanes<W>::all(k);
    const double scale = -1 / slopes[k];
#pragma GCC unroll 7
    for (int i = 0; i < 7; ++i) {
      const double onward = facet.edges[i][k] * scale;
      made.normal[i] = normals[i][k];
      select(isLeaving, Lanes<W>::all(onward), edge[i] + slope * onward).store(made.edges[i].data());
    }
    made.vertices = facet.vertices;
    made.vertices[k] = static_cast<std::uint16_t>(vertex);
    const std::uint64_t ridge = facet.key - memory_.vertices.codes[facet.vertices[k]];
    made.key = ridge + memory_.vertices.codes[vertex];
    made.neighbours.fill(kNone);
    const Place behind = isSeen ? place : placeOf(from, k);
    made.neighbours[k] = behind;
    if (behind != kNone) memory_.facets[facetOf(behind)].neighbours[sideOf(behind)] = placeOf(index, k);
    measure(index);
    for (int side = 0; side < 6; ++side) {
      if (side != k && !link(ridge - memory_.vertices.codes[made.vertices[side]], placeOf(index, side))) return false;
    }
  }
  return true;
}

template <int W>
bool NearFacets<W>::insert(const double* v, double bound) {
  if (nVertices_ >= kVertexLimit) return false;
  const int vertex = addVertex(v);
  const std::size_t nPresent = forget(bound);
  if (memory_.nFacets + 6 * nPresent > kNearFacetLimit) return false;
  memory_.reserve(memory_.nFacets + 6 * nPresent);  // references stay valid while edges are cut
  memory_.ridges.begin(std::max<std::size_t>(1024, 64 * nPresent));
  measureHeights(memory_.vertices.points[vertex]);
  for (std::size_t i = 0; i < nPresent; ++i) {
    if (!cutEdges(memory_.present[i], vertex, bound)) return false;
  }
  for (std::size_t i = 0; i < nPresent; ++i) {
    if (memory_.beyond[memory_.present[i]] > 0) drop(memory_.present[i]);
  }
  return true;
}

template <int W>
bool NearFacets<W>::planesHold() const {
  for (std::uint32_t index = 0; index < memory_.nFacets; ++index) {
    if (memory_.distances[index] == HUGE_VAL) continue;
    const NearFacet& facet = memory_.facets[index];
    const double worst = planeError<W>(facet.normal, facet.vertices, memory_.vertices.points);
    if (!(worst <= 0.1 * kEpsilonTolerance * radius_ * memory_.norms[index])) return false;
  }
  return true;
}

}  // namespace handhold::polar
