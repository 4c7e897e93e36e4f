#pragma once

#include "core/error.h"
#include "plan/planner.h"
#include "support/toy_box_set.h"

#include <filesystem>
#include <fstream>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace handhold::testing {

/// A database with the toy box and the jaw, the Panda, and a Puma that carries the jaw.
class PlanWorld : public ::testing::Test {
 protected:
  PlanWorld() {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(::testing::TempDir()) / fmt::format("handhold-{}-{}", info->name(), ::getpid());
    std::filesystem::create_directories(folder_ / "puma");
    Database(folder_ / "db").write(toyBoxSet(loadHand(source() + "/hands/jaw")));
    write("puma/robot.yaml",
          fmt::format("urdf: {0}/robots/puma560/puma560.urdf\n"
                      "arms:\n"
                      "  - {{name: arm, base_link: base, tip_link: flange, hand: {0}/hands/jaw, "
                      "mount: {{position: [0, 0, 0]}}}}\n"
                      "home: {{joint_2: 0.785398, joint_3: -3.141593, joint_5: 0.785398, finger_1: 0.04}}\n"
                      "max_velocity: 1.5\nmax_acceleration: 3\n",
                      source()));
  }
  ~PlanWorld() override { std::filesystem::remove_all(folder_); }

  static std::string source() { return HANDHOLD_SOURCE_DIR; }
  std::string write(const std::string& name, const std::string& content) const {
    std::ofstream(folder_ / name) << content;
    return (folder_ / name).string();
  }

  Planner puma(PlannerOptions options = {}) const {
    return {(folder_ / "db").string(), loadRobot((folder_ / "puma").string()), options};
  }
  Planner panda(PlannerOptions options = {}) const {
    return {(folder_ / "db").string(), loadRobot(source() + "/robots/panda"), options};
  }

  /// The box on a table in front of the robot, `more` obstacles beside it.
  static Scene scene(std::vector<Obstacle> more = {}, const Eigen::Vector3d& box = {0.5, 0.1, 0}) {
    Scene scene;
    scene.target = "toy_box";
    scene.joints.emplace();
    scene.X_WO.translation() = box;
    scene.obstacles = {obstacle("table", makeBoxShape({0.7, 1.2, 0.04}), {0.6, 0, -0.02})};
    for (Obstacle& o : more) scene.obstacles.push_back(std::move(o));
    return scene;
  }

  static Obstacle obstacle(const std::string& name, std::shared_ptr<const ObstacleShape> shape,
                           const Eigen::Vector3d& position) {
    return {name, std::move(shape), Eigen::Isometry3d(Eigen::Translation3d(position))};
  }

  template <class Call>
  std::string refusalOf(const Call& call) const {
    try {
      call();
    } catch (const InputError& error) {
      std::string text = error.what();
      const std::string prefix = folder_.string() + "/";
      for (std::size_t at = text.find(prefix); at != std::string::npos; at = text.find(prefix))
        text.erase(at, prefix.size());
      return text;
    }
    return "nothing was thrown";
  }

  std::filesystem::path folder_;
};

}  // namespace handhold::testing
