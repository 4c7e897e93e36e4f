#include "plan/plan_file.h"

#include "core/error.h"
#include "core/file.h"
#include "plan/planner.h"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using JsonInput = nlohmann::json;

Eigen::VectorXd vectorOf(const JsonInput& json, std::size_t size) {
  const auto values = json.get<std::vector<double>>();
  if (values.size() != size) throw InputError(fmt::format("has {} numbers, want {}", values.size(), size));
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(size));
}

Eigen::Isometry3d poseOf(const JsonInput& json) {
  const Eigen::VectorXd p = vectorOf(json, 7);
  const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  if (!(std::abs(q.norm() - 1) < 1e-3)) throw InputError("has no unit quaternion x y z w at its end");
  return Eigen::Translation3d(p.head<3>()) * q.normalized();
}

Trajectory trajectoryOf(const JsonInput& json, std::size_t joints) {
  Trajectory trajectory;
  for (const JsonInput& row : json.at("points")) {
    trajectory.points.push_back({row.at("time_from_start").get<double>(), vectorOf(row.at("positions"), joints),
                                 vectorOf(row.at("velocities"), joints)});
    const std::size_t i = trajectory.points.size() - 1;
    if (i > 0 && !(trajectory.points[i].time > trajectory.points[i - 1].time))
      throw InputError(fmt::format("points do not follow each other in time at point {}", i));
  }
  for (const JsonInput& row : json.at("segments")) {
    const TrajectorySegment segment{row.at("name"), row.at("begin"), row.at("end")};
    if (segment.begin > segment.end || segment.end >= trajectory.points.size())
      throw InputError(fmt::format("segment {} leaves the {} points", segment.name, trajectory.points.size()));
    trajectory.segments.push_back(segment);
  }
  if (trajectory.points.empty()) throw InputError("has no points, want at least one");
  return trajectory;
}

FiledMotion motionOf(const JsonInput& json) {
  FiledMotion motion;
  motion.arm = json.at("arm");
  motion.jointNames = json.at("trajectory").at("joint_names").get<std::vector<std::string>>();
  motion.trajectory = trajectoryOf(json.at("trajectory"), motion.jointNames.size());
  return motion;
}

PlanSource sourceOf(const JsonInput& json) {
  PlanSource source;
  source.robot = json.at("robot");
  source.database = json.at("db");
  source.scene = json.contains("task") ? json.at("task") : json.at("scene");
  source.score = json.at("score");
  if (!scoreOf(source.score)) throw InputError(fmt::format("has score \"{}\", want paper or reach", source.score));
  if (json.contains("calibrations")) source.calibrations = json.at("calibrations");
  if (json.contains("packages")) source.packages = json.at("packages");
  if (json.contains("seed")) source.seed = json.at("seed");
  if (json.contains("draw")) source.draw = json.at("draw").get<std::int64_t>();
  return source;
}

void readPlan(const JsonInput& json, PlanFile& file) {
  if (!json.contains("trajectory")) return;
  file.motions.push_back(motionOf(json));
  file.motions.back().object = json.at("object");
  file.hand = json.at("hand");
  file.arm = json.at("arm");
  file.setVersion = json.at("set_version");
  file.grasp = json.at("grasp");
  file.rank = json.at("rank");
}

void readTask(const JsonInput& json, PlanFile& file) {
  file.isTask = true;
  for (const JsonInput& row : json.at("steps")) {
    file.steps.push_back({row.at("step"), row.at("object"), row.value("arm", ""), row.at("rejected")});
    if (!row.contains("motions")) continue;
    for (const JsonInput& moved : row.at("motions")) {
      FiledMotion motion = motionOf(moved);
      motion.object = row.at("object");
      motion.step = row.at("step");
      motion.X_WO_after = poseOf(moved.at("object_pose_after"));
      file.motions.push_back(std::move(motion));
    }
  }
}

}  // namespace

PlanFile readPlanFile(const std::filesystem::path& path) {
  const std::string text = readFile(path);
  PlanFile file;
  const auto refuse = [&](const std::exception& error) {
    throw InputError(
        fmt::format("{}: {}, want a file that handhold-plan plan or task wrote", path.string(), error.what()));
  };
  try {
    const JsonInput json = JsonInput::parse(text);
    file.status = json.at("status");
    file.reason = json.value("reason", "");
    if (json.contains("source")) file.source = sourceOf(json.at("source"));
    json.contains("steps") ? readTask(json, file) : readPlan(json, file);
  } catch (const JsonInput::exception& error) {
    refuse(error);
  } catch (const InputError& error) {
    refuse(error);
  }
  return file;
}

}  // namespace handhold
