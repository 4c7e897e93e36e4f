#include "simulate/contacts.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <tuple>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Place = ContactScratch::Place;

/// The closest points of segments p0p1 and q0q1. Parallel segments take an end of the overlap; the other end comes up
/// as a vertex against the other triangle.
std::pair<Vector3d, Vector3d> closestOnSegments(const Vector3d& p0, const Vector3d& p1, const Vector3d& q0,
                                                const Vector3d& q1) {
  const Vector3d u = p1 - p0, v = q1 - q0, w = p0 - q0;
  const double a = u.dot(u), b = u.dot(v), c = v.dot(v), d = u.dot(w), e = v.dot(w);
  const double determinant = a * c - b * b;
  double s = determinant > 1e-12 * a * c ? std::clamp((b * e - c * d) / determinant, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + e) / c, 0.0, 1.0);
  s = std::clamp((b * t - d) / a, 0.0, 1.0);
  return {p0 + s * u, q0 + t * v};
}

// Added to the contact distance before something is ruled out: rounding of a coordinate or height of metres is 1e-15 m.
constexpr double kRounding = 1e-9;  // m

/// Which corners of a triangle lie beyond another one along an axis, a bit each.
struct Sides {
  unsigned above = 0, below = 0;
  bool areBeyond(unsigned corners) const { return (above & corners) == corners || (below & corners) == corners; }
};
constexpr unsigned kAllCorners = 7;
constexpr std::array<unsigned, 3> kCorner = {1, 2, 4}, kEdge = {3, 6, 5};

/// Beyond: more than `reach` above or below all of `other`.
Sides sidesOf(const Corners& triangle, const Corners& other, const Vector3d& axis, double reach) {
  const double a = axis.dot(other[0]), b = axis.dot(other[1]), c = axis.dot(other[2]);
  const double top = std::max(std::max(a, b), c) + reach, bottom = std::min(std::min(a, b), c) - reach;
  Sides sides;
  for (int i = 0; i < 3; ++i) {
    const double height = axis.dot(triangle[i]);
    sides.above |= height > top ? kCorner[i] : 0;
    sides.below |= height < bottom ? kCorner[i] : 0;
  }
  return sides;
}

/// Are the lines of two edges farther apart than `reach`? Never when they are nearly parallel.
bool linesAreApart(const Vector3d& p, const Vector3d& u, const Vector3d& q, const Vector3d& v, double reach) {
  constexpr double kWellConditioned = 1e-6;  // squared sine of the angle
  const Vector3d axis = u.cross(v);
  const double square = axis.squaredNorm(), gap = axis.dot(p - q);
  return gap * gap > reach * reach * square && square > kWellConditioned * u.squaredNorm() * v.squaredNorm();
}

/// Coordinate by coordinate more than `reach` apart?
bool edgesAreApart(const Vector3d& p0, const Vector3d& p1, const Vector3d& q0, const Vector3d& q1, double reach) {
  return (p0.cwiseMax(p1).array() + reach < q0.cwiseMin(q1).array()).any() ||
         (p0.cwiseMin(p1).array() - reach > q0.cwiseMax(q1).array()).any();
}

Eigen::AlignedBox3d boxOf(const Corners& t, double margin) {
  return {t[0].cwiseMin(t[1]).cwiseMin(t[2]).array() - margin, t[0].cwiseMax(t[1]).cwiseMax(t[2]).array() + margin};
}

constexpr int kLinkCorner = 3, kEdges = 6;  // where in FeaturePairs they begin

/// The pairs of features that may be within `reach`. Most triangles have none. They are ruled out by a gap along an
/// axis of length one (a normal, a coordinate axis, the common normal of two edges), which is no larger than their
/// distance, however badly the axis is known.
FeaturePairs closeFeatures(const ContactTriangle& object, const ContactTriangle& link, double reach) {
  const Corners &a = object.corners, &b = link.corners;
  const Sides sidesA = sidesOf(a, b, link.normal, reach);
  if (sidesA.areBeyond(kAllCorners)) return 0;
  const Sides sidesB = sidesOf(b, a, object.normal, reach);
  if (sidesB.areBeyond(kAllCorners)) return 0;
  FeaturePairs close = 0;
  const auto set = [&](int bit) { close |= FeaturePairs{1} << bit; };
  const Eigen::AlignedBox3d boxA = boxOf(a, reach), boxB = boxOf(b, reach);
  for (int i = 0; i < 3; ++i) {
    if (!sidesA.areBeyond(kCorner[i]) && boxB.contains(a[i])) set(i);
    if (!sidesB.areBeyond(kCorner[i]) && boxA.contains(b[i])) set(kLinkCorner + i);
  }
  for (int i = 0; i < 3; ++i) {
    if (sidesA.areBeyond(kEdge[i])) continue;
    const Vector3d &p0 = a[i], &p1 = a[(i + 1) % 3];
    for (int j = 0; j < 3; ++j) {
      const Vector3d &q0 = b[j], &q1 = b[(j + 1) % 3];
      if (sidesB.areBeyond(kEdge[j]) || edgesAreApart(p0, p1, q0, q1, reach)) continue;
      if (!linesAreApart(p0, p1 - p0, q0, q1 - q0, reach)) set(kEdges + 3 * i + j);
    }
  }
  return close;
}

/// The candidate that stays of those at one place; position and normal keep the order of adding out of it.
bool isBetter(const ContactCandidate& a, const ContactCandidate& b) {
  const auto rank = [](const ContactCandidate& c) {
    const Vector3d &p = c.position, &n = c.normal;
    return std::tuple(c.facing, c.gap, p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  };
  return rank(a) < rank(b);
}

/// The nearest whole number, halves away from zero.
std::int64_t rounded(double x) {
  const auto whole = static_cast<std::int64_t>(x);
  const double rest = x - static_cast<double>(whole);
  return whole + (rest >= 0.5) - (rest <= -0.5);
}

/// The cells of 0.1 um that hold candidates, in the order of their first, each with its best.
void findPlaces(std::span<const ContactCandidate> candidates, ContactScratch& scratch) {
  constexpr double kSamePlace = 1e-7;  // m
  const std::size_t nSlots = std::bit_ceil(2 * candidates.size() + 1);
  scratch.places.clear();
  scratch.slots.assign(nSlots, 0);
  for (const ContactCandidate& candidate : candidates) {
    std::array<std::int64_t, 3> cell;
    std::uint64_t hash = 0;
    for (int k = 0; k < 3; ++k) {
      cell[k] = rounded(candidate.position[k] / kSamePlace);
      hash = (hash ^ static_cast<std::uint64_t>(cell[k])) * 0x9e3779b97f4a7c15;
      hash ^= hash >> 32;
    }
    std::size_t slot = hash & (nSlots - 1);
    while (scratch.slots[slot] != 0 && scratch.places[scratch.slots[slot] - 1].cell != cell) {
      slot = (slot + 1) & (nSlots - 1);
    }
    if (scratch.slots[slot] == 0) {
      scratch.places.push_back({cell, candidate, std::numeric_limits<double>::infinity()});
      scratch.slots[slot] = static_cast<std::uint32_t>(scratch.places.size());
    } else if (ContactCandidate& best = scratch.places[scratch.slots[slot] - 1].best; isBetter(candidate, best)) {
      best = candidate;
    }
  }
}

}  // namespace

ContactTriangle contactTriangle(const Corners& corners) {
  return {corners, (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized()};
}

Vector3d closestPointOnTriangle(const Vector3d& p, const Corners& triangle) {
  const auto& [a, b, c] = triangle;
  const Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const double scale = 1 / (va + vb + vc);
  return a + vb * scale * ab + vc * scale * ac;
}

void addContactCandidates(const ContactTriangle& object, const ContactTriangle& link, double contactDistance,
                          bool twoSided, std::vector<ContactCandidate>& candidates) {
  const FeaturePairs close = closeFeatures(object, link, contactDistance + kRounding);
  addContactCandidates(object, link, close, contactDistance, twoSided, candidates);
}

void addContactCandidates(const ContactTriangle& object, const ContactTriangle& link, FeaturePairs close,
                          double contactDistance, bool twoSided, std::vector<ContactCandidate>& candidates) {
  Vector3d normal = object.normal;
  double facing = normal.dot(link.normal);
  if (twoSided && facing > 0) {
    normal = -normal;
    facing = -facing;
  }
  if (facing >= 0) return;
  const auto add = [&](const Vector3d& onObject, const Vector3d& onLink) {
    const double gap = (onObject - onLink).norm();
    if (gap <= contactDistance) candidates.push_back({onObject, normal, gap, facing});
  };
  const Corners &a = object.corners, &b = link.corners;
  for (FeaturePairs left = close; left != 0; left &= left - 1) {
    const int bit = std::countr_zero(left);
    if (bit < kLinkCorner) {
      add(a[bit], closestPointOnTriangle(a[bit], b));
    } else if (bit < kEdges) {
      const Vector3d& p = b[bit - kLinkCorner];
      add(closestPointOnTriangle(p, a), p);
    } else {
      const int i = (bit - kEdges) / 3, j = (bit - kEdges) % 3;
      const auto [p, q] = closestOnSegments(a[i], a[(i + 1) % 3], b[j], b[(j + 1) % 3]);
      add(p, q);
    }
  }
}

void selectContacts(std::span<const ContactCandidate> candidates, int maximum, double spacing, std::uint16_t link,
                    ContactScratch& scratch, std::vector<Contact>& contacts) {
  findPlaces(candidates, scratch);
  if (scratch.places.empty()) return;
  const auto isCloser = [](const Place& a, const Place& b) {
    return std::tie(a.best.gap, a.cell) < std::tie(b.best.gap, b.cell);
  };
  const Place* next = &*std::min_element(scratch.places.begin(), scratch.places.end(), isCloser);
  for (int taken = 0; taken < maximum; ++taken) {
    const ContactCandidate& last = next->best;
    contacts.push_back({last.position, -last.normal, link});
    next = nullptr;
    for (Place& place : scratch.places) {
      place.distance = std::min(place.distance, (place.best.position - last.position).norm());
      const bool isFarther = next == nullptr || place.distance > next->distance ||
                             (place.distance == next->distance && place.cell < next->cell);
      if (isFarther) next = &place;
    }
    if (next->distance < spacing) return;
  }
}

}  // namespace handhold
