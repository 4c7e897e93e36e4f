// What a set records is enough to compute it again, bit for bit, and a number that was changed is found.
#include "build/build_job.h"
#include "build/build_set.h"
#include "build/verify_set.h"
#include "core/error.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using State = VerifyReport::State;
using testing::ElementsAre;
using testing::HasSubstr;

class Verify : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) /
              (std::string("verify_") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// The set that a job builds.
  fs::path build(const std::string& hand, const std::string& mesh, const std::string& sampling,
                 const std::string& top = "") const {
    const std::string source = HANDHOLD_SOURCE_DIR;
    std::ofstream(folder_ / "job.yaml") << "catalog: [{name: part, mesh: " << mesh << ", unit: m, friction: 0.6}]\n"
                                        << "hands: [" << source << "/hands/" << hand << "]\n"
                                        << "sampling: {rolls: 3, " << sampling << "}\n"
                                        << top;
    const Job job = loadJob((folder_ / "job.yaml").string());
    BuildOptions options;
    options.threads = 2;
    options.progress = ProgressMode::none;
    const auto reports = buildJob(job, loadHands(job), Database(folder_ / "db"), options, never_);
    EXPECT_EQ(reports[0].state, SetReport::State::built) << reports[0].error;
    return reports[0].summary.path;
  }
  static std::string shipped(const std::string& mesh) { return std::string(HANDHOLD_SOURCE_DIR) + "/meshes/" + mesh; }

  VerifyReport verify(const fs::path& path, std::size_t sample = 100000) {
    const auto report = verifier_.verify(path, sample, never_);
    EXPECT_TRUE(report);
    return report.value_or(VerifyReport{});
  }

  /// The set again with something changed, as its next version.
  template <class Change>
  fs::path changed(const fs::path& path, const Change& change) const {
    GraspSet set = readGraspSet(path);
    change(set);
    return Database(folder_ / "db").write(set);
  }

  fs::path folder_;
  SetVerifier verifier_;
  const std::atomic<bool> never_{false};
};

TEST_F(Verify, EveryGraspAndTrialIsRecomputed) {
  const fs::path path = build("barrett", shipped("mug.obj"), "samples: 12", "distance_map: {neighbors: 3}\n");
  fs::remove(folder_ / "job.yaml");  // nothing but the record is used
  const VerifyReport report = verify(path);
  EXPECT_EQ(report.state, State::good);
  const GraspSet set = readGraspSet(path);
  EXPECT_EQ(report.grasps, set.graspCount());
  EXPECT_GT(report.grasps, 3U);
  EXPECT_EQ(report.trials, set.trialCount());
}

// A jaw that centres itself, a part of the preshapes, a pitch, some grasps kept.
TEST_F(Verify, OtherSettingsAreInTheRecordToo) {
  const fs::path path = build("jaw", shipped("t_bar.ply"), "pitch: 0.02, preshapes: [open_80]",
                              "quality: {contact_distance: 0.0004, cone_edges: 6, load_margin: {grasps: 4},\n"
                              "  robustness: {position: 0.002, rotation_deg: 2, trials: 5, grasps: 3}}\n"
                              "keep: {top: 5, diverse: true}\n");
  EXPECT_FALSE(std::isnan(readGraspSet(path).robustness[2]));
  const VerifyReport report = verify(path);
  EXPECT_THAT(report.reason, "");
  EXPECT_EQ(report.state, State::good);
  EXPECT_EQ(report.grasps, 5U);
}

TEST_F(Verify, ReferenceAndCenterOfMass) {
  const fs::path path =
      build("jaw", shipped("t_bar.ply"), "samples: 10, policy: center_of_mass", "simulation: reference\n");
  const VerifyReport report = verify(path);
  EXPECT_EQ(report.state, State::good);
  EXPECT_EQ(report.trials, readGraspSet(path).trialCount());
}

// An open scan was oriented and welded on loading; the record has what came out.
TEST_F(Verify, RepairedMeshes) {
  std::ifstream in(shipped("box.stl"), std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, 4);
  count -= count / 10;  // the last triangles are missing
  std::memcpy(bytes.data() + 80, &count, 4);
  bytes.resize(84 + 50 * static_cast<std::size_t>(count));
  const std::string open = (folder_ / "open.stl").string();
  std::ofstream(open, std::ios::binary) << bytes;
  const fs::path path = build("jaw", open, "samples: 8");
  EXPECT_FALSE(readGraspSet(path).watertight);
  EXPECT_EQ(verify(path).state, State::good);
}

TEST_F(Verify, ChangedNumbersAreFound) {
  const fs::path path = build("jaw", shipped("t_bar.ply"), "samples: 12");
  ASSERT_GT(readGraspSet(path).graspCount(), 2U);
  const auto mismatchOf = [&](const auto& change) {
    const VerifyReport report = verify(changed(path, change));
    EXPECT_EQ(report.state, State::differs);
    return report.mismatches.empty() ? VerifyReport::Mismatch{} : report.mismatches[0];
  };
  const auto pose = mismatchOf([](GraspSet& set) { set.handPose[7 + 2] = 0.125; });
  EXPECT_EQ(pose.where, "/grasps/hand_pose of grasp 1");
  EXPECT_EQ(pose.stored, "0.125");
  EXPECT_NE(pose.recomputed, "0.125");
  const auto joint =
      mismatchOf([](GraspSet& set) { set.jointPosition[0] = std::nextafter(set.jointPosition[0], 9.F); });
  EXPECT_EQ(joint.where, "/grasps/joint_position of grasp 0");
  EXPECT_EQ(mismatchOf([](GraspSet& set) { set.contactLink[0] ^= 1; }).where, "/contacts/link of grasp 0");
  EXPECT_EQ(mismatchOf([](GraspSet& set) { set.mapWeight[0] *= 0.5F; }).where, "/distance_map/weight of grasp 0");
  EXPECT_EQ(mismatchOf([](GraspSet& set) { set.epsilonUpper[1] *= 1.5; }).where, "/grasps/epsilon_upper of grasp 1");
  const auto outcome = mismatchOf([](GraspSet& set) {
    for (std::uint8_t& value : set.outcome) value = value == 1 ? 2 : value;
  });
  EXPECT_THAT(outcome.where, HasSubstr("/trials/outcome of trial "));
  EXPECT_EQ(outcome.stored, "too_few_contacts");
  EXPECT_EQ(outcome.recomputed, "not_force_closed");
  // What everything else hangs on.
  EXPECT_EQ(mismatchOf([](GraspSet& set) { set.torqueScale *= 2; }).where, "/@torque_scale");
  EXPECT_EQ(mismatchOf([](GraspSet& set) { set.samplePoint[4] += 1e-3F; }).where, "/samples/point");
  EXPECT_THAT(mismatchOf([](GraspSet& set) { set.config = "urdf: x\n"; }).where, HasSubstr("the stored hand.yaml"));
}

// One force-closed trial that is no longer stored as such.
TEST_F(Verify, AGraspThatIsNoneIsFound) {
  const fs::path path = build("jaw", shipped("t_bar.ply"), "samples: 12");
  const auto report = verify(changed(path, [](GraspSet& set) {
    for (std::size_t i = 0; i < set.outcome.size(); ++i) {  // the last grasp claims a trial that is none
      if (set.outcomeNames[set.outcome[i]] != "not_force_closed") continue;
      const std::size_t row = set.graspCount() - 1, m = set.preshapes, r = set.rolls;
      set.trial[3 * row] = static_cast<std::uint32_t>(i / (m * r));
      set.trial[3 * row + 1] = static_cast<std::uint32_t>(i / m % r);
      set.trial[3 * row + 2] = static_cast<std::uint32_t>(i % m);
      return;
    }
  }));
  ASSERT_EQ(report.state, State::differs);
  EXPECT_THAT(report.mismatches[0].where, HasSubstr("/grasps/trial of grasp"));
  EXPECT_EQ(report.mismatches[0].recomputed, "not_force_closed");
}

TEST_F(Verify, OtherMethodsAreToldAndNotRecomputed) {
  const fs::path path = build("jaw", shipped("t_bar.ply"), "samples: 4");
  const auto older = verify(changed(path, [](GraspSet& set) { set.methodVersion = kMethodVersion - 1; }));
  EXPECT_EQ(older.state, State::notRecomputed);
  EXPECT_THAT(older.reason, HasSubstr("made by version " + std::to_string(kMethodVersion - 1)));
  const auto oldest = verify(changed(path, [](GraspSet& set) { set.methodVersion = 0; }));
  EXPECT_EQ(oldest.state, State::notRecomputed);
  EXPECT_THAT(oldest.reason, HasSubstr("before sets recorded"));
}

TEST_F(Verify, DamageAndWrongPlacesAreFoundWithoutASample) {
  const fs::path path = build("jaw", shipped("t_bar.ply"), "samples: 4");
  EXPECT_EQ(verify(path, 0).state, State::good);
  EXPECT_EQ(verify(path, 0).grasps, 0U);
  fs::copy_file(path, path.parent_path() / "v0002.h5");
  const auto moved = verify(path.parent_path() / "v0002.h5", 0);
  EXPECT_EQ(moved.state, State::damaged);
  EXPECT_THAT(moved.reason, HasSubstr("holds part x jaw, version 1, want it at "));
  std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
  file.seekp(5000);
  file.put('!');
  file.close();
  EXPECT_EQ(verify(path, 0).state, State::damaged);
}

TEST_F(Verify, StopsWhenAsked) {
  const fs::path path = build("jaw", shipped("t_bar.ply"), "samples: 4");
  const std::atomic<bool> always{true};
  EXPECT_FALSE(verifier_.verify(path, 5, always));
}

}  // namespace
}  // namespace handhold
