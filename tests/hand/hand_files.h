#pragma once

#include "core/error.h"
#include "hand/hand.h"

#include <filesystem>
#include <fstream>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace handhold::test {

/// `text` with the first occurrence of `from` replaced; a test that replaces nothing has a typing error.
inline std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t position = text.find(from);
  EXPECT_NE(position, std::string::npos) << "\"" << from << "\" is not in the text";
  if (position != std::string::npos) text.replace(position, from.size(), to);
  return text;
}

inline std::string revolute(const std::string& name, const std::string& parent, const std::string& child,
                            const std::string& rest) {
  return fmt::format(
      "<joint name=\"{}\" type=\"revolute\"><parent link=\"{}\"/><child link=\"{}\"/>{}<axis xyz=\"0 1 0\"/>"
      "<limit lower=\"-0.5\" upper=\"1.5\" effort=\"2\" velocity=\"1\"/></joint>\n",
      name, parent, child, rest);
}

inline std::string boxLink(const std::string& name, const std::string& size) {
  return fmt::format("<link name=\"{}\"><collision><geometry><box size=\"{}\"/></geometry></collision></link>\n", name,
                     size);
}

/// A palm, a finger of two coupled links that bend about y, and a slide of its own.
inline std::string goodUrdf() {
  return "<robot name=\"test\">\n" + boxLink("base", "0.1 0.1 0.02") + boxLink("proximal", "0.04 0.01 0.01") +
         boxLink("distal", "0.03 0.01 0.01") + boxLink("slider", "0.01 0.01 0.01") +
         revolute("bend", "base", "proximal", "<origin xyz=\"0.05 0 0.01\"/>") +
         revolute("bend_2", "proximal", "distal",
                  "<origin xyz=\"0.04 0 0\"/><mimic joint=\"bend\" multiplier=\"0.5\" offset=\"0.1\"/>") +
         "<joint name=\"slide\" type=\"prismatic\"><parent link=\"base\"/><child link=\"slider\"/>"
         "<axis xyz=\"0 0 1\"/><limit lower=\"0\" upper=\"0.04\" effort=\"9\" velocity=\"1\"/></joint>\n</robot>\n";
}

// Lines matter: the tests of refusals name them.
inline const std::string kGoodConfig =
    "urdf: test.urdf\n"                                                                      // line 1
    "root_link: base\n"                                                                      // 2
    "palm: {link: base, position: [0, 0, 0.01], approach: [0, 0, 1], closing: [1, 0, 0]}\n"  // 3
    "preshapes:\n"                                                                           // 4
    "  - {name: open, joints: {bend: 0.25, slide: 0.01}, standoff: 0.02}\n"                  // 5
    "closing:\n"                                                                             // 6
    "  - {joint: bend, direction: 1, breakaway: bend_2}\n"                                   // 7
    "  - {joint: slide, direction: -1}\n";                                                   // 8

/// A hand's folder `TEMP/.../test_hand`, removed at the end.
class HandFiles : public testing::Test {
 protected:
  HandFiles() {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    top_ = std::filesystem::path(testing::TempDir()) /
           fmt::format("handhold-{}-{}-{}", info->test_suite_name(), info->name(), ::getpid());
    folder_ = top_ / "test_hand";
    std::filesystem::create_directories(folder_);
  }
  ~HandFiles() override { std::filesystem::remove_all(top_); }

  void write(const std::filesystem::path& name, const std::string& content) const {
    std::filesystem::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << content;
  }

  Hand load(const std::string& urdf, const std::string& config = kGoodConfig, const PackagePaths& packages = {}) const {
    write("test.urdf", urdf);
    write("hand.yaml", config);
    return loadHand(folder_, packages);
  }

  /// What loading says, without the folder.
  std::string refusal(const std::string& urdf, const std::string& config = kGoodConfig,
                      const PackagePaths& packages = {}) const {
    try {
      load(urdf, config, packages);
    } catch (const InputError& error) {
      std::string message = error.what();
      const std::string folder = folder_.string() + "/";
      for (std::size_t at = message.find(folder); at != std::string::npos; at = message.find(folder)) {
        message.erase(at, folder.size());
      }
      return message;
    }
    return "nothing was thrown";
  }
  std::string configRefusal(const std::string& from, const std::string& to) const {
    return refusal(goodUrdf(), with(kGoodConfig, from, to));
  }
  std::string urdfRefusal(const std::string& from, const std::string& to) const {
    return refusal(with(goodUrdf(), from, to));
  }

  std::filesystem::path top_, folder_;
};

/// Index of the link or joint of that name, -1 when there is none.
template <typename Items>
int indexOf(const Items& items, const std::string& name) {
  for (std::size_t i = 0; i < items.size(); ++i) {
    if (items[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

}  // namespace handhold::test
