#include "mesh/repair.h"

#include "core/error.h"
#include "mesh/edges.h"
#include "mesh/object.h"
#include "mesh/ray_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <unordered_map>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Triangle = std::array<std::uint32_t, 3>;

constexpr double kSmallestDiagonal = 0.005;  // m, of an object whose unit nobody wrote
constexpr double kLargestDiagonal = 2.0;     // m
constexpr double kNoVolume = 1e-9;           // of area times diagonal; a sheet of 0.1 m and 1 um is at 3e-6
constexpr double kClearlyInward = 0.05;      // share of an open surface's cones that must point in, net, to turn it
constexpr double kNegative = 1e-12;          // of the cubed diagonal: a volume below minus this is negative
constexpr int kMaxSplitRounds = 100;

std::string plural(std::size_t count, const char* noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

void requireFinite(const TriangleMesh& mesh, const std::string& name) {
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Vector3d& v = mesh.vertices[i];
    if (!v.allFinite()) {
      throw InputError(fmt::format("{}: vertex {} is ({}, {}, {}), want finite numbers", name, i, v.x(), v.y(), v.z()));
    }
  }
}

std::size_t weld(TriangleMesh& mesh) {
  struct Hash {
    std::size_t operator()(const Vector3d& v) const {
      std::size_t hash = 0;
      for (int k = 0; k < 3; ++k) hash = (hash ^ std::hash<double>()(v[k])) * 0x9e3779b97f4a7c15ULL;
      return hash ^ hash >> 32;
    }
  };
  std::unordered_map<Vector3d, std::uint32_t, Hash> first;
  first.reserve(mesh.vertices.size());
  std::vector<Vector3d> kept;
  std::vector<std::uint32_t> moved(mesh.vertices.size());
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const auto [entry, isNew] = first.try_emplace(mesh.vertices[i], static_cast<std::uint32_t>(kept.size()));
    if (isNew) kept.push_back(mesh.vertices[i]);
    moved[i] = entry->second;
  }
  for (auto& t : mesh.triangles) t = {moved[t[0]], moved[t[1]], moved[t[2]]};
  const std::size_t welded = mesh.vertices.size() - kept.size();
  mesh.vertices = std::move(kept);
  return welded;
}

bool repeatsIndex(const Triangle& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; }

/// Coordinates are floats, so differences and products of nearby ones are exact in double: zero means zero.
bool hasArea(const TriangleMesh& mesh, const Triangle& t) {
  if (repeatsIndex(t)) return false;
  const Vector3d& a = mesh.vertices[t[0]];
  return !(mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a).isZero(0);
}

std::size_t dropTriangles(TriangleMesh& mesh, const std::vector<char>& drop) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!drop[i]) mesh.triangles[kept++] = mesh.triangles[i];
  }
  const std::size_t dropped = mesh.triangles.size() - kept;
  mesh.triangles.resize(kept);
  return dropped;
}

/// The corner of a collinear triangle that lies between the other two: opposite the longest edge.
std::size_t middleCorner(const TriangleMesh& mesh, const Triangle& t) {
  std::size_t middle = 0;
  double longest = -1;
  for (std::size_t k = 0; k < 3; ++k) {
    const double length = (mesh.vertices[t[(k + 1) % 3]] - mesh.vertices[t[(k + 2) % 3]]).squaredNorm();
    if (length > longest) {
      longest = length;
      middle = k;
    }
  }
  return middle;
}

/// Splits triangle `t`, which has the edge (x, y) in either direction, at `b` on that edge: `t` keeps the first half.
Triangle splitAt(Triangle& t, std::uint32_t x, std::uint32_t y, std::uint32_t b) {
  std::size_t k = 0;
  while (!((t[k] == x && t[(k + 1) % 3] == y) || (t[k] == y && t[(k + 1) % 3] == x))) ++k;
  const Triangle second = {b, t[(k + 1) % 3], t[(k + 2) % 3]};
  t[(k + 1) % 3] = b;
  return second;
}

/// One round: every flat triangle (three vertices on a line) whose neighbour across the longest edge was not changed
/// in this round gives its middle vertex to it and goes. Returns how many went.
std::size_t splitNeighbours(TriangleMesh& mesh, const std::vector<std::uint32_t>& flat) {
  const auto uses = edgeUses(mesh);
  std::vector<char> drop(mesh.triangles.size(), 0);
  std::vector<char> changed(mesh.triangles.size(), 0);
  std::vector<Triangle> added;
  for (const std::uint32_t i : flat) {
    const Triangle t = mesh.triangles[i];
    if (changed[i]) continue;
    const std::size_t k = middleCorner(mesh, t);
    const std::uint64_t x = t[(k + 1) % 3];
    const std::uint64_t y = t[(k + 2) % 3];
    const std::uint64_t key = std::min(x, y) << 32 | std::max(x, y);
    auto use =
        std::lower_bound(uses.begin(), uses.end(), key, [](const EdgeUse& u, std::uint64_t v) { return u.key < v; });
    while (use != uses.end() && use->key == key && (use->triangle == i || changed[use->triangle])) ++use;
    if (use == uses.end() || use->key != key) continue;
    added.push_back(splitAt(mesh.triangles[use->triangle], t[(k + 1) % 3], t[(k + 2) % 3], t[k]));
    changed[i] = changed[use->triangle] = drop[i] = 1;
  }
  const std::size_t split = dropTriangles(mesh, drop);
  mesh.triangles.insert(mesh.triangles.end(), added.begin(), added.end());
  return split;
}

std::size_t dropDegenerate(TriangleMesh& mesh) {
  std::size_t dropped = 0;
  for (int round = 0;; ++round) {
    std::vector<char> drop(mesh.triangles.size(), 0);
    for (std::size_t i = 0; i < drop.size(); ++i) drop[i] = repeatsIndex(mesh.triangles[i]);
    dropped += dropTriangles(mesh, drop);
    std::vector<std::uint32_t> flat;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (!hasArea(mesh, mesh.triangles[i])) flat.push_back(static_cast<std::uint32_t>(i));
    }
    if (flat.empty()) return dropped;
    const std::size_t split = round < kMaxSplitRounds ? splitNeighbours(mesh, flat) : 0;
    dropped += split;
    if (split > 0) continue;
    // No neighbour can take them: they hang at an open edge.
    drop.assign(mesh.triangles.size(), 0);
    for (const std::uint32_t i : flat) drop[i] = 1;
    return dropped + dropTriangles(mesh, drop);
  }
}

std::size_t dropRepeated(TriangleMesh& mesh) {
  std::vector<std::pair<Triangle, std::size_t>> sorted;
  sorted.reserve(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    Triangle t = mesh.triangles[i];
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    sorted.emplace_back(t, i);
  }
  std::sort(sorted.begin(), sorted.end());
  std::vector<char> drop(mesh.triangles.size(), 0);
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    if (sorted[i].first == sorted[i - 1].first) drop[sorted[i].second] = 1;
  }
  // Two solids that share a face repeat it; without the second one the surface would not be closed any more.
  TriangleMesh rest{mesh.vertices, mesh.triangles};
  const std::size_t dropped = dropTriangles(rest, drop);
  if (dropped == 0 || (isWatertight(mesh) && !isWatertight(rest))) return 0;
  mesh = std::move(rest);
  return dropped;
}

void dropUnusedVertices(TriangleMesh& mesh) {
  std::vector<std::uint32_t> moved(mesh.vertices.size(), 0);
  for (const auto& t : mesh.triangles) {
    for (const auto v : t) moved[v] = 1;
  }
  std::uint32_t kept = 0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    if (moved[i] == 0) continue;
    mesh.vertices[kept] = mesh.vertices[i];
    moved[i] = kept++;
  }
  mesh.vertices.resize(kept);
  for (auto& t : mesh.triangles) t = {moved[t[0]], moved[t[1]], moved[t[2]]};
}

void turn(Triangle& t) { std::swap(t[1], t[2]); }

constexpr std::uint32_t kUnseen = ~0U;

/// Triangles joined through edges that two of them share.
struct Parts {
  std::vector<std::uint32_t> of;  // triangle -> part
  std::size_t count = 0;
  std::size_t turned = 0;          // triangles turned to agree with their neighbours
  std::size_t contradictions = 0;  // edges across which no choice of sides agrees (a Moebius strip has one)
};

struct Neighbour {
  std::uint32_t triangle = 0;
  bool opposed = false;  // both use the edge in the same direction
};

/// The up to three neighbours of each triangle across edges with two uses; entry 3 i + k, `triangle` = i when none.
std::vector<Neighbour> neighbours(const TriangleMesh& mesh) {
  std::vector<Neighbour> result(3 * mesh.triangles.size());
  std::vector<std::uint8_t> filled(mesh.triangles.size(), 0);
  for (std::size_t i = 0; i < result.size(); ++i) result[i].triangle = static_cast<std::uint32_t>(i / 3);
  forEachEdge(edgeUses(mesh), [&](const EdgeUse* begin, const EdgeUse* end) {
    if (end - begin != 2) return;
    const bool opposed = begin[0].direction == begin[1].direction;
    result[3 * std::size_t{begin[0].triangle} + filled[begin[0].triangle]++] = {begin[1].triangle, opposed};
    result[3 * std::size_t{begin[1].triangle} + filled[begin[1].triangle]++] = {begin[0].triangle, opposed};
  });
  return result;
}

/// Flood fill from `seed` over its part. `side` says which triangles must be turned to agree with the seed.
std::vector<std::uint32_t> fillPart(const std::vector<Neighbour>& next, std::uint32_t seed, Parts& parts,
                                    std::vector<char>& side) {
  std::vector<std::uint32_t> members = {seed};
  parts.of[seed] = static_cast<std::uint32_t>(parts.count++);
  for (std::size_t m = 0; m < members.size(); ++m) {
    const std::uint32_t i = members[m];
    for (std::size_t k = 0; k < 3; ++k) {
      const Neighbour& n = next[3 * std::size_t{i} + k];
      if (n.triangle == i) continue;
      const char wanted = static_cast<char>(n.opposed ? !side[i] : side[i]);
      if (parts.of[n.triangle] == kUnseen) {
        parts.of[n.triangle] = parts.of[i];
        side[n.triangle] = wanted;
        members.push_back(n.triangle);
      } else if (i < n.triangle && side[n.triangle] != wanted) {
        ++parts.contradictions;
      }
    }
  }
  return members;
}

/// Finds the parts; within each the smaller side is turned to agree with the larger.
Parts orientParts(TriangleMesh& mesh) {
  const auto next = neighbours(mesh);
  Parts parts;
  parts.of.assign(mesh.triangles.size(), kUnseen);
  std::vector<char> side(mesh.triangles.size(), 0);
  for (std::uint32_t seed = 0; seed < mesh.triangles.size(); ++seed) {
    if (parts.of[seed] != kUnseen) continue;
    const auto members = fillPart(next, seed, parts, side);
    const auto second = static_cast<std::size_t>(
        std::count_if(members.begin(), members.end(), [&](std::uint32_t i) { return side[i] != 0; }));
    const char minority = 2 * second > members.size() ? 0 : 1;
    for (const std::uint32_t i : members) {
      if (side[i] != minority) continue;
      turn(mesh.triangles[i]);
      ++parts.turned;
    }
  }
  return parts;
}

/// Per part: volume (about the middle of the mesh), whether its own oriented boundary is empty, and its outermost
/// triangle along x, which is the likeliest to stick out of whatever surrounds the part.
struct PartShape {
  double volume = 0;
  bool closed = true;
  std::uint32_t outermost = 0;
  double reach = -std::numeric_limits<double>::infinity();
};

std::vector<PartShape> partShapes(const TriangleMesh& mesh, const Parts& parts) {
  std::vector<PartShape> shapes(parts.count);
  const Vector3d middle = boundingBox(mesh).center();
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    PartShape& shape = shapes[parts.of[i]];
    const auto [a, b, c] = mesh.corners(i);
    shape.volume += (a - middle).dot((b - middle).cross(c - middle)) / 6;
    const double reach = (a + b + c).x();
    if (reach > shape.reach) {
      shape.reach = reach;
      shape.outermost = static_cast<std::uint32_t>(i);
    }
  }
  std::vector<std::pair<std::uint32_t, int>> balance;  // part, sum of directions at one edge
  forEachEdge(edgeUses(mesh), [&](const EdgeUse* begin, const EdgeUse* end) {
    balance.clear();
    for (const EdgeUse* use = begin; use != end; ++use) {
      const std::uint32_t part = parts.of[use->triangle];
      auto entry = std::find_if(balance.begin(), balance.end(), [&](const auto& e) { return e.first == part; });
      if (entry == balance.end()) entry = balance.insert(entry, {part, 0});
      entry->second += use->direction;
    }
    for (const auto& [part, sum] : balance) shapes[part].closed = shapes[part].closed && sum == 0;
  });
  return shapes;
}

/// True when the surface without part `part` winds around the middle of `triangle`, one of that part's, by majority of
/// three rays.
bool isEnclosedByOthers(const RayScene& scene, const TriangleMesh& mesh, const Parts& parts, std::uint32_t part,
                        std::uint32_t triangle) {
  const auto [a, b, c] = mesh.corners(triangle);
  const Vector3d point = (a + b + c) / 3;
  std::vector<RayCrossing> met;
  int votes = 0;
  for (const Vector3d& direction :
       {Vector3d(0.61, 0.43, 0.37), Vector3d(0.52, -0.71, 0.29), Vector3d(0.33, 0.19, -0.83)}) {
    scene.crossings(point, direction.normalized(), met);
    int winding = 0;
    for (const auto& crossing : met) {
      const std::uint32_t other = parts.of[crossing.hit.triangle];
      if (other != part) winding += crossing.sign;
    }
    votes += winding != 0 ? 1 : 0;
  }
  return votes >= 2;
}

/// Turns closed parts that are inside out. A part with negative volume within another is a cavity and stays.
std::size_t turnClosedParts(TriangleMesh& mesh, const Parts& parts, const std::vector<PartShape>& shapes) {
  std::vector<char> wrong(parts.count, 0);
  std::unique_ptr<RayScene> scene;
  const double diagonal = boundingBox(mesh).diagonal().norm();
  for (std::uint32_t part = 0; part < parts.count; ++part) {
    if (!shapes[part].closed || shapes[part].volume > -kNegative * std::pow(diagonal, 3)) continue;
    if (parts.count > 1 && !scene) scene = std::make_unique<RayScene>(mesh);
    wrong[part] = parts.count == 1 || !isEnclosedByOthers(*scene, mesh, parts, part, shapes[part].outermost);
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (wrong[parts.of[i]]) turn(mesh.triangles[i]);
  }
  return static_cast<std::size_t>(std::count(wrong.begin(), wrong.end(), 1));
}

/// Net share, in [-1, 1], of the cones from the centroid over the open parts that face away from the centroid.
double outwardShare(const TriangleMesh& mesh, const Parts& parts, const std::vector<PartShape>& shapes) {
  const Vector3d centroid = massProperties(mesh, false).centerOfMass;
  double net = 0;
  double all = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (shapes[parts.of[i]].closed) continue;
    const auto [a, b, c] = mesh.corners(i);
    const double cone = (a - centroid).dot((b - centroid).cross(c - centroid));
    net += cone;
    all += std::abs(cone);
  }
  return all > 0 ? net / all : 0;
}

/// Makes neighbours agree, and says so.
Parts agree(ObjectModel& object) {
  Parts parts = orientParts(object.mesh);
  if (parts.turned > 0) {
    object.notes.push_back(fmt::format("{} turned to agree with the neighbours", plural(parts.turned, "triangle")));
  }
  if (parts.contradictions > 0) {
    object.warnings.push_back(
        fmt::format("not orientable: {} between triangles that face opposite ways; near them "
                    "inside and outside are guesses",
                    plural(parts.contradictions, "edge")));
  }
  return parts;
}

/// The orientation rule of the README.
void orient(ObjectModel& object) {
  TriangleMesh& mesh = object.mesh;
  const Parts parts = agree(object);
  auto shapes = partShapes(mesh, parts);
  double closedVolume = 0;
  for (const auto& shape : shapes) closedVolume += shape.closed ? shape.volume : 0;
  if (closedVolume < -kNegative * std::pow(boundingBox(mesh).diagonal().norm(), 3)) {
    for (auto& t : mesh.triangles) turn(t);
    for (auto& shape : shapes) shape.volume = -shape.volume;
    object.notes.emplace_back("all triangles turned: the mesh was inside out");
  }
  if (const std::size_t turned = turnClosedParts(mesh, parts, shapes); turned > 0) {
    object.notes.push_back(fmt::format("{} of {} turned: inside out", turned, plural(parts.count, "part")));
  }
  if (outwardShare(mesh, parts, shapes) < -kClearlyInward) {
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (!shapes[parts.of[i]].closed) turn(mesh.triangles[i]);
    }
    object.notes.emplace_back("open surface turned: its normals pointed mostly inward");
  }
}

/// Units that would bring the diagonal into the plausible range, as a clause.
std::string fittingUnits(double diagonal) {
  std::string text;
  for (const auto& [unit, scale] : {std::pair{"mm", 0.001}, {"cm", 0.01}, {"in", 0.0254}}) {
    const double size = diagonal * scale;
    if (size < kSmallestDiagonal || size > kLargestDiagonal) continue;
    text += fmt::format("{}`unit: {}` would make it {:.3g} m", text.empty() ? "" : ", ", unit, size);
  }
  return text.empty() ? "no common unit fits: write `scale:`" : text;
}

void requirePlausibleSize(ObjectModel& object, const MeshUnit& unit, const std::string& name) {
  const double diagonal = boundingBox(object.mesh).diagonal().norm();
  if (diagonal >= kSmallestDiagonal && diagonal <= kLargestDiagonal) return;
  if (!unit.written) {
    throw InputError(
        fmt::format("{}: the diagonal is {:.3g} m when no unit is written, want {} to {} m or a `unit:`; {}", name,
                    diagonal, kSmallestDiagonal, kLargestDiagonal, fittingUnits(diagonal / unit.scale)));
  }
  object.warnings.push_back(fmt::format("the diagonal is {:.3g} m with the unit \"{}\"", diagonal, unit.text));
}

void noteCleaning(const CleanCounts& counts, ObjectModel& object) {
  if (counts.welded > 0) {
    object.notes.push_back(fmt::format("{} welded", plural(counts.welded, "repeated position")));
  }
  if (counts.degenerate > 0) {
    object.notes.push_back(fmt::format("{} without area dropped", plural(counts.degenerate, "triangle")));
  }
  if (counts.repeated > 0) {
    object.notes.push_back(fmt::format("{} dropped", plural(counts.repeated, "repeated triangle")));
  }
}

void measure(ObjectModel& object, const std::string& name) {
  const EdgeCounts edges = countEdges(edgeUses(object.mesh));
  object.watertight = edges.unbalanced == 0;
  object.mass = massProperties(object.mesh, object.watertight);
  const double diagonal = boundingBox(object.mesh).diagonal().norm();
  if (object.watertight && !(object.mass.volume > kNoVolume * object.mass.area * diagonal)) {
    throw InputError(fmt::format("{}: is closed but encloses no volume ({:.3g} m^3), want a solid or one side of it",
                                 name, object.mass.volume));
  }
  if (!object.watertight) {
    object.warnings.push_back(
        fmt::format("open: {}; no volume, centre of mass and inertia are those of the surface, "
                    "inside is decided by the majority of three rays",
                    plural(edges.unbalanced, "open edge")));
  }
}

}  // namespace

void requireSound(const TriangleMesh& mesh, const std::string& name) {
  if (mesh.triangles.empty()) throw InputError(fmt::format("{}: has no triangles", name));
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (const auto index : mesh.triangles[i]) {
      if (index < mesh.vertices.size()) continue;
      throw InputError(
          fmt::format("{}: triangle {} uses vertex {}, want below {}", name, i, index, mesh.vertices.size()));
    }
  }
  requireFinite(mesh, name);
}

CleanCounts cleanMesh(TriangleMesh& mesh, const std::string& name) {
  roundToFloat(mesh);
  requireFinite(mesh, name);
  CleanCounts counts;
  counts.welded = weld(mesh);
  counts.degenerate = dropDegenerate(mesh);
  counts.repeated = dropRepeated(mesh);
  dropUnusedVertices(mesh);
  if (mesh.triangles.empty()) throw InputError(fmt::format("{}: has no triangle with an area", name));
  return counts;
}

ObjectModel repairObject(TriangleMesh mesh, const MeshUnit& unit, const std::string& name) {
  requireSound(mesh, name);
  if (!(unit.scale > 0) || !std::isfinite(unit.scale)) {
    throw InputError(fmt::format("{}: the scale is {}, want a positive number", name, unit.scale));
  }
  ObjectModel object;
  object.mesh = std::move(mesh);
  for (auto& vertex : object.mesh.vertices) vertex *= unit.scale;
  noteCleaning(cleanMesh(object.mesh, name), object);
  requirePlausibleSize(object, unit, name);
  const EdgeCounts edges = countEdges(edgeUses(object.mesh));
  if (2 * edges.shared < edges.all) {
    throw InputError(
        fmt::format("{}: is a soup of unconnected triangles: {} of {} edges are shared by two of them, want half", name,
                    edges.shared, edges.all));
  }
  orient(object);
  measure(object, name);
  return object;
}

}  // namespace handhold
