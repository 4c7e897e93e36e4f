#include "plan/task_trials.h"

#include "core/error.h"
#include "core/job_system.h"
#include "core/random.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Json = nlohmann::ordered_json;

constexpr int kPlaceDraws = 1000;      // of one object or block
constexpr int kDrawnPerFeasible = 10;  // scenes, before giving up

/// What something covers, seen from above.
struct Disc {
  Vector2d center;
  double radius = 0;  // m
};

bool overlap(const Disc& a, const Disc& b) { return (a.center - b.center).norm() < a.radius + b.radius; }

bool isFree(const Disc& disc, const std::vector<Disc>& taken) {
  return std::none_of(taken.begin(), taken.end(), [&](const Disc& other) { return overlap(disc, other); });
}

Disc discOf(const TriangleMesh& mesh, const Isometry3d& X) {
  const Eigen::AlignedBox3d box = boundingBox(mesh).transformed(X);
  return {box.center().head<2>(), box.sizes().head<2>().norm() / 2};
}

/// The numbers of one scene, in the order in which they are drawn.
class SceneDrawer {
 public:
  SceneDrawer(const Task& task, const ObjectMeshes& objectMeshes, const RandomStream& stream)
      : task_(task), objectMeshes_(objectMeshes), stream_(stream) {
    if (!task.trials) throw InputError("trials is missing, want the regions of the objects and the blocks");
    for (std::size_t i = 0; i < task.surroundings.obstacles.size(); ++i) {
      const Obstacle& obstacle = task.surroundings.obstacles[i];
      if (i != task.trials->on) taken_.push_back(discOf(obstacle.shape->mesh, obstacle.X_WS));
    }
    for (const TaskStep& step : task.steps) {
      if (step.verb != TaskVerb::place) continue;
      Disc disc = discOf(objectMeshes(task.objects[step.object].object), step.region.X_WR);
      disc.radius += step.region.size.head<2>().norm() / 2;
      taken_.push_back(disc);
    }
  }

  Task draw() {
    for (std::size_t i = 0; i < task_.objects.size(); ++i) drawObject(i);
    const TaskTrialsSettings& settings = *task_.trials;
    const int blocks = settings.fewestBlocks +
                       static_cast<int>(stream_.bits(counter_++) %
                                        static_cast<std::uint64_t>(settings.mostBlocks - settings.fewestBlocks + 1));
    for (int i = 0; i < blocks; ++i) drawBlock(i);
    return std::move(task_);
  }

 private:
  double between(double low, double high) { return std::lerp(low, high, stream_.uniform(counter_++)); }

  void drawObject(std::size_t i) {
    TaskObject& object = task_.objects[i];
    const TriangleMesh mesh = objectMeshes_(object.object);
    const auto region = task_.trials->objects.find(i);
    for (int draw = 0; draw < kPlaceDraws; ++draw) {
      if (region != task_.trials->objects.end()) object.X_WO = region->second.sample(stream_.child(counter_++));
      const Disc disc = discOf(mesh, object.X_WO);
      if (!isFree(disc, taken_)) continue;
      taken_.push_back(disc);
      return;
    }
    throw InputError(
        fmt::format("trials.objects: no room for {}, want regions apart from obstacles and places", object.name));
  }

  void drawBlock(int number) {
    const Obstacle& ground = task_.surroundings.obstacles[task_.trials->on];
    const Eigen::AlignedBox3d on = boundingBox(ground.shape->mesh).transformed(ground.X_WS);
    const Vector3d about = task_.objects[static_cast<std::size_t>(number) % task_.objects.size()].X_WO.translation();
    for (int draw = 0; draw < kPlaceDraws; ++draw) {
      const Vector3d size(between(0.04, 0.1), between(0.04, 0.1), between(0.08, 0.25));
      const double angle = between(0, 2 * std::numbers::pi), yaw = between(0, 2 * std::numbers::pi);
      const Vector2d center = about.head<2>() + task_.trials->circle * Vector2d(std::cos(angle), std::sin(angle));
      const Disc disc{center, size.head<2>().norm() / 2};
      const Vector2d inside = (center - on.center().head<2>()).cwiseAbs() - on.sizes().head<2>() / 2;
      if (inside.maxCoeff() > 0 || !isFree(disc, taken_)) continue;
      taken_.push_back(disc);
      Isometry3d X(Eigen::Translation3d(center.x(), center.y(), on.max().z() + size.z() / 2));
      X.rotate(Eigen::AngleAxisd(yaw, Vector3d::UnitZ()));
      task_.surroundings.obstacles.push_back({fmt::format("block_{}", number + 1), makeBoxShape(size), X});
      return;
    }
    // No room is left: one block less, as in a scene with fewer of them.
  }

  Task task_;
  const ObjectMeshes& objectMeshes_;
  RandomStream stream_;
  std::uint64_t counter_ = 0;
  std::vector<Disc> taken_;
};

TaskTrial runOne(TaskPlanner& planner, const ObjectMeshes& meshes, const Task& task, std::uint64_t seed, int index) {
  TaskTrial trial;
  trial.index = index;
  const Task drawn = drawTask(task, meshes, seed, index);
  const auto start = std::chrono::steady_clock::now();
  trial.result = planner.plan(drawn);
  trial.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  for (TaskStepResult& step : trial.result.steps) {
    trial.duration += step.seconds();
    step.motions.clear();
  }
  return trial;
}

}  // namespace

Task drawTask(const Task& task, const ObjectMeshes& objectMeshes, std::uint64_t seed, int index) {
  return SceneDrawer(task, objectMeshes, RandomStream(seed).child(static_cast<std::uint64_t>(index))).draw();
}

std::vector<TaskTrial> runTaskTrials(const std::function<Planner()>& makePlanner, const TaskOptions& options,
                                     const Task& task, int feasible, int threads) {
  /// What a thread works with.
  struct Worker {
    Worker(Planner p, const TaskOptions& settings) : planner(std::move(p)), tasks(planner, settings) {}
    Planner planner;
    TaskPlanner tasks;
  };
  const JobSystem jobs(threads);
  std::vector<std::unique_ptr<Worker>> workers(static_cast<std::size_t>(jobs.threads()));
  std::vector<TaskTrial> trials;
  std::mutex mutex;  // guards trials and found
  int found = 0;
  std::atomic<bool> enough = false;
  jobs.run(
      static_cast<std::size_t>(kDrawnPerFeasible) * feasible, 1,
      [&](int worker, std::size_t index) {
        std::unique_ptr<Worker>& mine = workers[static_cast<std::size_t>(worker)];
        if (!mine) mine = std::make_unique<Worker>(makePlanner(), options);
        const ObjectMeshes meshes = [&](const std::string& object) { return mine->planner.objectMesh(object); };
        TaskTrial trial = runOne(mine->tasks, meshes, task, options.seed, static_cast<int>(index));
        const std::lock_guard lock(mutex);
        found += trial.result.feasible ? 1 : 0;
        trials.push_back(std::move(trial));
        if (found >= feasible) enough = true;
      },
      &enough);
  std::sort(trials.begin(), trials.end(), [](const auto& a, const auto& b) { return a.index < b.index; });
  // Threads may have gone beyond the last one that was asked for.
  std::size_t end = 0;
  for (int left = feasible; end < trials.size() && left > 0; ++end) left -= trials[end].result.feasible ? 1 : 0;
  trials.resize(end);
  return trials;
}

std::string trialsJson(const Task& task, const std::vector<TaskTrial>& trials, std::uint64_t seed) {
  Json scenes = Json::array();
  int feasible = 0, done = 0;
  for (const TaskTrial& trial : trials) {
    feasible += trial.result.feasible ? 1 : 0;
    done += trial.result.done ? 1 : 0;
    Json row = {{"scene", trial.index},
                {"status", trial.result.done       ? "planned"
                           : trial.result.feasible ? "failed"
                                                   : "infeasible"}};
    if (!trial.result.done) row["reason"] = trial.result.reason;
    row["rejected"] = Json::array();
    for (std::size_t i = 0; i < trial.result.steps.size(); ++i) {
      row["rejected"].push_back({{"step", kVerbNames[static_cast<std::size_t>(task.steps[i].verb)]},
                                 {"object", task.objects[task.steps[i].object].name},
                                 {"counts", trial.result.steps[i].rejected}});
    }
    row["duration"] = trial.duration;
    row["checks"] = trial.result.checks;
    row["seconds"] = trial.seconds;
    scenes.push_back(std::move(row));
  }
  const Json json = {
      {"seed", seed}, {"drawn", trials.size()}, {"feasible", feasible}, {"planned", done}, {"scenes", scenes}};
  return json.dump(1);
}

}  // namespace handhold
