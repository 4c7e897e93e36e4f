#include "simulate/object_shell.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Corners = std::array<Vector3d, 3>;

constexpr int kWidth = SphereTree::kWidth;

struct SmallTriangle {
  Corners corners;
  std::uint32_t source;
};

double longestEdgeOf(const Corners& t) {
  return std::max({(t[1] - t[0]).norm(), (t[2] - t[1]).norm(), (t[0] - t[2]).norm()});
}

/// Halves the longest edge until none is longer than `longest`.
void split(const Corners& t, double longest, std::uint32_t source, std::vector<SmallTriangle>& result) {
  if (longestEdgeOf(t) <= longest) {
    result.push_back({t, source});
    return;
  }
  int edge = 0;
  for (int i = 1; i < 3; ++i) {
    if ((t[(i + 1) % 3] - t[i]).norm() > (t[(edge + 1) % 3] - t[edge]).norm()) edge = i;
  }
  const Vector3d& a = t[edge];
  const Vector3d& b = t[(edge + 1) % 3];
  const Vector3d& c = t[(edge + 2) % 3];
  const Vector3d middle = 0.5 * (a + b);  // the same from both sides of the edge
  split({a, middle, c}, longest, source, result);
  split({middle, b, c}, longest, source, result);
}

/// About how many pieces `split` makes.
double expectedPieces(const TriangleMesh& mesh, double longest) {
  double pieces = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Corners t = mesh.corners(i);
    const double edge = longestEdgeOf(t);
    const double area = 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).norm();
    pieces += 1 + 3 * area / (longest * longest) + 2 * edge / longest * (edge > longest ? 1 : 0);
  }
  return pieces;
}

/// Points along the edges that stick out by more than some 15 degrees, and along boundaries: what a hand grazes first.
void addSharpEdges(const TriangleMesh& mesh, const std::vector<Vector3d>& normal, const Vector3d& center,
                   std::vector<std::array<double, 3>>& points) {
  constexpr double kFlat = 0.966;  // cosine
  struct Edge {
    std::uint32_t low, high, triangle, opposite;
  };
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto& t = mesh.triangles[i];
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), static_cast<std::uint32_t>(i), t[(k + 2) % 3]});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.low, a.high, a.triangle) < std::tie(b.low, b.high, b.triangle);
  });
  for (std::size_t i = 0, next = 0; i < edges.size(); i = next) {
    for (next = i; next < edges.size() && edges[next].low == edges[i].low && edges[next].high == edges[i].high;) ++next;
    const Vector3d& a = mesh.vertices[edges[i].low];
    const Vector3d& b = mesh.vertices[edges[i].high];
    if (next - i == 2) {
      const Vector3d& n = normal[edges[i].triangle];
      const bool sticksOut = n.dot(mesh.vertices[edges[i + 1].opposite] - a) < 0;
      if (!sticksOut || n.dot(normal[edges[i + 1].triangle]) > kFlat) continue;
    }
    const int pieces = static_cast<int>(std::ceil((b - a).norm() / ObjectShell::kSharpEdgeStep));
    for (int k = 1; k < pieces; ++k) {
      const Vector3d p = a + static_cast<double>(k) / pieces * (b - a) - center;
      points.push_back({p.x(), p.y(), p.z()});
    }
  }
}

using Indices = std::vector<std::uint32_t>::iterator;

/// Orders the indices so that those before `middle` lie before the others along the longest side of their box.
void part(const std::vector<Vector3d>& place, const Eigen::AlignedBox3d& box, Indices begin, Indices middle,
          Indices end) {
  int axis = 0;
  box.sizes().maxCoeff(&axis);
  std::nth_element(begin, middle, end, [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(place[a][axis], a) < std::pair(place[b][axis], b);
  });
}

/// Halves across the longest side of the box, cut at multiples of 256, then of 16.
void orderByPlace(const std::vector<Vector3d>& place, Indices begin, Indices end) {
  const auto count = static_cast<std::size_t>(end - begin);
  if (count <= kWidth) return;
  Eigen::AlignedBox3d box;
  for (auto i = begin; i != end; ++i) box.extend(place[*i]);
  const std::size_t unit = count > kWidth * kWidth ? kWidth * kWidth : kWidth;
  const auto middle = begin + static_cast<std::ptrdiff_t>((count / 2 + unit - 1) / unit * unit);
  part(place, box, begin, middle, end);
  orderByPlace(place, begin, middle);
  orderByPlace(place, middle, end);
}

/// The spheres around runs of 16 of `inner`.
void addSpheresAround(const SphereTree::Spheres& inner, std::size_t count, SphereTree::Spheres& outer) {
  for (std::size_t begin = 0; begin < count; begin += kWidth) {
    const std::size_t end = std::min(begin + kWidth, count);
    Eigen::AlignedBox3d box;
    for (std::size_t i = begin; i < end; ++i) {
      const Vector3d c(inner.x[i], inner.y[i], inner.z[i]);
      box.extend(Vector3d(c.array() - inner.radius[i])).extend(Vector3d(c.array() + inner.radius[i]));
    }
    const Vector3d center = box.center().cast<float>().cast<double>();
    double radius = 0;
    for (std::size_t i = begin; i < end; ++i) {
      radius = std::max(radius, (Vector3d(inner.x[i], inner.y[i], inner.z[i]) - center).norm() + inner.radius[i]);
    }
    outer.add(center, 1.00001 * radius + 1e-7);
  }
}

constexpr float kNowhere = 1e6;  // m

void pad(SphereTree::Spheres& spheres) {
  while (spheres.size() % kWidth != 0) spheres.add(Vector3d::Constant(kNowhere), 0);
}

SphereTree makeTree(const SphereTree::Spheres& spheres) {
  SphereTree tree;
  addSpheresAround(spheres, spheres.size(), tree.blocks);
  const std::size_t count = tree.blocks.size();
  addSpheresAround(tree.blocks, count, tree.superblocks);
  pad(tree.blocks);
  pad(tree.superblocks);
  return tree;
}

/// Adds the points as blocks of 16 in balls of kBlockRadius, as few as halving across the longest side takes.
void addBlocks(const std::vector<Vector3d>& place, Indices begin, Indices end, std::vector<std::uint32_t>& order) {
  constexpr double kRounding = 1e-6;  // m
  Eigen::AlignedBox3d box;
  for (auto i = begin; i != end; ++i) box.extend(place[*i]);
  const auto isWithin = [&](std::uint32_t i) {
    return (place[i] - box.center()).norm() <= ObjectShell::kBlockRadius - kRounding;
  };
  if (std::all_of(begin, end, isWithin)) {
    order.insert(order.end(), begin, end);
    while (order.size() % kWidth != 0) order.push_back(order.back());
    return;
  }
  const auto middle = begin + (end - begin) / 2;
  part(place, box, begin, middle, end);
  addBlocks(place, begin, middle, order);
  addBlocks(place, middle, end, order);
}

/// The smallest sphere around a triangle: about the middle of the longest edge where the triangle is obtuse, else the
/// circumscribed one.
std::pair<Vector3d, double> boundingSphere(const Corners& t) {
  for (int i = 0; i < 3; ++i) {
    const Vector3d& a = t[i];
    const Vector3d& b = t[(i + 1) % 3];
    const Vector3d& c = t[(i + 2) % 3];
    if ((a - c).dot(b - c) <= 0) return {0.5 * (a + b), 0.5 * (a - b).norm()};
  }
  const Vector3d u = t[1] - t[0], v = t[2] - t[0], n = u.cross(v);
  const Vector3d toCenter = (v.squaredNorm() * n.cross(u) + u.squaredNorm() * v.cross(n)) / (2 * n.squaredNorm());
  return {t[0] + toCenter, toCenter.norm()};
}

}  // namespace

std::vector<std::uint32_t> orderByPlace(const std::vector<Vector3d>& place) {
  std::vector<std::uint32_t> order(place.size());
  std::iota(order.begin(), order.end(), 0U);
  orderByPlace(place, order.begin(), order.end());
  const std::size_t full = (order.size() + kWidth - 1) / kWidth * kWidth;
  const std::uint32_t last = order.back();
  order.resize(full, last);  // repeated, so that blocks are full
  return order;
}

void SphereTree::Spheres::add(const Vector3d& center, double r) {
  x.push_back(static_cast<float>(center.x()));
  y.push_back(static_cast<float>(center.y()));
  z.push_back(static_cast<float>(center.z()));
  radius.push_back(static_cast<float>(r));
}

SphereTree coverSurface(const TriangleMesh& mesh) {
  constexpr double kLongest = 3e-3;  // m
  std::vector<SmallTriangle> pieces;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) split(mesh.corners(i), kLongest, 0, pieces);
  std::vector<Vector3d> place;
  place.reserve(pieces.size());
  for (const SmallTriangle& piece : pieces) {
    place.push_back((piece.corners[0] + piece.corners[1] + piece.corners[2]) / 3);
  }
  SphereTree::Spheres spheres;
  for (const std::uint32_t i : orderByPlace(place)) {
    const auto [center, radius] = boundingSphere(pieces[i].corners);
    spheres.add(center, 1.00001 * radius + 1e-7);
  }
  return makeTree(spheres);
}

ObjectShell::ObjectShell(const ObjectModel& object) : closed(object.watertight) {
  const TriangleMesh& mesh = object.mesh;
  center = boundingBox(mesh).center();
  while (expectedPieces(mesh, longestEdge) > kMostTriangles && longestEdge < 1) longestEdge *= 1.25;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Corners corners = mesh.corners(i);
    Record& record = sourceTriangle.emplace_back();
    for (int k = 0; k < 9; ++k) record.value[k] = static_cast<float>((corners[k / 3] - center)[k % 3]);
    sourceNormal.push_back(mesh.normal(i));
  }
  std::vector<SmallTriangle> pieces;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    split(mesh.corners(i), longestEdge, static_cast<std::uint32_t>(i), pieces);
  }
  std::vector<Vector3d> place;
  for (SmallTriangle& piece : pieces) {
    for (Vector3d& p : piece.corners) p -= center;
    place.push_back((piece.corners[0] + piece.corners[1] + piece.corners[2]) / 3);
  }
  SphereTree::Spheres spheres;
  for (const std::uint32_t i : orderByPlace(place)) {
    const SmallTriangle& piece = pieces[i];
    Record& record = triangle.emplace_back();
    for (int k = 0; k < 9; ++k) record.value[k] = static_cast<float>(piece.corners[k / 3][k % 3]);
    for (int k = 0; k < 3; ++k) record.value[9 + k] = static_cast<float>(sourceNormal[piece.source][k]);
    const auto [c, r] = boundingSphere(piece.corners);
    const double rounded = 1.00001 * r + 1e-7;
    for (int k = 0; k < 3; ++k) record.value[12 + k] = static_cast<float>(c[k]);
    record.value[15] = static_cast<float>(rounded);
    for (int k = 0; k < 4; ++k) sphere[k].push_back(record.value[12 + k]);
    spheres.add(c, rounded);
    source.push_back(piece.source);
  }
  triangleTree = makeTree(spheres);
  for (std::size_t block = 0; block < triangleTree.blocks.size(); ++block) {
    Eigen::AlignedBox3f box;
    for (std::size_t i = kWidth * block; i < std::min(triangle.size(), kWidth * (block + 1)); ++i) {
      for (int k = 0; k < 9; k += 3) box.extend(Eigen::Map<const Eigen::Vector3f>(&triangle[i].value[k]));
    }
    if (box.isEmpty()) box = Eigen::AlignedBox3f(Eigen::Vector3f::Constant(kNowhere));
    for (int k = 0; k < 3; ++k) {
      triangleBox[k].push_back(box.center()[k]);
      triangleBox[3 + k].push_back(0.5F * box.sizes()[k] * 1.00001F + 1e-7F);
    }
  }

  std::vector<std::array<double, 3>> corners;
  for (const SmallTriangle& piece : pieces) {
    for (const Vector3d& p : piece.corners) corners.push_back({p.x(), p.y(), p.z()});
  }
  addSharpEdges(mesh, sourceNormal, center, corners);
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  place.clear();
  for (const auto& p : corners) {
    place.emplace_back(p[0], p[1], p[2]);
    radius = std::max(radius, place.back().norm());
  }
  std::vector<std::uint32_t> neighbours = orderByPlace(place), order;
  for (auto begin = neighbours.begin(); begin != neighbours.end(); begin += kWidth) {
    addBlocks(place, begin, begin + kWidth, order);
  }
  SphereTree::Spheres points;
  for (const std::uint32_t i : order) {
    for (int k = 0; k < 3; ++k) point[k].push_back(static_cast<float>(place[i][k]));
    points.add(place[i], 0);
  }
  pointTree = makeTree(points);
}

}  // namespace handhold
