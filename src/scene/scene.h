#pragma once

#include "mesh/triangle_mesh.h"

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// The surface of an obstacle in its own frame, shared by every pose that it takes. The polyhedra of cylinders, spheres
/// and clouds enclose the true solids (chord error 0.5 mm, an icosahedron for the ball of a cloud): README.md.
struct ObstacleShape {
  struct Box {
    Eigen::Vector3d size;  // full extents [m]
  };
  struct Cylinder {
    double radius = 0, length = 0;  // m, axis z, centred
  };
  struct Sphere {
    double radius = 0;  // m
  };
  struct Mesh {};  // the triangles below are all there is
  struct Points {
    std::vector<Eigen::Vector3d> points;  // m
    double radius = 0;  // m, of the ball about each; may be more than was written, see makePointsShape
  };
  std::variant<Box, Cylinder, Sphere, Mesh, Points> kind;
  TriangleMesh mesh;  // the surface, outward; the balls of a cloud as small polyhedra around them
  std::vector<Eigen::Vector3d> piecePoints;  // one point of each connected piece
  bool watertight = false;                   // containment has a meaning
};

/// Something in the way.
struct Obstacle {
  std::string name;
  std::shared_ptr<const ObstacleShape> shape;
  Eigen::Isometry3d X_WS = Eigen::Isometry3d::Identity();  // pose of the shape's frame in the world
};

/// What stands around the robot, as a scene file says it. W is the world.
struct Scene {
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();  // the robot's root link
  std::optional<std::map<std::string, double>> joints;  // by name; the word home gives an empty map; none: not written
  std::string arm;                                      // empty: any
  std::string target;                                   // name of an object in the database
  Eigen::Isometry3d X_WO = Eigen::Isometry3d::Identity();
  std::vector<Obstacle> obstacles;
  std::vector<std::string> notes;  // what was dropped or repaired, a sentence each
};

/// The mesh of a stored object, by its name. @throws InputError  the database has no such object
using ObjectMeshes = std::function<TriangleMesh(const std::string& object)>;

/// Reads a scene file. Meshes and clouds are relative to it. Points of a cloud whose balls (their polyhedra) would
/// reach the target's surface, and points inside it, are dropped: they are the target, seen.
/// @throws InputError  naming file, line and key
Scene loadScene(const std::string& path, const ObjectMeshes& objectMeshes);

class YamlValue;
/// The same from a text that is already parsed; `file` is what relative paths belong to.
Scene readScene(const YamlValue& top, const std::filesystem::path& file, const ObjectMeshes& objectMeshes);

/// Only the keys `robot` and `obstacles` of `top`, which may have others: a scene without a target.
/// @throws InputError  naming file, line and key
Scene readSurroundings(const YamlValue& top, const std::filesystem::path& file, const ObjectMeshes& objectMeshes);

/// One entry of `obstacles`; `file` is what relative paths belong to. Points near a target are not dropped here.
/// `notes` gets what was dropped or repaired, a sentence each, when it is not null.
/// @throws InputError  naming file, line and key
Obstacle readObstacle(const YamlValue& entry, const std::filesystem::path& file, const ObjectMeshes& objectMeshes,
                      std::vector<std::string>* notes = nullptr);

/// Drops the points of clouds that belong to the target, as loadScene does; clouds that lose none keep their shape.
/// Returns how many were dropped.
std::size_t dropTargetPoints(const TriangleMesh& target, const Eigen::Isometry3d& X_WO,
                             std::vector<Obstacle>& obstacles);

/// Shapes from numbers; messages of bad values are the caller's.
std::shared_ptr<const ObstacleShape> makeBoxShape(const Eigen::Vector3d& size);
std::shared_ptr<const ObstacleShape> makeCylinderShape(double radius, double length);
std::shared_ptr<const ObstacleShape> makeSphereShape(double radius);
std::shared_ptr<const ObstacleShape> makeMeshShape(TriangleMesh mesh);
/// Keeps the first point of each voxel of edge radius / 2; the balls grow by the farthest that a dropped point lies
/// from the kept one of its voxel, so that they cover all balls asked for.
std::shared_ptr<const ObstacleShape> makePointsShape(std::vector<Eigen::Vector3d> points, double radius);

}  // namespace handhold
