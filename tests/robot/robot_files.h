#pragma once

#include "core/error.h"
#include "core/random.h"
#include "robot/chain.h"
#include "robot/robot.h"

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace handhold::testing {

inline const std::string kRobots = std::string(HANDHOLD_SOURCE_DIR) + "/robots/";  // the project's own

inline std::string boxLink(const std::string& name, const std::string& size) {
  return fmt::format("<link name=\"{}\"><collision><geometry><box size=\"{}\"/></geometry></collision></link>\n", name,
                     size);
}

inline std::string joint(const std::string& name, const std::string& type, const std::string& parent,
                         const std::string& child, const std::string& xyz, const std::string& axis, double lower,
                         double upper, const std::string& rest = "") {
  return fmt::format(
      "<joint name=\"{}\" type=\"{}\"><parent link=\"{}\"/><child link=\"{}\"/><origin xyz=\"{}\"/><axis xyz=\"{}\"/>"
      "<limit lower=\"{}\" upper=\"{}\" effort=\"5\" velocity=\"1.5\"/>{}</joint>\n",
      name, type, parent, child, xyz, axis, lower, upper, rest);
}

/// A column, two links that bend about y, a slide, and a flange without geometry; a head of its own.
inline std::string armLinks() {
  return boxLink("base", "0.1 0.1 0.1") + boxLink("upper", "0.05 0.05 0.3") + boxLink("lower", "0.05 0.05 0.3") +
         boxLink("slider", "0.04 0.04 0.04") + "<link name=\"flange\"/>\n" + boxLink("head", "0.02 0.02 0.02") +
         joint("shoulder", "revolute", "base", "upper", "0 0 0.3", "0 1 0", -1.5, 2) +
         joint("elbow", "revolute", "upper", "lower", "0 0 0.4", "0 1 0", 0.5, 2.5) +
         joint("slide", "prismatic", "lower", "slider", "0 0 0.3", "0 0 1", 0, 0.2) +
         joint("wrist", "fixed", "slider", "flange", "0 0 0.05", "0 0 1", 0, 0) +
         joint("nod", "revolute", "base", "head", "-0.2 0 0.3", "0 1 0", -1, 1);
}

/// A jaw of two fingers, the second a mimic of the first.
inline std::string handLinks() {
  return boxLink("palm", "0.1 0.04 0.02") + boxLink("left", "0.01 0.02 0.04") + boxLink("right", "0.01 0.02 0.04") +
         joint("open", "prismatic", "palm", "left", "0 0 0.03", "1 0 0", 0, 0.04) +
         joint("open_2", "prismatic", "palm", "right", "0 0 0.03", "-1 0 0", 0, 0.04, "<mimic joint=\"open\"/>");
}

inline std::string urdf(const std::string& content) { return "<robot name=\"test\">\n" + content + "</robot>\n"; }

inline const std::string kHandConfig =
    "urdf: hand.urdf\n"
    "root_link: palm\n"
    "palm: {link: palm, position: [0, 0, 0.01], approach: [0, 0, 1], closing: [1, 0, 0]}\n"
    "preshapes:\n"
    "  - {name: open, joints: {open: 0.03}}\n"
    "closing:\n"
    "  - {joint: open, direction: -1, self_centering: true}\n";

// Lines matter: the tests of refusals name them.
inline const std::string kConfig =
    "urdf: arm.urdf\n"                                                                                     // 1
    "arms:\n"                                                                                              // 2
    "  - {name: arm, base_link: base, tip_link: flange, hand: ../jaw, mount: {position: [0, 0, 0.02]}}\n"  // 3
    "home: {shoulder: 0.5, open: 0.02}\n"                                                                  // 4
    "max_velocity: {shoulder: 0.7, elbow: 9}\n"                                                            // 5
    "max_acceleration: 3\n"                                                                                // 6
    "clearance: 0.01\n"                                                                                    // 7
    "allowed_collisions: [[palm, base], [head, upper]]\n"                                                  // 8
    "score: {c1: 2, far: 0.4}\n";                                                                          // 9

inline std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t position = text.find(from);
  EXPECT_NE(position, std::string::npos) << "\"" << from << "\" is not in the text";
  if (position != std::string::npos) text.replace(position, from.size(), to);
  return text;
}

/// Folders `TEMP/.../toy` with a robot and `.../jaw` with its hand, removed at the end.
class RobotFiles : public ::testing::Test {
 protected:
  RobotFiles() {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    top_ = std::filesystem::path(::testing::TempDir()) /
           fmt::format("handhold-{}-{}-{}", info->test_suite_name(), info->name(), ::getpid());
    write("jaw/hand.urdf", urdf(handLinks()));
    write("jaw/hand.yaml", kHandConfig);
    write("toy/arm.urdf", urdf(armLinks()));
  }
  ~RobotFiles() override { std::filesystem::remove_all(top_); }

  void write(const std::filesystem::path& name, const std::string& content) const {
    std::filesystem::create_directories((top_ / name).parent_path());
    std::ofstream(top_ / name, std::ios::binary) << content;
  }

  Robot load(const std::string& config) const {
    write("toy/robot.yaml", config);
    return loadRobot(top_ / "toy");
  }

  /// What an action says, without the folder.
  template <typename Action>
  std::string refusalOf(const Action& action) const {
    try {
      action();
    } catch (const InputError& error) {
      std::string message = error.what();
      const std::string folder = top_.string() + "/";
      for (std::size_t at = message.find(folder); at != std::string::npos; at = message.find(folder)) {
        message.erase(at, folder.size());
      }
      return message;
    }
    return "nothing was thrown";
  }
  std::string refusal(const std::string& from, const std::string& to) const {
    return refusalOf([&] { load(with(kConfig, from, to)); });
  }

  std::filesystem::path top_;
};

/// Index of the link, joint or arm of that name, -1 when there is none.
template <typename Items>
int indexOf(const Items& items, const std::string& name) {
  for (std::size_t i = 0; i < items.size(); ++i) {
    if (items[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

/// Uniform within the limits, continuous joints within a turn; `stream` tells question and present posture apart.
inline Eigen::VectorXd randomPosture(const ArmChain& chain, std::uint64_t seed, std::uint64_t stream = 0) {
  Eigen::VectorXd q(chain.size());
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const ArmChain::Step& step = chain.steps[i];
    const bool limited = std::isfinite(step.upper - step.lower);
    const double lower = limited ? step.lower : -std::numbers::pi;
    const double upper = limited ? step.upper : std::numbers::pi;
    q[i] = lower + (upper - lower) * RandomStream(seed).child(stream).uniform(static_cast<std::uint64_t>(i));
  }
  return q;
}

}  // namespace handhold::testing
