#include "physics/solid.h"

#include "mesh/ray_scene.h"
#include "scene/surface_distance.h"

#include <array>
#include <cassert>
#include <limits>
#include <numeric>
#include <unordered_set>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr std::uint32_t kLeafPoints = 8;
constexpr double kHidden = 2e-4;  // m inside: a point of an inner face
constexpr double kLinkSpacing = 7.5e-4, kLinkPitch = 2.5e-3;
constexpr double kObjectSpacing = 1e-3, kThinSpacing = 5e-4, kThinWall = 2e-3, kObjectPitch = 2e-3;
constexpr double kNear = 2.5e-3;                  // m: points that a finder remembers
constexpr double kSteepest = 1.7320508075688772;  // of an interpolated distance: along the diagonal of a cell
constexpr double kTurnLength = 0.02;              // m: a turn of a normal by one radian counts as much
constexpr double kLeastApart = 0.004;             // m, of two contacts, turns counted like this

/// One point a cube of the pitch.
class Cubes {
 public:
  explicit Cubes(double side) : side_(side) {}
  bool take(const Vector3d& p) {
    std::uint64_t key = 0;
    for (const double x : p) key = key << 21 | (static_cast<std::uint64_t>(std::floor(x / side_)) & 0x1fffff);
    return taken_.insert(key).second;
  }

 private:
  double side_;
  std::unordered_set<std::uint64_t> taken_;
};

/// Of every vertex the mean of its triangles' normals, weighted by their angles there.
std::vector<Vector3d> vertexNormals(const TriangleMesh& mesh) {
  std::vector<Vector3d> normals(mesh.vertices.size(), Vector3d::Zero());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const std::array<Vector3d, 3> t = mesh.corners(i);
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3d u = t[(k + 1) % 3] - t[k], v = t[(k + 2) % 3] - t[k];
      normals[mesh.triangles[i][k]] += std::atan2(u.cross(v).norm(), u.dot(v)) * mesh.normal(i);
    }
  }
  return normals;
}

/// Points of a triangle on a grid of barycentric coordinates no coarser than the pitch: visit(their weights of the
/// three corners, on how many sides they lie).
template <class Visit>
void visitTriangle(const std::array<Vector3d, 3>& t, double pitch, const Visit& visit) {
  const double longest = std::max({(t[1] - t[0]).norm(), (t[2] - t[1]).norm(), (t[0] - t[2]).norm()});
  const int steps = std::max(1, static_cast<int>(std::ceil(longest / pitch)));
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; j <= steps - i; ++j) {
      const int sides = (i == 0) + (j == 0) + (i + j == steps);
      const double a = static_cast<double>(i) / steps, b = static_cast<double>(j) / steps;
      visit(Vector3d(1 - a - b, a, b), sides);
    }
  }
}

/// The thickness that a tenth of the walls fall below [m].
double thinWall(const TriangleMesh& mesh) {
  const RayScene rays(mesh);
  std::vector<double> thickness;
  const std::size_t step = std::max<std::size_t>(1, mesh.triangles.size() / 1000);
  for (std::size_t i = 0; i < mesh.triangles.size(); i += step) {
    const auto [a, b, c] = mesh.corners(i);
    const Vector3d inward = -mesh.normal(i);
    const RayHit hit = rays.cast((a + b + c) / 3 + 1e-5 * inward, inward);
    if (!hit.missed()) thickness.push_back(hit.distance);
  }
  if (thickness.empty()) return std::numeric_limits<double>::infinity();
  const auto tenth = thickness.begin() + static_cast<std::ptrdiff_t>(thickness.size() / 10);
  std::nth_element(thickness.begin(), tenth, thickness.end());
  return *tenth;
}

}  // namespace

SurfacePoints::SurfacePoints(const TriangleMesh& mesh, const DistanceField& field, double pitch) {
  Cubes cubes(pitch);
  const std::vector<Vector3d> normals = vertexNormals(mesh);
  // Corners first, then edges: a face's points must not take their cubes. On an edge the normal is that between the
  // faces, so that either is less than 60 degrees from it.
  for (const int wanted : {2, 1, 0}) {
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const std::array<Vector3d, 3> t = mesh.corners(i);
      const auto& vertex = mesh.triangles[i];
      visitTriangle(t, pitch, [&](const Vector3d& w, int sides) {
        if (std::min(sides, 2) != wanted) return;
        const Vector3d p = w[0] * t[0] + w[1] * t[1] + w[2] * t[2];
        if (field(p) <= -kHidden || !cubes.take(p)) return;
        Vector3d normal = mesh.normal(i);
        if (sides > 0) {
          const Vector3d mean = w[0] * normals[vertex[0]] + w[1] * normals[vertex[1]] + w[2] * normals[vertex[2]];
          if (mean.norm() > 1e-6) normal = mean.normalized();
        }
        points_.push_back({p, normal});
      });
    }
  }
  if (!points_.empty()) addBall(0, static_cast<std::uint32_t>(points_.size()));
}

void SurfacePoints::addBall(std::uint32_t begin, std::uint32_t end) {
  Eigen::AlignedBox3d box;
  for (std::uint32_t i = begin; i < end; ++i) box.extend(points_[i].position);
  Ball ball{box.center(), 0, begin, end, 0};
  for (std::uint32_t i = begin; i < end; ++i)
    ball.radius = std::max(ball.radius, (points_[i].position - ball.center).norm());
  const std::size_t index = balls_.size();
  balls_.push_back(ball);
  if (end - begin <= kLeafPoints) return;
  Eigen::Index axis = 0;
  box.sizes().maxCoeff(&axis);
  const std::uint32_t middle = begin + (end - begin) / 2;
  std::stable_sort(points_.begin() + begin, points_.begin() + end,
                   [axis](const Point& a, const Point& b) { return a.position[axis] < b.position[axis]; });
  addBall(begin, middle);
  balls_[index].second = static_cast<std::uint32_t>(balls_.size());
  addBall(middle, end);
}

SurfaceError surfaceError(const Solid& solid) {
  std::vector<double> errors;
  for (const SurfacePoints::Point& point : solid.points.points()) {
    errors.push_back(std::abs(solid.field(point.position)));
  }
  std::sort(errors.begin(), errors.end());
  if (errors.empty()) return {};
  return {errors[errors.size() * 95 / 100], errors.back()};
}

Solid objectSolid(const TriangleMesh& mesh) {
  return Solid(mesh, thinWall(mesh) < kThinWall ? kThinSpacing : kObjectSpacing, kObjectPitch);
}

Solid linkSolid(const TriangleMesh& mesh) { return Solid(mesh, kLinkSpacing, kLinkPitch); }

/// The points, moved by X_FP, less than `reach` from the field's surface, in the order of the tree.
/// @return  how far the points may come nearer before another must be looked at [m]
double TouchFinder::collect(const SurfacePoints& points, const DistanceField& field, const Isometry3d& X_FP,
                            double reach, std::vector<Close>& close) {
  close.clear();
  if (points.balls().empty()) return std::numeric_limits<double>::infinity();
  const SurfacePoints::Ball& all = points.balls()[0];
  const double gap = field(X_FP * all.center) - all.radius;
  if (gap > reach) return gap;
  // Interpolation across a sharp edge is off by less than half a cell.
  const double ballReach = reach + field.spacing() / 2;
  std::array<std::uint32_t, 64> stack;
  std::size_t size = 0;
  stack[size++] = 0;
  while (size > 0) {
    const std::uint32_t index = stack[--size];
    const SurfacePoints::Ball& ball = points.balls()[index];
    if (field(X_FP * ball.center) > ball.radius + ballReach) continue;
    if (ball.second == 0) {
      for (std::uint32_t i = ball.begin; i < ball.end; ++i) {
        const SurfacePoints::Point& point = points.points()[i];
        const double distance = field(X_FP * point.position);
        if (distance < reach) close.push_back({point, distance});
      }
    } else {
      stack[size++] = ball.second;
      stack[size++] = index + 1;
    }
  }
  return reach;
}

void TouchFinder::find(const Solid& a, const Solid& b, const Isometry3d& X_AB, double margin,
                       std::vector<Touch>& touches) {
  const Vector3d center = b.box.center();
  const double turn = Eigen::AngleAxisd(X_AB.linear().transpose() * X_AB_.linear()).angle();
  double motion = (X_AB * center - X_AB_ * center).norm() + turn * b.box.sizes().norm() / 2;
  const Isometry3d X_BA = X_AB.inverse();
  if (!(motion <= allowedMotion_)) {
    const double reach = margin + kNear;
    const double free = std::min(collect(b.points, a.field, X_AB, reach, closeOfB_),
                                 collect(a.points, b.field, X_BA, reach, closeOfA_));
    X_AB_ = X_AB;
    allowedMotion_ = (free - margin) / kSteepest;
    motion = 0;
  }
  const double tooFar = margin + kSteepest * motion;  // was then what is not below the margin now
  touches.clear();
  for (const Close& close : closeOfB_) {
    if (close.distance >= tooFar) continue;
    const Vector3d p = X_AB * close.point.position;
    const FieldValue field = a.field.below(p, margin);
    if (field.isBelow) touches.push_back({p - field.distance / 2 * field.direction, field.direction, field.distance});
  }
  for (const Close& close : closeOfA_) {
    if (close.distance >= tooFar) continue;
    const SurfacePoints::Point& point = close.point;
    const FieldValue field = b.field.below(X_BA * point.position, margin);
    if (!field.isBelow) continue;
    Vector3d normal = X_AB.linear() * -field.direction;
    if (normal.dot(point.normal) < 0.5) normal = point.normal;
    touches.push_back({point.position + field.distance / 2 * normal, normal, field.distance});
  }
}

void keepSpread(std::vector<Touch>& touches, std::size_t count) {
  if (touches.size() <= 1) return;
  double deepest = std::numeric_limits<double>::infinity();
  for (const Touch& touch : touches) deepest = std::min(deepest, touch.distance);
  thread_local std::vector<double> apart;  // squared, from those kept
  apart.assign(touches.size(), std::numeric_limits<double>::infinity());
  for (std::size_t kept = 0; kept < std::min(count, touches.size()); ++kept) {
    std::size_t best = kept;
    double most = -1;
    for (std::size_t i = kept; i < touches.size(); ++i) {
      // Half as deep counts half; of the first, depth alone decides.
      const double depth = deepest < 0 ? std::max(touches[i].distance / deepest, 0.05) : 1;
      const double score = kept == 0 ? -touches[i].distance + 1 : depth * depth * apart[i];
      if (score > most) most = score, best = i;
    }
    if (kept > 0 && apart[best] < kLeastApart * kLeastApart) {
      touches.resize(kept);
      return;
    }
    std::swap(touches[kept], touches[best]);
    std::swap(apart[kept], apart[best]);
    for (std::size_t i = kept + 1; i < touches.size(); ++i) {
      const Touch &a = touches[kept], &b = touches[i];
      const double squared =
          (a.position - b.position).squaredNorm() + kTurnLength * kTurnLength * (a.normal - b.normal).squaredNorm();
      apart[i] = std::min(apart[i], squared);
    }
  }
  if (touches.size() > count) touches.resize(count);
}

}  // namespace handhold
