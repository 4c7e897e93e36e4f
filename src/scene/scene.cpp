#include "scene/scene.h"

#include "core/error.h"
#include "core/yaml.h"
#include "mesh/object.h"
#include "scene/point_cloud.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// A cloud is thinned to a few points a radius; more than this many left are a radius that is too small for its extent.
constexpr std::size_t kMostBalls = 200'000;

void addNote(std::vector<std::string>* notes, const YamlValue& entry, const std::string& text) {
  if (notes != nullptr) notes->push_back(fmt::format("{}: {}", entry.require("name").text(), text));
}

double readSize(const YamlValue& value) {
  const double size = value.number();
  if (!(size > 0 && size <= kFarthestCoordinate)) {
    value.refuse(fmt::format("metres > 0 and at most {}", kFarthestCoordinate));
  }
  return size;
}

Eigen::Isometry3d readPose(const YamlValue& value) {
  const Eigen::Isometry3d X = value.pose();
  if (X.translation().cwiseAbs().maxCoeff() > kFarthestCoordinate) {
    value.fail(fmt::format("is farther than {} m, want metres", kFarthestCoordinate));
  }
  return X;
}

using ShapePointer = std::shared_ptr<const ObstacleShape>;

ShapePointer readBox(const YamlValue& value) {
  if (value.kind() != YamlValue::Kind::sequence || value.items().size() != 3) {
    value.refuse("three full extents [x, y, z] in metres");
  }
  const auto& extents = value.items();
  return makeBoxShape({readSize(extents[0]), readSize(extents[1]), readSize(extents[2])});
}

ShapePointer readCylinder(const YamlValue& value) {
  value.allowKeys({"radius", "length"});
  return makeCylinderShape(readSize(value.require("radius")), readSize(value.require("length")));
}

ShapePointer readSphere(const YamlValue& value) {
  value.allowKeys({"radius"});
  return makeSphereShape(readSize(value.require("radius")));
}

std::string besides(const fs::path& file, const std::string& path) {
  return (file.parent_path() / path).lexically_normal().string();
}

/// What `read` makes of the file that an entry names; a refusal says where the name is as well.
template <class Read>
auto readNamed(const YamlValue& name, const fs::path& file, const Read& read) {
  try {
    return read(besides(file, name.text()));
  } catch (const InputError& error) {
    name.fail(fmt::format("is \"{}\": {}", name.text(), error.what()));
  }
}

ShapePointer readMesh(const YamlValue& entry, const fs::path& file, std::vector<std::string>* notes) {
  const auto unit = readMeshUnit(entry);
  ObjectModel model =
      readNamed(entry.require("mesh"), file, [&](const std::string& path) { return loadObject(path, unit); });
  for (const auto* texts : {&model.notes, &model.warnings}) {
    for (const std::string& text : *texts) addNote(notes, entry, text);
  }
  if (!model.watertight) addNote(notes, entry, "is not watertight: nothing counts as inside it");
  return makeMeshShape(std::move(model.mesh));
}

TriangleMesh objectMesh(const YamlValue& name, const ObjectMeshes& objectMeshes) {
  try {
    return objectMeshes(name.text());
  } catch (const InputError& error) {
    name.fail(fmt::format("is \"{}\": {}", name.text(), error.what()));
  }
}

ShapePointer readPoints(const YamlValue& entry, const fs::path& file, std::vector<std::string>* notes) {
  const YamlValue& path = entry.require("points");
  const double radius = readSize(entry.require("radius"));
  std::vector<Eigen::Vector3d> points = readNamed(path, file, readPointCloud);
  const std::size_t read = points.size();
  std::vector<Eigen::Vector3d> thinned = points;
  thinPoints(thinned, radius / 2);
  if (thinned.size() > kMostBalls) {
    path.fail(fmt::format("leaves {} points half a radius apart, want at most {}: a larger radius", thinned.size(),
                          kMostBalls));
  }
  ShapePointer shape = makePointsShape(std::move(points), radius);
  const auto& cloud = std::get<ObstacleShape::Points>(shape->kind);
  if (cloud.points.size() < read) {
    addNote(notes, entry,
            fmt::format("{} of {} points kept, as balls of {:.2g} m that cover the others", cloud.points.size(), read,
                        cloud.radius));
  }
  return shape;
}

/// The key that says which shape an entry has.
const std::string& shapeKey(const YamlValue& entry) {
  static const std::vector<std::string> kKeys = {"box", "cylinder", "sphere", "mesh", "object", "points"};
  const std::string* found = nullptr;
  for (const std::string& key : kKeys) {
    const YamlValue* value = entry.find(key);
    if (value == nullptr) continue;
    if (found != nullptr) value->fail(fmt::format("is given beside {}, want one shape", *found));
    found = &key;
  }
  if (found == nullptr) entry.fail(fmt::format("has no shape, want one of: {}", fmt::join(kKeys, ", ")));
  return *found;
}

ShapePointer readShape(const YamlValue& entry, const fs::path& file, const ObjectMeshes& objectMeshes,
                       std::vector<std::string>* notes) {
  const std::string& key = shapeKey(entry);
  for (const auto& [option, owner] : {std::pair("unit", "mesh"), {"scale", "mesh"}, {"radius", "points"}}) {
    const YamlValue* value = entry.find(option);
    if (value != nullptr && key != owner)
      value->fail(fmt::format("is given beside {}, want it with {} alone", key, owner));
  }
  const YamlValue& value = entry.require(key);
  if (key == "box") return readBox(value);
  if (key == "cylinder") return readCylinder(value);
  if (key == "sphere") return readSphere(value);
  if (key == "mesh") return readMesh(entry, file, notes);
  if (key == "object") return makeMeshShape(objectMesh(value, objectMeshes));
  return readPoints(entry, file, notes);
}

void readRobot(const YamlValue& robot, Scene& scene) {
  robot.allowKeys({"base", "joints", "arm"});
  if (const YamlValue* base = robot.find("base")) scene.X_WB = readPose(*base);
  if (const YamlValue* arm = robot.find("arm")) scene.arm = arm->text();
  const YamlValue* joints = robot.find("joints");
  if (joints == nullptr) return;
  scene.joints.emplace();
  if (joints->kind() == YamlValue::Kind::scalar && joints->text() == "home") return;
  if (joints->kind() != YamlValue::Kind::map) joints->refuse("a map of joint positions, or the word home");
  for (const auto& [name, value] : joints->entries()) (*scene.joints)[name] = value.number();
}

}  // namespace

Obstacle readObstacle(const YamlValue& entry, const fs::path& file, const ObjectMeshes& objectMeshes,
                      std::vector<std::string>* notes) {
  entry.allowKeys({"name", "pose", "box", "cylinder", "sphere", "mesh", "unit", "scale", "object", "points", "radius"});
  Obstacle obstacle;
  obstacle.name = entry.require("name").text();
  if (const YamlValue* pose = entry.find("pose")) obstacle.X_WS = readPose(*pose);
  obstacle.shape = readShape(entry, file, objectMeshes, notes);
  return obstacle;
}

Scene loadScene(const std::string& path, const ObjectMeshes& objectMeshes) {
  return readScene(YamlValue::parseFile(path), path, objectMeshes);
}

Scene readSurroundings(const YamlValue& top, const fs::path& path, const ObjectMeshes& objectMeshes) {
  Scene scene;
  if (const YamlValue* robot = top.find("robot")) readRobot(*robot, scene);
  if (const YamlValue* obstacles = top.find("obstacles")) {
    std::set<std::string> names;
    for (const YamlValue& entry : obstacles->items()) {
      Obstacle obstacle = readObstacle(entry, path, objectMeshes, &scene.notes);
      if (!names.insert(obstacle.name).second) {
        entry.require("name").fail(fmt::format("is \"{}\" for the second time, want every name once", obstacle.name));
      }
      scene.obstacles.push_back(std::move(obstacle));
    }
  }
  return scene;
}

Scene readScene(const YamlValue& top, const fs::path& path, const ObjectMeshes& objectMeshes) {
  top.allowKeys({"robot", "target", "obstacles"});
  const YamlValue& target = top.require("target");
  target.allowKeys({"object", "pose"});
  const TriangleMesh targetMesh = objectMesh(target.require("object"), objectMeshes);
  const Eigen::Isometry3d X_WO = readPose(target.require("pose"));
  Scene scene = readSurroundings(top, path, objectMeshes);
  scene.target = target.require("object").text();
  scene.X_WO = X_WO;
  const std::size_t dropped = dropTargetPoints(targetMesh, scene.X_WO, scene.obstacles);
  if (dropped > 0) scene.notes.push_back(fmt::format("{} points of clouds dropped: they are the target", dropped));
  return scene;
}

}  // namespace handhold
