#include "mesh/primitives.h"
#include "mesh/ray_scene.h"
#include "scene/point_cloud.h"
#include "scene/scene.h"
#include "scene/surface_distance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kObstacleChordError = 5e-4;  // m
// Rounding to 32-bit floats moves a vertex by 6e-8 of its distance; the polyhedron shall enclose the solid all the
// same.
constexpr double kRoundingRoom = 1 + 1e-6;

std::shared_ptr<const ObstacleShape> makeShape(decltype(ObstacleShape::kind) kind, TriangleMesh mesh) {
  ObstacleShape shape;
  shape.kind = std::move(kind);
  shape.mesh = std::move(mesh);
  roundToFloat(shape.mesh);
  shape.piecePoints = pieceVertices(shape.mesh);
  shape.watertight = isWatertight(shape.mesh);
  return std::make_shared<const ObstacleShape>(std::move(shape));
}

/// Largest ball about the origin in a convex polyhedron that contains it [m].
double inscribedRadius(const TriangleMesh& mesh) {
  double radius = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    radius = std::min(radius, mesh.normal(i).dot(mesh.corners(i)[0]));
  }
  return radius;
}

/// Grows a polyhedron with vertices on a sphere about the origin until it encloses the sphere.
TriangleMesh around(TriangleMesh mesh, double radius) {
  const double factor = radius / inscribedRadius(mesh) * kRoundingRoom;
  for (Vector3d& vertex : mesh.vertices) vertex *= factor;
  return mesh;
}

/// An icosahedron whose inscribed sphere has radius 1.
TriangleMesh unitIcosahedron() {
  const double g = (1 + std::sqrt(5.0)) / 2;
  TriangleMesh mesh;
  mesh.vertices = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  mesh.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                    {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                    {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  return around(std::move(mesh), 1);
}

/// Balls of `radius` about `points`, which are taken as they are.
std::shared_ptr<const ObstacleShape> makeBallsShape(std::vector<Vector3d> points, double radius) {
  static const TriangleMesh ball = unitIcosahedron();
  ObstacleShape shape;
  shape.mesh.vertices.reserve(points.size() * ball.vertices.size());
  shape.mesh.triangles.reserve(points.size() * ball.triangles.size());
  for (const Vector3d& point : points) {
    const auto first = static_cast<std::uint32_t>(shape.mesh.vertices.size());
    for (const Vector3d& vertex : ball.vertices) shape.mesh.vertices.push_back(point + radius * vertex);
    for (const auto& t : ball.triangles) shape.mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  roundToFloat(shape.mesh);
  shape.piecePoints = points;
  shape.watertight = true;
  shape.kind = ObstacleShape::Points{std::move(points), radius};
  return std::make_shared<const ObstacleShape>(std::move(shape));
}

/// From the centre of a ball of radius 1 to the corners of its polyhedron.
double ballReach() {
  static const double reach = unitIcosahedron().vertices[0].norm();
  return reach;
}

}  // namespace

std::shared_ptr<const ObstacleShape> makeBoxShape(const Vector3d& size) {
  return makeShape(ObstacleShape::Box{size}, boxMesh(size));
}

std::shared_ptr<const ObstacleShape> makeCylinderShape(double radius, double length) {
  TriangleMesh mesh = cylinderMesh(radius, length, kObstacleChordError);
  const std::size_t segments = mesh.vertices.size() / 2 - 1;
  const double growth = kRoundingRoom / std::cos(std::numbers::pi / static_cast<double>(segments));
  for (Vector3d& vertex : mesh.vertices) vertex = vertex.cwiseProduct(Vector3d(growth, growth, kRoundingRoom));
  return makeShape(ObstacleShape::Cylinder{radius, length}, std::move(mesh));
}

std::shared_ptr<const ObstacleShape> makeSphereShape(double radius) {
  return makeShape(ObstacleShape::Sphere{radius}, around(sphereMesh(radius, kObstacleChordError), radius));
}

std::shared_ptr<const ObstacleShape> makeMeshShape(TriangleMesh mesh) {
  return makeShape(ObstacleShape::Mesh{}, std::move(mesh));
}

std::shared_ptr<const ObstacleShape> makePointsShape(std::vector<Vector3d> points, double radius) {
  const double growth = thinPoints(points, radius / 2);
  return makeBallsShape(std::move(points), radius + growth);
}

std::size_t dropTargetPoints(const TriangleMesh& target, const Eigen::Isometry3d& X_WO,
                             std::vector<Obstacle>& obstacles) {
  const auto isCloud = [](const Obstacle& o) { return std::holds_alternative<ObstacleShape::Points>(o.shape->kind); };
  if (std::none_of(obstacles.begin(), obstacles.end(), isCloud)) return 0;
  const SurfaceDistance distance(target);
  const RayScene solid(target);
  const Eigen::AlignedBox3d box = boundingBox(target);
  std::size_t dropped = 0;
  for (Obstacle& obstacle : obstacles) {
    if (!isCloud(obstacle)) continue;
    const auto& cloud = std::get<ObstacleShape::Points>(obstacle.shape->kind);
    const Eigen::Isometry3d X_OS = X_WO.inverse() * obstacle.X_WS;
    const double reach = ballReach() * cloud.radius;
    std::vector<Vector3d> kept;
    for (const Vector3d& p_S : cloud.points) {
      const Vector3d p_O = X_OS * p_S;
      const bool isNear = box.exteriorDistance(p_O) <= reach;
      if (!isNear || (distance(p_O, reach) >= reach && !(box.contains(p_O) && solid.contains(p_O))))
        kept.push_back(p_S);
    }
    if (kept.size() == cloud.points.size()) continue;
    dropped += cloud.points.size() - kept.size();
    obstacle.shape = makeBallsShape(std::move(kept), cloud.radius);
  }
  return dropped;
}

}  // namespace handhold
