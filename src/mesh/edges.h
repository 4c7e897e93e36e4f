#pragma once

#include "mesh/triangle_mesh.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace handhold {

/// One use of an edge by a triangle. Uses of the same edge, in either direction, have equal keys.
struct EdgeUse {
  std::uint64_t key = 0;  // smaller vertex index << 32 | larger one
  std::uint32_t triangle = 0;
  std::int32_t direction = 0;  // +1 from the smaller index to the larger, -1 back
};

/// All uses of all edges, sorted by key, then by triangle.
inline std::vector<EdgeUse> edgeUses(const TriangleMesh& mesh) {
  std::vector<EdgeUse> uses;
  uses.reserve(3 * mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto& t = mesh.triangles[i];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t from = t[k];
      const std::uint64_t to = t[(k + 1) % 3];
      uses.push_back(
          {std::min(from, to) << 32 | std::max(from, to), static_cast<std::uint32_t>(i), from < to ? 1 : -1});
    }
  }
  std::sort(uses.begin(), uses.end(), [](const EdgeUse& a, const EdgeUse& b) {
    return a.key != b.key ? a.key < b.key : a.triangle < b.triangle;
  });
  return uses;
}

/// Calls visit(begin, end) for the uses of each edge in turn.
template <typename Visit>
void forEachEdge(const std::vector<EdgeUse>& uses, Visit visit) {
  for (std::size_t begin = 0; begin < uses.size();) {
    std::size_t end = begin + 1;
    while (end < uses.size() && uses[end].key == uses[begin].key) ++end;
    visit(uses.data() + begin, uses.data() + end);
    begin = end;
  }
}

struct EdgeCounts {
  std::size_t all = 0;
  std::size_t shared = 0;      // used by two triangles or more
  std::size_t unbalanced = 0;  // used more often in one direction than in the other: the oriented boundary
};

inline EdgeCounts countEdges(const std::vector<EdgeUse>& uses) {
  EdgeCounts counts;
  forEachEdge(uses, [&](const EdgeUse* begin, const EdgeUse* end) {
    int balance = 0;
    for (const EdgeUse* use = begin; use != end; ++use) balance += use->direction;
    counts.all += 1;
    counts.shared += end - begin >= 2 ? 1 : 0;
    counts.unbalanced += balance != 0 ? 1 : 0;
  });
  return counts;
}

}  // namespace handhold
