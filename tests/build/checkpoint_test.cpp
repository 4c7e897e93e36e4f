#include "build/checkpoint.h"

#include "build/build_job.h"
#include "build/build_set.h"
#include "store/database.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

class CheckpointTest : public ::testing::Test {
 protected:
  CheckpointTest() {
    std::string name = (fs::temp_directory_path() / "handhold_checkpoint_XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
  }
  ~CheckpointTest() override { fs::remove_all(folder_); }

  /// Two samples of three trials, one of which is a grasp.
  static std::vector<SampleResults> someResults() {
    std::vector<SampleResults> samples(2);
    for (SampleResults& sample : samples) {
      sample.outcome = {0, 1, 2};
      sample.epsilon = {0.1F, 0, std::nanf("")};
      sample.byReference = 2;
      sample.seconds.policy = 0.25;
    }
    KeptGrasp grasp;
    grasp.trial = 3;
    grasp.epsilon = 0.1;
    grasp.X_OH = Eigen::Translation3d(1, 2, 3) * Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY());
    grasp.approachClear = true;
    grasp.jointPosition = Eigen::Vector3d(0.1, 0.2, 0.3);
    grasp.contacts = {{{1, 2, 3}, {0, 0, 1}, 7}, {{4, 5, 6}, {0, 1, 0}, 8}};
    grasp.centering = {0.01, 0, 0};
    samples[1].grasps = {grasp};
    return samples;
  }

  fs::path folder_;
};

TEST_F(CheckpointTest, ReadsWhatWasWritten) {
  const Checkpoint checkpoint(folder_, "abc");
  std::vector<SampleResults> written = someResults(), read(2);
  EXPECT_FALSE(checkpoint.read(4, 3, read));
  checkpoint.write(4, written);
  ASSERT_TRUE(checkpoint.read(4, 3, read));
  EXPECT_EQ(read[0].outcome, written[0].outcome);
  EXPECT_EQ(read[1].epsilon[0], 0.1F);
  EXPECT_TRUE(std::isnan(read[1].epsilon[2]));
  EXPECT_EQ(read[0].byReference, 2U);
  EXPECT_EQ(read[0].seconds.policy, 0.25);
  ASSERT_EQ(read[1].grasps.size(), 1U);
  const KeptGrasp &a = written[1].grasps[0], &b = read[1].grasps[0];
  EXPECT_EQ(a.trial, b.trial);
  EXPECT_EQ(a.X_OH.matrix(), b.X_OH.matrix());
  EXPECT_EQ(a.approachClear, b.approachClear);
  EXPECT_EQ(a.jointPosition, b.jointPosition);
  EXPECT_EQ(a.centering, b.centering);
  ASSERT_EQ(b.contacts.size(), 2U);
  EXPECT_EQ(b.contacts[1].position, a.contacts[1].position);
  EXPECT_EQ(b.contacts[1].link, 8);
  EXPECT_FALSE(Checkpoint(folder_, "abd").read(4, 3, read));
  checkpoint.remove();
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(CheckpointTest, TakesNothingFromADamagedFile) {
  const Checkpoint checkpoint(folder_, "abc");
  std::vector<SampleResults> samples = someResults(), read(2), three(3);
  checkpoint.write(0, samples);
  EXPECT_FALSE(checkpoint.read(0, 4, read));   // another number of trials
  EXPECT_FALSE(checkpoint.read(0, 3, three));  // of samples
  const fs::path file = folder_ / ".chunks-abc" / "000000";
  const auto size = fs::file_size(file);
  for (std::size_t at : {std::size_t{3}, std::size_t{20}, std::size_t{60}, std::size_t{size - 1}}) {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekg(static_cast<std::streamoff>(at));
    const char byte = static_cast<char>(stream.get() ^ 1);
    stream.seekp(static_cast<std::streamoff>(at));
    stream.put(byte);
    stream.close();
    EXPECT_FALSE(checkpoint.read(0, 3, read)) << at;
    checkpoint.write(0, samples);
  }
  fs::resize_file(file, size / 2);
  EXPECT_FALSE(checkpoint.read(0, 3, read));
  EXPECT_TRUE(read[0].outcome.empty());
}

// A place where nothing can be written costs a warning, not the build.
TEST_F(CheckpointTest, GoesOnWithoutAFolder) {
  std::ofstream(folder_ / "file").put('x');
  const Checkpoint checkpoint(folder_ / "file", "abc");
  std::vector<SampleResults> samples = someResults();
  checkpoint.write(0, samples);
  EXPECT_FALSE(checkpoint.read(0, 3, samples));
}

// Some chunks of an earlier run are there, one is damaged, others are missing: the set is equal to an undisturbed one.
TEST_F(CheckpointTest, ASetIsFinishedFromItsChunks) {
  const std::string source = HANDHOLD_SOURCE_DIR;
  std::ofstream(folder_ / "job.yaml") << "catalog:\n  - {name: box, mesh: " << source << "/meshes/box.stl, unit: m}\n"
                                      << "hands: [" << source << "/hands/jaw]\n"
                                      << "sampling: {samples: 12, rolls: 3}\nquality: {friction: 0.5}\n";
  const Job job = loadJob((folder_ / "job.yaml").string());
  const std::vector<Hand> hands = loadHands(job);
  const auto fields = makeHandFields(hands[0]);
  const SampledObject object = loadSampledObject(job, job.catalog[0]);
  const std::atomic<bool> never{false};
  const std::size_t perChunk = 2 * 3 * hands[0].preshapes.size();  // two samples
  const auto build = [&](const fs::path& folder, int threads) {
    BuildCounters counters;
    auto set = buildSet(job, object, hands[0], "abc", fields, Checkpoint(folder, "abc", perChunk), JobSystem(threads),
                        counters, never);
    EXPECT_EQ(counters.trials, set->trialCount());
    return *set;
  };
  const GraspSet undisturbed = build(folder_ / "none", 2);
  ASSERT_GT(undisturbed.graspCount(), 0U);
  const GraspSet first = build(folder_, 1);
  const fs::path chunks = folder_ / ".chunks-abc";
  EXPECT_TRUE(fs::exists(chunks / "000000"));

  const GraspSet whole = build(folder_, 2);  // nothing is left to run
  EXPECT_EQ(whole.seconds.at("policy"), first.seconds.at("policy"));
  EXPECT_EQ(firstDifference(whole, undisturbed), "");

  fs::remove(chunks / "000001");
  fs::resize_file(chunks / "000002", 100);
  const GraspSet resumed = build(folder_, 3);
  EXPECT_NE(resumed.seconds.at("policy"), first.seconds.at("policy"));
  EXPECT_EQ(firstDifference(resumed, undisturbed), "");
}

}  // namespace
}  // namespace handhold
