#pragma once

#include "core/random.h"
#include "simulate/contacts.h"

#include <cmath>
#include <cstdint>
#include <utility>

// Pairs of triangles in every position that contacts know, and around the distance that decides.
namespace handhold::testing {

inline Eigen::Vector3d randomPoint(const RandomStream& stream, int i) {
  return {stream.uniform(3 * i) - 0.5, stream.uniform(3 * i + 1) - 0.5, stream.uniform(3 * i + 2) - 0.5};
}

constexpr double kContactDistance = 1e-4;
enum class PairKind {
  apart,
  touching,
  flush,
  vertexOnFace,
  edgesCrossed,
  edgesParallel,
  sliver,
  sharedEdge,
  edgesNearlyParallel,
  count
};
constexpr const char* const kPairNames[] = {"apart",          "touching",      "flush",
                                            "vertex on face", "crossed edges", "parallel edges",
                                            "sliver",         "shared edge",   "nearly parallel edges"};

/// A random pair of triangles in one of the positions, some of which are degenerate.
inline std::pair<Corners, Corners> trianglePair(PairKind kind, std::uint64_t seed) {
  const RandomStream stream = RandomStream(seed).child(static_cast<std::uint64_t>(kind));
  const auto number = [&](int i) { return stream.uniform(100 + i); };
  const double size = std::pow(10.0, -3 + 2 * number(0));  // m
  Corners a = {size * randomPoint(stream, 0), size * randomPoint(stream, 1), size * randomPoint(stream, 2)};
  Corners b = {size * randomPoint(stream, 3), size * randomPoint(stream, 4), size * randomPoint(stream, 5)};
  // Around the contact distance, on both sides of it and at times exactly there.
  const double gap = kContactDistance * (number(1) < 0.2 ? 1 : 2 * number(2));
  const Eigen::Vector3d normal = contactTriangle(a).normal;
  const auto moveTo = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    for (Eigen::Vector3d& corner : b) corner += to - from;
  };
  const Eigen::Vector3d inside = 0.2 * a[0] + 0.5 * a[1] + 0.3 * a[2];
  switch (kind) {
    case PairKind::apart:
      break;
    case PairKind::touching:
      moveTo((b[0] + b[1] + b[2]) / 3, (a[0] + a[1] + a[2]) / 3);
      break;
    case PairKind::flush:
      for (Eigen::Vector3d& corner : b) corner += (gap - normal.dot(corner - a[0])) * normal;
      break;
    case PairKind::vertexOnFace:
      moveTo(b[0], inside + gap * normal);
      break;
    case PairKind::edgesCrossed:
      moveTo(0.5 * (b[0] + b[1]), 0.3 * a[0] + 0.7 * a[1] + gap * normal);
      break;
    case PairKind::edgesParallel:
      b[1] = b[0] + (2 * number(3) - 1) * (a[1] - a[0]);
      moveTo(b[0], a[0] + number(4) * (a[1] - a[0]) + gap * normal);
      break;
    case PairKind::sliver:  // as thin as 32-bit coordinates allow
      b[2] = b[0] + number(3) * (b[1] - b[0]) + std::pow(10.0, -8 * number(4)) * (b[2] - b[0]);
      moveTo(b[number(5) < 0.5 ? 0 : 2], inside + gap * normal);
      break;
    case PairKind::sharedEdge:
      b[0] = a[1];
      b[1] = a[0];
      break;
    case PairKind::edgesNearlyParallel:
      b[1] = b[0] + (2 * number(3) - 1) * (a[1] - a[0]) + std::pow(10.0, -6 * number(5)) * (b[1] - b[0]);
      moveTo(b[0], a[0] + number(4) * (a[1] - a[0]) + gap * normal);
      break;
    case PairKind::count:
      break;
  }
  if (number(6) < 0.5) std::swap(b[1], b[2]);
  if (number(7) < 0.5) std::swap(a, b);
  return {a, b};
}

}  // namespace handhold::testing
