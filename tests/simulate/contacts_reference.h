#pragma once

#include "simulate/contacts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

// The contact rules of src/simulate/contacts.h said plainly: every pair of features is measured, everything is sorted.
namespace handhold::reference {

using Eigen::Vector3d;

/// The closest points of segments p0p1 and q0q1. Parallel segments take an end of the overlap; the other end comes up
/// as a vertex against the other triangle.
inline std::pair<Vector3d, Vector3d> closestOnSegments(const Vector3d& p0, const Vector3d& p1, const Vector3d& q0,
                                                       const Vector3d& q1) {
  const Vector3d u = p1 - p0, v = q1 - q0, w = p0 - q0;
  const double a = u.dot(u), b = u.dot(v), c = v.dot(v), d = u.dot(w), e = v.dot(w);
  const double determinant = a * c - b * b;
  double s = determinant > 1e-12 * a * c ? std::clamp((b * e - c * d) / determinant, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + e) / c, 0.0, 1.0);
  s = std::clamp((b * t - d) / a, 0.0, 1.0);
  return {p0 + s * u, q0 + t * v};
}

inline Vector3d unitNormal(const Corners& t) { return (t[1] - t[0]).cross(t[2] - t[0]).normalized(); }

/// The closest points of each pair of features, on the object and on the link, in the order of FeaturePairs.
inline std::array<std::pair<Vector3d, Vector3d>, 15> closestPairs(const Corners& object, const Corners& link) {
  std::array<std::pair<Vector3d, Vector3d>, 15> pairs;
  for (int i = 0; i < 3; ++i) {
    pairs[i] = {object[i], closestPointOnTriangle(object[i], link)};
    pairs[3 + i] = {closestPointOnTriangle(link[i], object), link[i]};
    for (int j = 0; j < 3; ++j) {
      pairs[6 + 3 * i + j] = closestOnSegments(object[i], object[(i + 1) % 3], link[j], link[(j + 1) % 3]);
    }
  }
  return pairs;
}

inline void addContactCandidates(const Corners& object, const Corners& link, double contactDistance, bool twoSided,
                                 std::vector<ContactCandidate>& candidates) {
  Vector3d normal = unitNormal(object);
  double facing = normal.dot(unitNormal(link));
  if (twoSided && facing > 0) {
    normal = -normal;
    facing = -facing;
  }
  if (facing >= 0) return;
  const auto add = [&](const Vector3d& onObject, const Vector3d& onLink) {
    const double gap = (onObject - onLink).norm();
    if (gap <= contactDistance) candidates.push_back({onObject, normal, gap, facing});
  };
  for (const auto& [onObject, onLink] : closestPairs(object, link)) add(onObject, onLink);
}

inline void selectContacts(std::vector<ContactCandidate>& candidates, int maximum, double spacing, std::uint16_t link,
                           std::vector<Contact>& contacts) {
  static constexpr double kSamePlace = 1e-7;  // m
  const auto place = [](const ContactCandidate& c) {
    const Eigen::Array3d cell = (c.position / kSamePlace).array().round();
    return std::tuple(cell.x(), cell.y(), cell.z());
  };
  const auto rest = [](const ContactCandidate& c) {
    return std::tuple(c.position.x(), c.position.y(), c.position.z(), c.normal.x(), c.normal.y(), c.normal.z());
  };
  std::sort(candidates.begin(), candidates.end(), [&](const auto& a, const auto& b) {
    return std::tuple(place(a), a.facing, a.gap, rest(a)) < std::tuple(place(b), b.facing, b.gap, rest(b));
  });
  const auto samePlace = [&](const auto& a, const auto& b) { return place(a) == place(b); };
  candidates.erase(std::unique(candidates.begin(), candidates.end(), samePlace), candidates.end());
  if (candidates.empty()) return;

  std::vector<double> distance(candidates.size(), std::numeric_limits<double>::infinity());
  std::size_t next = std::min_element(candidates.begin(), candidates.end(),
                                      [](const auto& a, const auto& b) { return a.gap < b.gap; }) -
                     candidates.begin();
  for (int taken = 0; taken < maximum; ++taken) {
    contacts.push_back({candidates[next].position, -candidates[next].normal, link});
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      distance[i] = std::min(distance[i], (candidates[i].position - candidates[next].position).norm());
    }
    next = std::max_element(distance.begin(), distance.end()) - distance.begin();
    if (distance[next] < spacing) return;
  }
}

}  // namespace handhold::reference
