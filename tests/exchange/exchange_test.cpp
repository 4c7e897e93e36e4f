// What is exported reads back as the same grasps of the same hand, and files of others are read or refused in words.
#include "core/error.h"
#include "core/file.h"
#include "core/random.h"
#include "exchange/export_set.h"
#include "exchange/grasp_file.h"
#include "store/hdf5_file.h"
#include "support/toy_box_set.h"

#include <filesystem>
#include <fstream>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class Exchange : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) /
              (std::string("exchange_") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "turned");
    hand_ = turnedJaw();
    Database(folder_ / "db").write(testing::toyBoxSet(hand_));
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// The shipped jaw with a palm frame that is turned in the root link, and a tool centre point beside its axis: what
  /// is taken for something else shows.
  Hand turnedJaw() const {
    const fs::path shipped = fs::path(HANDHOLD_SOURCE_DIR) / "hands/jaw";
    fs::copy_file(shipped / "jaw.urdf", folder_ / "turned/jaw.urdf");
    std::string config = readFile(shipped / "hand.yaml");
    const auto replace = [&](const std::string& from, const std::string& to) {
      ASSERT_NE(config.find(from), std::string::npos);
      config.replace(config.find(from), from.size(), to);
    };
    replace("closing: [1, 0, 0]", "closing: [0, 1, 0]");
    replace("[0, 0, 0.1034]", "[0.01, 0.02, 0.1034]");
    write("turned/hand.yaml", config);
    return loadHand((folder_ / "turned").string());
  }

  std::string write(const std::string& name, const std::string& content) const {
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return (folder_ / name).string();
  }

  ExportedSet exported() const { return loadExportedSet(Database(folder_ / "db").query(GraspQuery{}).sets.at(0)); }

  /// The file with the grasps, on the disk.
  std::string exportTo(ExportFormat format, GraspFrame frame) const {
    const ExportedFile file = exportSet(exported(), format, frame).back();
    return write(file.name, file.content);
  }

  void expectRefused(const std::string& name, const std::string& content, const std::string& message) const {
    const std::string path = write(name, content);
    try {
      givenGrasps(readGraspFile(path), hand_, {});
      ADD_FAILURE() << "accepted, want: " << message;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(message));
      EXPECT_THAT(error.what(), ::testing::StartsWith(path));
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }

  fs::path folder_;
  Hand hand_;
};

TEST_F(Exchange, PosesOfEveryFormatAndFrameReadBackAsTheSame) {
  const ExportedSet original = exported();
  ASSERT_EQ(original.found.grasps.size(), 26U);
  for (const ExportFormat format : {ExportFormat::acronym, ExportFormat::isaac}) {
    for (const GraspFrame frame : {GraspFrame::root, GraspFrame::tcp}) {
      SCOPED_TRACE(static_cast<int>(format) * 10 + static_cast<int>(frame));
      GivenGraspOptions options;
      options.frame = frame;
      const GraspFile file = readGraspFile(exportTo(format, frame));
      const GivenGrasps given = givenGrasps(file, hand_, options);
      ASSERT_EQ(given.grasps.size(), original.found.grasps.size());
      EXPECT_EQ(file.failed, 0U);
      EXPECT_EQ(given.otherPregrasp, 0U);
      for (std::size_t i = 0; i < given.grasps.size(); ++i)
        EXPECT_TRUE(given.grasps[i].X_OH.isApprox(original.found.grasps[i].X_OH, 1e-9)) << i;
    }
  }
}

// A frame that is taken for another must not pass the test above.
TEST_F(Exchange, FramesDiffer) {
  const ExportedSet set = exported();
  const auto root = framePoses(set, GraspFrame::root, RootAxes::link)[3];
  const auto palm = framePoses(set, GraspFrame::root, RootAxes::palm)[3];
  const auto tcp = framePoses(set, GraspFrame::tcp, RootAxes::link)[3];
  EXPECT_EQ(root.translation(), palm.translation());
  EXPECT_NEAR((root.linear().transpose() * palm.linear()).col(0).y(), 1, 1e-9);  // +x closing is +y of the root
  EXPECT_NEAR((root.inverse() * tcp.translation() - Eigen::Vector3d(0.01, 0.02, 0.1034)).norm(), 0, 1e-9);
  EXPECT_TRUE(tcp.linear().isApprox(palm.linear(), 1e-12));
}

TEST_F(Exchange, JointsOfIsaacFixThePosture) {
  const ExportedSet original = exported();
  const GraspFile file = readGraspFile(exportTo(ExportFormat::isaac, GraspFrame::root));
  EXPECT_THAT(file.grasps[0].jointPosition, ElementsAre(std::pair(std::string("finger_1"), 0.02500000037252903)));
  const GivenGrasps given = givenGrasps(file, hand_, {});
  for (std::size_t i = 0; i < given.grasps.size(); ++i)
    EXPECT_TRUE(given.grasps[i].jointPosition.isApprox(original.found.grasps[i].jointPosition, 1e-9));
  GivenGraspOptions close;
  close.close = true;
  EXPECT_EQ(givenGrasps(file, hand_, close).grasps[0].jointPosition.size(), 0);
}

// The distal joints of these fingers stop where they like: active joints alone do not say where.
TEST_F(Exchange, BreakawayJointsThatAreNotGivenLeaveThePostureOpen) {
  const Hand barrett = loadHand(std::string(HANDHOLD_SOURCE_DIR) + "/hands/barrett");
  GraspFile file;
  FileGrasp& grasp = file.grasps.emplace_back();
  grasp.jointPosition = {{"finger_1", 1}, {"finger_2", 1}, {"finger_3", 1}, {"spread", 0}};
  EXPECT_EQ(givenGrasps(file, barrett, {}).grasps[0].jointPosition.size(), 0);
  for (const char* distal : {"finger_1_distal", "finger_2_distal", "finger_3_distal"})
    grasp.jointPosition[distal] = 0.7;
  const Eigen::VectorXd posture = givenGrasps(file, barrett, {}).grasps[0].jointPosition;
  ASSERT_EQ(posture.size(), static_cast<Eigen::Index>(barrett.joints.size()));
  for (std::size_t i = 0; i < barrett.joints.size(); ++i) {
    const bool isDistal = barrett.joints[i].name.ends_with("_distal");
    if (isDistal) {
      EXPECT_EQ(posture[static_cast<Eigen::Index>(i)], 0.7);
    }
  }
}

TEST_F(Exchange, PregraspPicksTheNearestPreshape) {
  GraspFile file;
  file.grasps.resize(3);
  file.grasps[0].pregraspPosition = {{"finger_1", 0.0251}};
  file.grasps[2].pregraspPosition = {{"finger_1", 0.035}};
  GivenGrasps given = givenGrasps(file, hand_, {});
  EXPECT_EQ(given.grasps[0].preshape, 1);  // open_50
  EXPECT_EQ(given.grasps[1].preshape, 0);
  EXPECT_EQ(given.grasps[2].preshape, 0);
  EXPECT_EQ(given.otherPregrasp, 1U);
  given.grasps.resize(1);
  Hand hand = hand_;
  keepUsedPreshapes(hand, given.grasps);
  ASSERT_EQ(hand.preshapes.size(), 1U);
  EXPECT_EQ(hand.preshapes[0].name, "open_50");
  EXPECT_EQ(given.grasps[0].preshape, 0);
}

TEST_F(Exchange, GraspGenIsRead) {
  const GraspFile file = readGraspFile(write("a.json", R"({"object": {"file": "x.obj", "scale": 0.5}, "grasps": {
    "transforms": [[[1,0,0,9],[0,1,0,9],[0,0,1,9],[0,0,0,1]], [[0,-1,0,1],[1,0,0,2],[0,0,1,3],[0,0,0,1]]],
    "object_in_gripper": [false, true]}})"));
  EXPECT_EQ(file.format, "graspgen");
  EXPECT_EQ(file.objectScale, 0.5);
  EXPECT_EQ(file.failed, 1U);
  ASSERT_EQ(file.grasps.size(), 1U);
  EXPECT_EQ(file.grasps[0].X_OF.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE((file.grasps[0].X_OF.linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY()));
}

TEST_F(Exchange, BadFilesAreRefused) {
  const std::string isaac = "format: isaac_grasp\nformat_version: 1.0\ngrasps:\n  grasp_0:\n    position: [0, 0, 0]\n";
  const std::string turn = "    orientation: {w: 1, xyz: [0, 0, 0]}\n";
  expectRefused("a.txt", "", "ends with \".txt\", want .h5 (ACRONYM)");
  expectRefused("a.yaml", "format: other\n", ":1: format is \"other\", want isaac_grasp");
  expectRefused("a.yaml", "format: isaac_grasp\nformat_version: \"2.0\"\n", ":2: format_version is \"2.0\", want 1.0");
  expectRefused("a.yaml", isaac, ":4: grasps.grasp_0 has no key \"orientation\", want one");
  expectRefused("a.yaml", isaac + "    orientation: {w: 1, xyz: [1, 0, 0]}\n", "orientation is not of length 1");
  expectRefused("a.yaml", isaac + "    orientation: [1, 0, 0, 0]\n", "orientation is a list of 4, want a map");
  expectRefused("a.yaml", isaac + turn + "    cspace_position: {thumb: 0}\n",
                "grasps.grasp_0 has joint \"thumb\", want");
  expectRefused("a.yaml", isaac + turn + "    cspace_position: {finger_1: 0.1}\n",
                "finger_1 at 0.1, want it within 0 ..");
  expectRefused("a.yaml", isaac + turn + "    confidence: 0.0\n", "holds no grasp but 1 that it marks as failed");
  expectRefused("a.json", "{", "is no valid JSON");
  expectRefused("a.json", R"({"grasps": {"transforms": [1e999]}})", "is no valid JSON");
  expectRefused("a.json", "[]", "the file is a list of 0, want a map");
  expectRefused("a.json", R"({"grasps": {"transforms": []}})", "holds no grasp");
  expectRefused("a.json", R"({"grasps": {"transforms": [[1]]}})",
                "grasps.transforms[0] is a list of 1, want four lists");
  expectRefused("a.json", R"({"object": {"scale": -1}, "grasps": {"transforms": []}})",
                "object.scale is -1, want a number");
  const auto matrix = [](const std::string& rows) { return R"({"grasps": {"transforms": [)" + rows + "]}}"; };
  expectRefused("a.json", matrix("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,0,0,1]]"), "whose last row is [5, 0, 0, 1]");
  expectRefused("a.json", matrix("[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]"), "a matrix that mirrors");
  expectRefused("a.json", matrix("[[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "also scales or shears");
  expectRefused("a.json", matrix("[[1,0,0,\"a\"],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"),
                "transforms[0][0][3] is \"a\", want");
  expectRefused("a.h5", "no HDF5 at all", "cannot be opened by HDF5");
}

// Files that were cut short or damaged are read, or refused with InputError.
TEST_F(Exchange, DamagedFilesEndInWords) {
  const ExportedSet set = exported();
  const std::string json = R"({"object": {"scale": 0.5}, "grasps": {"transforms": [
    [[1,0,0,9],[0,1,0,9],[0,0,1,9],[0,0,0,1]]], "object_in_gripper": [true]}})";
  const std::pair<std::string, std::string> files[] = {{"a.yaml", isaacText(set, GraspFrame::root)},
                                                       {"a.json", json},
                                                       {"a.h5", acronymFile(set, GraspFrame::root, "a.obj")}};
  const RandomStream random(5);
  std::size_t refused = 0;
  for (const auto& [name, whole] : files) {
    const bool mayFlip = name != "a.h5";  // HDF5 is not safe on flipped bits
    for (std::uint64_t i = 0; i < 100; ++i) {
      SCOPED_TRACE(name + " " + std::to_string(i));
      std::string content = whole;
      const auto at = static_cast<std::size_t>(random.child(i).uniform(0) * static_cast<double>(whole.size()));
      if (mayFlip && i % 2 == 0) {
        content[at] = static_cast<char>(random.child(i).bits(1));
      } else {
        content.resize(at);
      }
      try {
        givenGrasps(readGraspFile(write(name, content)), hand_, {});
      } catch (const InputError& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
        ++refused;
      }
    }
  }
  EXPECT_GT(refused, 150U);
}

TEST_F(Exchange, BadAcronymFilesAreRefused) {
  const auto file = [](const std::function<void(Hdf5Builder&)>& fill) {
    Hdf5Builder builder(0);
    builder.addGroup("/grasps");
    fill(builder);
    return builder.image();
  };
  const std::vector<double> one = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  expectRefused("a.h5", file([](auto&) {}), "/grasps/transforms is missing");
  expectRefused("a.h5", file([&](auto& h) { h.addArray("/grasps/transforms", {16}, one); }),
                "shape (16), want (n, 4, 4)");
  expectRefused("a.h5", file([](auto& h) { h.addText("/grasps/transforms", "x"); }), "is of type text, want numbers");
  expectRefused("a.h5", file([&](auto& h) {
                  h.addArray("/grasps/transforms", {1, 4, 4}, one);
                  h.addGroup("/object");
                  h.addArray("/object/scale", {}, std::vector<double>{0});
                }),
                "/object/scale is 0, want one number > 0");
  expectRefused("a.h5", file([&](auto& h) {
                  h.addArray("/grasps/transforms", {1, 4, 4}, one);
                  h.addGroup("/grasps/qualities");
                  h.addGroup("/grasps/qualities/flex");
                  h.addArray("/grasps/qualities/flex/object_in_gripper", {2}, std::vector<float>{1, 1});
                }),
                "object_in_gripper has shape (2), want (1)");
  expectRefused("a.h5", file([&](auto& h) {
                  std::vector<double> bad = one;
                  bad[3] = std::numeric_limits<double>::quiet_NaN();
                  h.addArray("/grasps/transforms", {1, 4, 4}, bad);
                }),
                "/grasps/transforms[0] is not finite");
}

}  // namespace
}  // namespace handhold
