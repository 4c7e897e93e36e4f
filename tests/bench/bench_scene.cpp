// Times the distance map of 10,000 points of the mug with cones of 32 rays among ten obstacles and a table, against the
// plain method (every ray to its end) in the same run; the update after an obstacle moved; and signed distances.
//
//     bench_scene [--json] [--quick]
#include "bench/timings.h"
#include "core/random.h"
#include "mesh/object.h"
#include "mesh/ray_scene.h"
#include "sample/surface_samples.h"
#include "scene/distance_map.h"
#include "scene/signed_distance.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/core.h>

namespace handhold {
namespace {

using bench::timed;
using bench::Timings;
using Eigen::Isometry3d;
using Eigen::Vector3d;
using nlohmann::ordered_json;

constexpr std::size_t kPoints = 10'000;
constexpr int kQueries = 100'000;

struct Target {
  std::vector<float> points, normals;
};

ObjectModel load(const std::string& name, double scale = 1) {
  return loadObject(std::string(HANDHOLD_SOURCE_DIR) + "/meshes/" + name, {scale, true, "m"});
}

/// In the order in which a database stores them.
Target sampleMug() {
  const ObjectModel mug = load("mug.obj");
  const SurfaceSamples samples = sampleSurfaceCount(mug, RayScene(mug.mesh), kPoints, "mug");
  Target target;
  for (const auto& p : samples.point) target.points.insert(target.points.end(), p.data(), p.data() + 3);
  for (const auto& n : samples.normal) target.normals.insert(target.normals.end(), n.data(), n.data() + 3);
  return target;
}

Isometry3d at(double x, double y, double z) { return Isometry3d(Eigen::Translation3d(x, y, z)); }

std::vector<Obstacle> onCircle(const std::vector<std::shared_ptr<const ObstacleShape>>& shapes, double z,
                               std::uint64_t seed) {
  const RandomStream random(seed);
  std::vector<Obstacle> obstacles = {{"table", makeBoxShape({1.2, 0.8, 0.02}), at(0, 0, -0.01)}};
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const double angle = 2 * std::numbers::pi * (static_cast<double>(i) + 0.5 * random.uniform(2 * i)) / 10;
    const double radius = 0.16 + 0.08 * random.uniform(2 * i + 1);
    obstacles.push_back({fmt::format("{}", i), shapes[i], at(radius * std::cos(angle), radius * std::sin(angle), z)});
  }
  return obstacles;
}

std::vector<std::shared_ptr<const ObstacleShape>> meshShapes() {
  std::vector<std::shared_ptr<const ObstacleShape>> shapes;
  for (const char* name : {"bottle.stl", "pitcher.glb", "bowl.obj", "box.stl", "can.ply", "banana.obj", "torus.glb",
                           "wine_glass.ply", "t_bar.ply", "tube.obj"}) {
    shapes.push_back(makeMeshShape(load(name).mesh));
  }
  return shapes;
}

std::vector<std::shared_ptr<const ObstacleShape>> primitiveShapes() {
  std::vector<std::shared_ptr<const ObstacleShape>> shapes;
  for (int i = 0; i < 5; ++i) {
    shapes.push_back(makeCylinderShape(0.02 + 0.006 * i, 0.3));
    shapes.push_back(makeBoxShape({0.04 + 0.01 * i, 0.06, 0.3}));
  }
  return shapes;
}

/// Balls on the walls of a box around the target.
std::shared_ptr<const ObstacleShape> cloudShape() {
  const RandomStream random(7);
  std::vector<Vector3d> points;
  for (std::uint64_t i = 0; i < 20'000; ++i) {
    Vector3d p(random.uniform(3 * i), random.uniform(3 * i + 1), random.uniform(3 * i + 2));
    p[static_cast<Eigen::Index>(i % 3)] = i % 2 == 0 ? 0 : 1;
    points.push_back(0.5 * p - Vector3d(0.25, 0.25, 0.05));
  }
  return makePointsShape(std::move(points), 0.004);
}

/// Any right-handed frame about n.
Eigen::Matrix3d frameAbout(const Vector3d& n) {
  Eigen::Matrix3d frame;
  frame.col(2) = n;
  frame.col(0) = n.unitOrthogonal();
  frame.col(1) = n.cross(frame.col(0));
  return frame;
}

/// Every ray of every cone to its first hit, nothing shared between them.
std::vector<float> plainMap(const SceneRays& scene, const DistanceMap& map, const Target& target) {
  std::vector<float> D;
  for (std::size_t i = 0; i < target.points.size(); i += 3) {
    const Vector3d p(target.points[i], target.points[i + 1], target.points[i + 2]);
    const Eigen::Matrix3d frame = frameAbout({target.normals[i], target.normals[i + 1], target.normals[i + 2]});
    double nearest = DistanceMapSettings{}.far;
    for (const Vector3d& ray : map.rays()) nearest = std::min(nearest, scene.cast(p, frame * ray));
    D.push_back(static_cast<float>(nearest));
  }
  return D;
}

double mean(const std::vector<float>& values) {
  double sum = 0;
  for (const float value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

ordered_json benchMap(const std::string& name, std::vector<Obstacle> obstacles, const Target& target, int repeats) {
  const DistanceMap map;
  SceneRays scene;
  Timings first, update, fast, plain;
  const auto timedUpdate = [&](Timings& timings, SceneRays& rays) {
    timed(timings, [&] {
      rays.update(obstacles);
      return 0;
    });
  };
  std::size_t triangles = 0;
  for (const Obstacle& obstacle : obstacles) triangles += obstacle.shape->mesh.triangles.size();
  std::vector<float> D, reference;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    for (Timings* timings : {&first, &update, &fast, &plain}) timings->startRepeat();
    SceneRays fresh;
    timedUpdate(first, fresh);
    scene.update(obstacles);
    obstacles.back().X_WS.translation().x() += 1e-4;
    timedUpdate(update, scene);
    timed(fast, [&] {
      map.compute(scene, target.points, target.normals, Isometry3d::Identity(), D);
      return D[0];
    });
    timed(plain, [&] {
      reference = plainMap(scene, map, target);
      return reference[0];
    });
  }
  return {{"scene", name},
          {"triangles", triangles},
          {"map", fast.json()},
          {"plain", plain.json()},
          {"plain_ratio", plain.median() / fast.median()},
          {"first_update", first.json()},
          {"update", update.json()},
          {"mean_distance", mean(D)},
          {"mean_distance_plain", mean(reference)}};
}

ordered_json benchDistance(const std::string& name, const std::shared_ptr<const ObstacleShape>& shape, int repeats) {
  Timings build, query;
  double sum = 0, error = 0;
  const Eigen::AlignedBox3d box = boundingBox(shape->mesh);
  const RandomStream random(3);
  std::vector<Vector3d> points;
  for (std::uint64_t i = 0; i < kQueries; ++i) {  // within a hand's length of the box
    const Vector3d u(random.uniform(3 * i), random.uniform(3 * i + 1), random.uniform(3 * i + 2));
    points.push_back(box.min() + u.cwiseProduct(box.sizes() + Vector3d::Constant(0.2)) - Vector3d::Constant(0.1));
  }
  for (int repeat = 0; repeat < repeats; ++repeat) {
    build.startRepeat();
    query.startRepeat();
    const double before = bench::microsecondsNow();
    const SignedDistance distance(shape);
    build.add(bench::microsecondsNow() - before);
    error = distance.error();
    sum = timed(query, [&] {
      double all = 0;
      for (const Vector3d& p : points) all += distance(p);
      return all;
    });
  }
  return {{"shape", name},
          {"triangles", shape->mesh.triangles.size()},
          {"build", build.json()},
          {"query_ns", 1e3 * query.median() / kQueries},
          {"queries", query.json()},
          {"error", error},
          {"mean_distance", sum / kQueries}};
}

std::string spread(const ordered_json& timing, double unit) {
  return fmt::format("{:.3g} ({:.3g}-{:.3g})", timing["median_us"].get<double>() / unit,
                     timing["median_min_us"].get<double>() / unit, timing["median_max_us"].get<double>() / unit);
}

void printTable(const ordered_json& report) {
  fmt::print("{}\n", report["machine"].dump());
  fmt::print("distance map of {} points x {} rays; median (least-most) over {} repeats, one thread\n\n", kPoints,
             DistanceMapSettings{}.rays, report["repeats"].get<int>());
  fmt::print("{:<12} {:>9} {:>20} {:>20} {:>6} {:>20} {:>22} {:>12}\n", "scene", "triangles", "map ms", "plain ms",
             "ratio", "update us", "first update ms", "mean D (plain)");
  for (const ordered_json& row : report["maps"]) {
    fmt::print("{:<12} {:>9} {:>20} {:>20} {:>6.2f} {:>20} {:>22} {:>6.4f} {:.4f}\n", row["scene"].get<std::string>(),
               row["triangles"].get<std::size_t>(), spread(row["map"], 1e3), spread(row["plain"], 1e3),
               row["plain_ratio"].get<double>(), spread(row["update"], 1), spread(row["first_update"], 1e3),
               row["mean_distance"].get<double>(), row["mean_distance_plain"].get<double>());
  }
  fmt::print("\n{:<12} {:>9} {:>20} {:>10} {:>10} {:>10}\n", "distance to", "triangles", "build ms", "query ns",
             "error mm", "mean m");
  for (const ordered_json& row : report["distances"]) {
    fmt::print("{:<12} {:>9} {:>20} {:>10.1f} {:>10.2f} {:>10.4f}\n", row["shape"].get<std::string>(),
               row["triangles"].get<std::size_t>(), spread(row["build"], 1e3), row["query_ns"].get<double>(),
               1e3 * row["error"].get<double>(), row["mean_distance"].get<double>());
  }
}

int run(int argc, char** argv) {
  bool asJson = false;
  int repeats = 15;
  for (int i = 1; i < argc; ++i) {
    const std::string_view option = argv[i];
    if (option == "--json") {
      asJson = true;
    } else if (option == "--quick") {
      repeats = 3;
    } else {
      fmt::print(stderr, "usage: bench_scene [--json] [--quick]\n");
      return 2;
    }
  }
  const Target target = sampleMug();
  const auto meshes = meshShapes();
  const auto cloud = cloudShape();
  ordered_json report = {{"machine", {{"cpu", bench::cpuModel()}, {"build", HANDHOLD_BUILD_TYPE}, {"threads", 1}}},
                         {"repeats", repeats}};
  report["maps"] = {benchMap("meshes", onCircle(meshes, 0, 1), target, repeats),
                    benchMap("primitives", onCircle(primitiveShapes(), 0.15, 1), target, repeats),
                    benchMap("cloud", onCircle({cloud}, 0, 1), target, repeats)};
  report["maps"][2]["note"] = "one obstacle of balls around the target";
  report["distances"] = {benchDistance("box", makeBoxShape({0.1, 0.2, 0.3}), repeats),
                         benchDistance("cylinder", makeCylinderShape(0.05, 0.2), repeats),
                         benchDistance("cloud", cloud, repeats), benchDistance("bottle", meshes[0], repeats),
                         benchDistance("pitcher", meshes[1], repeats)};
  if (asJson) {
    fmt::print("{}\n", report.dump(1));
  } else {
    printTable(report);
  }
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) { return handhold::run(argc, argv); }
