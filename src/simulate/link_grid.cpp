#include "simulate/link_grid.h"

#include "core/error.h"
#include "mesh/mass_properties.h"
#include "mesh/ray_scene.h"
#include "simulate/contacts.h"
#include "simulate/object_shell.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace handhold {
namespace {

using Eigen::AlignedBox3d;
using Eigen::AlignedBox3f;
using Eigen::Vector3d;

constexpr double kStep = 1e-3;                 // m
constexpr double kBlockStep = 4e-3;            // m
constexpr float kBlockReach = 14e-3F;          // m
constexpr std::size_t kMostNodes = 2'000'000;  // of one link; larger links get a wider step

/// The nodes of `lattice` in a box, as half-open ranges.
template <class T>
std::array<std::array<int, 2>, 3> nodesIn(const Lattice<T>& lattice, const AlignedBox3d& box) {
  std::array<std::array<int, 2>, 3> range{};
  for (int i = 0; i < 3; ++i) {
    const double first = std::ceil((box.min()[i] - lattice.origin[i]) / lattice.step);
    const double last = std::floor((box.max()[i] - lattice.origin[i]) / lattice.step);
    range[i] = {std::max(0, static_cast<int>(first)), std::min(lattice.size[i], static_cast<int>(last) + 1)};
  }
  return range;
}

template <class T>
void layOut(Lattice<T>& lattice, const Vector3d& origin, const Vector3d& extent, double step) {
  lattice.origin = origin.cast<float>();
  lattice.step = static_cast<float>(step);
  for (int i = 0; i < 3; ++i) lattice.size[i] = static_cast<int>(std::ceil(extent[i] / step)) + 2;
}

AlignedBox3d boxAround(const Corners& corners, double margin) {
  AlignedBox3d box(corners[0]);
  box.extend(corners[1]).extend(corners[2]);
  return {box.min().array() - margin, box.max().array() + margin};
}

/// Calls visit(x, y, z, node, closest point of the triangle) for every node within `reach` of the triangle.
template <class T, class Visit>
void visitNear(const Lattice<T>& lattice, const Corners& corners, double reach, const Visit& visit) {
  const auto range = nodesIn(lattice, boxAround(corners, reach));
  const Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
  for (int z = range[2][0]; z < range[2][1]; ++z) {
    for (int y = range[1][0]; y < range[1][1]; ++y) {
      for (int x = range[0][0]; x < range[0][1]; ++x) {
        const Vector3d p = lattice.node(x, y, z);
        if (std::abs(normal.dot(p - corners[0])) > reach) continue;
        const Vector3d closest = closestPointOnTriangle(p, corners);
        if ((p - closest).squaredNorm() <= reach * reach) visit(x, y, z, p, closest);
      }
    }
  }
}

/// The squared distance transform of one row: out[i] = min_j (i - j)^2 + in[j]. Source: P. Felzenszwalb and
/// D. Huttenlocher, "Distance Transforms of Sampled Functions", 2012 (lower envelope of parabolas).
void transformRow(std::vector<double>& row, std::vector<int>& apex, std::vector<double>& from) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const int n = static_cast<int>(row.size());
  apex.clear();
  from.clear();
  for (int i = 0; i < n; ++i) {
    if (row[i] == kInfinity) continue;
    double begin = -kInfinity;
    while (!apex.empty()) {
      const int j = apex.back();
      begin = (row[i] + i * i - row[j] - j * j) / (2.0 * (i - j));
      if (begin > from.back()) break;
      apex.pop_back();
      from.pop_back();
      begin = -kInfinity;
    }
    apex.push_back(i);
    from.push_back(begin);
  }
  if (apex.empty()) return;
  const std::vector<double> in = row;
  std::size_t k = 0;
  for (int i = 0; i < n; ++i) {
    while (k + 1 < apex.size() && from[k + 1] < i) ++k;
    row[i] = (i - apex[k]) * (i - apex[k]) + in[apex[k]];
  }
}

/// Lower bounds of the distance for the nodes beyond the band: the distance to the nearest node that lies next to the
/// surface, less the half diagonal within which every surface point has such a node.
void fillBeyondBand(Lattice<float>& lattice) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const double nextTo = 0.5 * std::sqrt(3.0) * lattice.step;
  std::vector<double> squared(lattice.value.size());
  for (std::size_t i = 0; i < squared.size(); ++i) {
    squared[i] = lattice.value[i] <= 1.001 * nextTo ? 0 : std::numeric_limits<double>::infinity();
  }
  std::vector<double> row, from;
  std::vector<int> apex;
  for (int axis = 0; axis < 3; ++axis) {
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    row.resize(lattice.size[axis]);
    std::array<int, 3> at{};
    for (at[a] = 0; at[a] < lattice.size[a]; ++at[a]) {
      for (at[b] = 0; at[b] < lattice.size[b]; ++at[b]) {
        for (at[axis] = 0; at[axis] < lattice.size[axis]; ++at[axis]) {
          row[at[axis]] = squared[lattice.index(at[0], at[1], at[2])];
        }
        transformRow(row, apex, from);
        for (at[axis] = 0; at[axis] < lattice.size[axis]; ++at[axis]) {
          squared[lattice.index(at[0], at[1], at[2])] = row[at[axis]];
        }
      }
    }
  }
  for (std::size_t i = 0; i < squared.size(); ++i) {
    float& value = lattice.value[i];
    if (value < kInfinity) continue;
    const double bound = std::sqrt(squared[i]) * lattice.step - 1.002 * nextTo;
    value = static_cast<float>(std::max(bound, LinkGrid::kBand));
  }
}

/// Turns distances negative inside: rays along the lattice's rows count windings, the majority of the three axes
/// decides.
void addSigns(const RayScene& scene, Lattice<float>& lattice) {
  std::vector<std::uint8_t> votes(lattice.value.size(), 0);
  std::vector<RayCrossing> crossings;
  for (int axis = 0; axis < 3; ++axis) {
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    std::array<int, 3> at{};
    for (at[a] = 0; at[a] < lattice.size[a]; ++at[a]) {
      for (at[b] = 0; at[b] < lattice.size[b]; ++at[b]) {
        at[axis] = 0;
        const Vector3d start = lattice.node(at[0], at[1], at[2]) - lattice.step * Vector3d::Unit(axis);
        scene.crossings(start, Vector3d::Unit(axis), crossings);
        int winding = 0;
        std::size_t next = 0;
        for (; at[axis] < lattice.size[axis]; ++at[axis]) {
          const double distance = (at[axis] + 1) * static_cast<double>(lattice.step);
          for (; next < crossings.size() && crossings[next].hit.distance < distance; ++next) {
            winding -= crossings[next].sign;
          }
          if (winding > 0) ++votes[lattice.index(at[0], at[1], at[2])];
        }
      }
    }
  }
  for (std::size_t i = 0; i < votes.size(); ++i) {
    if (votes[i] >= 2) lattice.value[i] = -lattice.value[i];
  }
}

/// Per node within reach of the surface its distance, the unit vector g to it from the closest point c, and g.c; +inf
/// and zeros elsewhere.
struct Closest {
  std::vector<float> distance;
  std::array<std::vector<float>, 3> direction;
  std::vector<float> offset;
};

template <class T>
Closest closestTo(const TriangleMesh& mesh, const std::vector<std::uint32_t>& visible, const Lattice<T>& lattice,
                  double reach, const std::atomic<bool>* cancel) {
  const std::size_t nodes = lattice.index(0, 0, lattice.size[2]);
  Closest closest;
  closest.distance.assign(nodes, std::numeric_limits<float>::infinity());
  closest.offset.assign(nodes, 0.0F);
  closest.direction.fill(closest.offset);
  for (const std::uint32_t i : visible) {
    throwIfCancelled(cancel);
    visitNear(lattice, mesh.corners(i), reach, [&](int x, int y, int z, const Vector3d& p, const Vector3d& c) {
      const std::size_t at = lattice.index(x, y, z);
      const double d = (p - c).norm();
      if (!(static_cast<float>(d) < closest.distance[at])) return;
      closest.distance[at] = static_cast<float>(d);
      const Vector3d g = (p - c) / d;
      for (int k = 0; k < 3; ++k) closest.direction[k][at] = static_cast<float>(g[k]);
      closest.offset[at] = static_cast<float>(g.dot(c));
    });
  }
  return closest;
}

/// A tangent plane at each node's closest point, raised above every triangle that comes within the reach of the node;
/// where there is none, one that lies as low as the reach says.
void raisePlanes(const TriangleMesh& mesh, const std::vector<std::uint32_t>& visible, const Closest& closest,
                 Planes& planes) {
  constexpr double kMost = std::numeric_limits<std::int16_t>::max(), kRounding = 1e-6;  // m
  auto& lattice = planes.nodes;
  const double reach = static_cast<double>(planes.reach);
  const auto& [gx, gy, gz] = closest.direction;
  std::vector<float> top = closest.offset;
  for (const std::uint32_t i : visible) {
    const Corners corners = mesh.corners(i);
    const auto range = nodesIn(lattice, boxAround(corners, reach));
    const auto [a, b, c] = corners;
    const Eigen::Vector3f p = a.cast<float>(), q = b.cast<float>(), r = c.cast<float>();
    for (int z = range[2][0]; z < range[2][1]; ++z) {
      for (int y = range[1][0]; y < range[1][1]; ++y) {
        const std::size_t row = lattice.index(0, y, z);
        for (std::size_t at = row + range[0][0]; at < row + range[0][1]; ++at) {
          const float first = gx[at] * p.x() + gy[at] * p.y() + gz[at] * p.z();
          const float second = gx[at] * q.x() + gy[at] * q.y() + gz[at] * q.z();
          const float third = gx[at] * r.x() + gy[at] * r.y() + gz[at] * r.z();
          top[at] = std::max(top[at], std::max(first, std::max(second, third)));
        }
      }
    }
  }
  lattice.value.resize(top.size());
  std::size_t at = 0;
  for (int z = 0; z < lattice.size[2]; ++z) {
    for (int y = 0; y < lattice.size[1]; ++y) {
      for (int x = 0; x < lattice.size[0]; ++x, ++at) {
        const Vector3d g(gx[at], gy[at], gz[at]);
        const bool isFar = closest.distance[at] == std::numeric_limits<float>::infinity();
        const double height = isFar ? reach : g.dot(lattice.node(x, y, z)) - top[at] - kRounding;
        auto& plane = lattice.value[at];
        for (int k = 0; k < 3; ++k) {
          plane[k] = static_cast<std::int16_t>(std::lround(g[k] * static_cast<double>(Planes::kDirectionUnit)));
        }
        const double units = std::clamp(height / static_cast<double>(Planes::kUnit), -kMost, kMost);
        plane[3] = static_cast<std::int16_t>(std::floor(units));
      }
    }
  }
}

std::vector<std::int32_t> nodePairsOf(const Lattice<float>& lattice) {
  constexpr float kMost = std::numeric_limits<std::int16_t>::max();
  const auto units = [&](std::size_t node) {
    const float value = lattice.value[std::min(node, lattice.value.size() - 1)] / LinkGrid::kUnit;
    return static_cast<std::int32_t>(std::floor(std::clamp(value, -kMost, kMost)));
  };
  std::vector<std::int32_t> pairs(lattice.value.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) pairs[i] = units(i + 1) * 0x10000 + (units(i) & 0xFFFF);
  return pairs;
}

/// Does the triangle lie deeper than `kDeep` inside the link, in another of its pieces?
bool isHidden(const RayScene& scene, const Corners& t, const Vector3d& normal) {
  constexpr double kDeep = 3e-4;  // m
  const Vector3d middle = (t[0] + t[1] + t[2]) / 3;
  const std::array<Vector3d, 7> points = {middle,           t[0], t[1], t[2], (t[0] + t[1]) / 2, (t[1] + t[2]) / 2,
                                          (t[2] + t[0]) / 2};
  return std::all_of(points.begin(), points.end(), [&](const Vector3d& p) {
    const Vector3d inward = p + 1e-5 * (middle - p);  // off the corner, which rays can slip through
    return scene.contains(inward + kDeep * normal) && scene.contains(inward + 1e-5 * normal);
  });
}

/// Meets nothing.
const AlignedBox3f kNoBox(Eigen::Vector3f::Constant(std::numeric_limits<float>::max()),
                          Eigen::Vector3f::Constant(std::numeric_limits<float>::lowest()));

/// The boxes around runs of 16.
std::vector<AlignedBox3f> boxesAround(const std::vector<AlignedBox3f>& inner) {
  std::vector<AlignedBox3f> outer;
  for (std::size_t i = 0; i < inner.size(); ++i) {
    if (i % SphereTree::kWidth == 0) outer.push_back(kNoBox);
    outer.back() =
        AlignedBox3f(outer.back().min().cwiseMin(inner[i].min()), outer.back().max().cwiseMax(inner[i].max()));
  }
  return outer;
}

Boxes padded(std::vector<AlignedBox3f> boxes) {
  while (boxes.size() % SphereTree::kWidth != 0) boxes.push_back(kNoBox);
  Boxes result;
  for (const AlignedBox3f& box : boxes) {
    for (int k = 0; k < 3; ++k) {
      result.bound[k].push_back(box.min()[k]);
      result.bound[3 + k].push_back(box.max()[k]);
    }
  }
  return result;
}

double signedVolume(const TriangleMesh& mesh) {
  double volume = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto [a, b, c] = mesh.corners(i);
    volume += a.dot(b.cross(c)) / 6;
  }
  return volume;
}

}  // namespace

LinkGrid::LinkGrid(const TriangleMesh& mesh, const std::atomic<bool>* cancel) {
  const AlignedBox3d box = boundingBox(mesh);
  center = box.center();
  for (const Vector3d& p : mesh.vertices) radius = std::max(radius, (p - center).norm());
  closed = isWatertight(mesh) && signedVolume(mesh) > 0;

  const Vector3d extent = box.sizes() + Vector3d::Constant(2 * kMargin);
  const double step = std::max(kStep, std::cbrt(extent.prod() / static_cast<double>(kMostNodes)));
  // Off the round numbers of drawings, so that no row of nodes runs within a face.
  layOut(distance, box.min() - Vector3d::Constant(kMargin) - step * Vector3d(0.137, 0.291, 0.411), extent, step);
  const RayScene scene(mesh);
  std::vector<std::uint32_t> visible;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    throwIfCancelled(cancel);
    normal.push_back(mesh.normal(i));
    if (!closed || !isHidden(scene, mesh.corners(i), mesh.normal(i))) visible.push_back(static_cast<std::uint32_t>(i));
  }
  const Closest closest = closestTo(mesh, visible, distance, kBand, cancel);
  distance.value = closest.distance;
  planes.reach = static_cast<float>(kBand);
  planes.nodes.origin = distance.origin;
  planes.nodes.step = distance.step;
  planes.nodes.size = distance.size;
  raisePlanes(mesh, visible, closest, planes);
  blockPlanes.reach = kBlockReach;
  layOut(blockPlanes.nodes, box.min() - Vector3d::Constant(kBlockReach),
         box.sizes() + Vector3d::Constant(2 * kBlockReach), std::max(kBlockStep, 4 * step));
  raisePlanes(mesh, visible, closestTo(mesh, visible, blockPlanes.nodes, kBlockReach, cancel), blockPlanes);
  addTriangles(mesh, visible);
  throwIfCancelled(cancel);
  fillBeyondBand(distance);
  throwIfCancelled(cancel);
  addSigns(scene, distance);
  throwIfCancelled(cancel);
  if (!closed) {
    for (float& value : distance.value) value -= static_cast<float>(kOpenShrink * step);
  }
  nodePairs = nodePairsOf(distance);
}

void LinkGrid::addTriangles(const TriangleMesh& mesh, const std::vector<std::uint32_t>& visible) {
  std::vector<Vector3d> place;
  for (const std::uint32_t i : visible) {
    const auto [a, b, c] = mesh.corners(i);
    place.push_back((a + b + c) / 3);
  }
  for (const std::uint32_t i : orderByPlace(place)) source.push_back(visible[i]);
  std::vector<AlignedBox3f> boxes;
  for (std::size_t at = 0; at < source.size(); ++at) {
    const std::uint32_t i = source[at];
    const Corners corners = mesh.corners(i);
    auto& value = triangle.emplace_back().value;
    for (int k = 0; k < 9; ++k) value[k] = static_cast<float>(corners[k / 3][k % 3]);
    for (int k = 0; k < 3; ++k) value[9 + k] = static_cast<float>(normal[i][k]);
    value[12] = static_cast<float>(normal[i].dot(corners[0]));
    const AlignedBox3d box = boxAround(corners, 0);
    boxes.push_back(at < visible.size() ? AlignedBox3f(box.min().cast<float>(), box.max().cast<float>()) : kNoBox);
  }
  triangleBoxes = padded(boxes);
  for (std::size_t at = 0; at < source.size(); ++at) {
    for (int k = 0; k < 6; ++k) triangle[at].value[13 + k] = triangleBoxes.bound[k][at];
  }
  boxes = boxesAround(boxes);
  blockBoxes = padded(boxes);
  superblockBoxes = padded(boxesAround(boxes));
}

double LinkGrid::upperBound(const Vector3d& p) const {
  std::array<int, 3> at{};
  double offNode = 0;
  for (int i = 0; i < 3; ++i) {
    const double u = (p[i] - distance.origin[i]) / distance.step;
    const double nearest = u + 0.5;
    at[i] = static_cast<int>(nearest);
    if (u < 0 || at[i] >= distance.size[i]) return std::numeric_limits<double>::infinity();
    offNode += (u - at[i]) * (u - at[i]);
  }
  return distance.value[distance.index(at[0], at[1], at[2])] + std::sqrt(offNode) * distance.step;
}

double LinkGrid::lowerBound(const Vector3d& p) const {
  std::array<int, 3> at{};
  double outside = 0, offNode = 0;
  const double steps = 1.0 / distance.step;
  for (int i = 0; i < 3; ++i) {
    const double u = (p[i] - distance.origin[i]) * steps;
    const double inside = std::clamp(u, 0.0, static_cast<double>(distance.size[i] - 1));
    const double nearest = inside + 0.5;
    at[i] = static_cast<int>(nearest);
    outside += (u - inside) * (u - inside);
    offNode += (inside - at[i]) * (inside - at[i]);
  }
  const double value = distance.value[distance.index(at[0], at[1], at[2])] - std::sqrt(offNode) * distance.step;
  // Seen from the lattice's boundary everything of the link lies on the other side.
  if (!(outside > 0)) return value;
  const double above = std::max(value, 0.0);
  return std::sqrt(above * above + outside * distance.step * distance.step);
}

}  // namespace handhold
