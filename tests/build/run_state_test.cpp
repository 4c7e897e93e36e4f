// What a run keeps beside the sets: time limits, records of failures, hashes of meshes, rates for estimates.
#include "build/estimate.h"
#include "build/failures.h"
#include "build/mesh_hashes.h"
#include "build/time_limit.h"
#include "core/hash.h"
#include "store/synthetic_set.h"

#include <chrono>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using testing::HasSubstr;

bool becomesTrue(const std::atomic<bool>& flag) {
  const auto end = std::chrono::steady_clock::now() + 20s;
  while (!flag && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(1ms);
  return flag;
}

TEST(TimeLimits, PassAndFollowTheCancelFlag) {
  std::atomic<bool> cancel{false};
  const TimeLimit none(cancel, 0);
  EXPECT_EQ(&none.flag(), &cancel);
  const TimeLimit brief(cancel, 0.01);
  EXPECT_TRUE(becomesTrue(brief.flag()));
  EXPECT_TRUE(brief.expired());
  const TimeLimit endless(cancel, 1e300);
  EXPECT_FALSE(endless.flag());
  cancel = true;
  EXPECT_TRUE(becomesTrue(endless.flag()));
  EXPECT_FALSE(endless.expired());
}

TEST(Failures, AreReadBackAndRemoved) {
  const TestFolder folder;
  const Database database(folder.path());
  EXPECT_FALSE(readFailure(database, "mug", "jaw"));
  const FailureRecord record{"mug", "jaw", "a \"reason\" with \xff in it", "handhold build x", "00ff", true, 2.5};
  writeFailure(database, record);
  const auto copy = readFailure(database, "mug", "jaw");
  ASSERT_TRUE(copy);
  EXPECT_THAT(copy->error, HasSubstr("a \"reason\" with "));
  EXPECT_EQ(copy->command, record.command);
  EXPECT_EQ(copy->inputHash, record.inputHash);
  EXPECT_TRUE(copy->knownBad);
  EXPECT_EQ(copy->timeout, 2.5);
  EXPECT_FALSE(readFailure(database, "mug", "barrett"));
  for (const char* nonsense : {"", "[{}, 3]", "{\"object\": 1}", "\xff\xfe"}) {
    writeBytes(folder.path() / "mug" / "jaw" / "failed.json", nonsense);
    EXPECT_FALSE(readFailure(database, "mug", "jaw")) << nonsense;
  }
  removeFailure(database, "mug", "jaw");
  removeFailure(database, "mug", "jaw");
  EXPECT_TRUE(fs::is_empty(folder.path() / "mug" / "jaw"));
}

TEST(Failures, AreKnownWhileTheInputsAreTheSame) {
  FailureRecord record{"mug", "jaw", "reason", "command", "00ff", true, 0};
  EXPECT_TRUE(isKnownBad(record, "00ff", 0));
  EXPECT_TRUE(isKnownBad(record, "00ff", 60));
  EXPECT_FALSE(isKnownBad(record, "00fe", 0));
  record.timeout = 10;
  EXPECT_TRUE(isKnownBad(record, "00ff", 10));
  EXPECT_TRUE(isKnownBad(record, "00ff", 5));
  EXPECT_FALSE(isKnownBad(record, "00ff", 11));
  EXPECT_FALSE(isKnownBad(record, "00ff", 0));
  record.knownBad = false;
  EXPECT_FALSE(isKnownBad(record, "00ff", 10));
}

class MeshHashTest : public testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& bytes) const {
    writeBytes(folder_.path() / name, bytes);
    return folder_.path() / name;
  }

  TestFolder folder_;
};

TEST_F(MeshHashTest, FollowsTheContent) {
  MeshHashes hashes(folder_.path() / "db", 0);
  const fs::path path = write("a.stl", "one");
  const std::string one = hashes.of(path);
  EXPECT_EQ(one, meshHash(path));
  EXPECT_EQ(hashes.of(path), one);
  const auto time = fs::last_write_time(path);
  writeBytes(path, "two");  // as long, and the old time is put back
  fs::last_write_time(path, time);
  EXPECT_NE(hashes.of(path), one);
  EXPECT_EQ(hashes.of(folder_.path() / "none"), "");
  EXPECT_EQ(meshHash(folder_.path()), "");
}

// A file that was just written could be written again within one tick of its clock.
TEST_F(MeshHashTest, RemembersSettledFilesAlone) {
  const fs::path db = folder_.path() / "db", fresh = write("fresh.stl", "x");
  MeshHashes careful(db);
  careful.of(fresh);
  careful.save();
  EXPECT_FALSE(fs::exists(db));
  MeshHashes hashes(db, 0);
  hashes.of(fresh);
  hashes.save();
  const std::string text = bytesOf(db / "mesh-hashes.txt");
  EXPECT_THAT(text, HasSubstr(fresh.string()));

  // What is remembered is used: a false hash under a true checksum comes back.
  const std::string hash = meshHash(fresh), other(32, '0');
  std::string forged = text.substr(0, text.size() - 33);
  forged.replace(forged.find(hash), 32, other);
  writeBytes(db / "mesh-hashes.txt", forged + hashBytes(forged.data(), forged.size()) + "\n");
  EXPECT_EQ(MeshHashes(db).of(fresh), other);
  writeBytes(db / "mesh-hashes.txt", forged + hash + "\n");  // damaged: counts as empty
  EXPECT_EQ(MeshHashes(db).of(fresh), hash);
  for (const char* nonsense : {"", "\n", "x", "handhold mesh hashes 1\n"}) {
    writeBytes(db / "mesh-hashes.txt", nonsense);
    EXPECT_EQ(MeshHashes(db).of(fresh), hash);
  }
}

Job jobOf(std::size_t samples, std::size_t keepTop) {
  Job job;
  job.samples = samples;
  job.rolls = 4;
  job.keepTop = keepTop;
  return job;
}

Hand handOf(const std::string& name) {
  Hand hand;
  hand.name = name;
  hand.preshapes.resize(2);
  return hand;
}

// Twice as many trials as in the sets that are there, for three sets of this hand and none of the other's.
TEST(Estimates, ComeFromTheHandsOwnSets) {
  const TestFolder folder;
  const Database database(folder.path());
  GraspSet set = syntheticSet({.samples = 100, .rolls = 4, .preshapes = 2, .grasps = 160});
  set.seconds = {{"load", 1}, {"policy", 6}, {"bounds", 2}, {"fields", 3}};
  const double bytes = static_cast<double>(fs::file_size(database.write(set)));
  std::vector<PlannedSet> plan;
  for (const char* object : {"a", "b", "c"})
    plan.push_back({object, "three-finger", PlannedSet::State::missing, 1600, ""});
  plan.push_back({"mug", "three-finger", PlannedSet::State::done, 1600, ""});
  plan.push_back({"d", "three-finger", PlannedSet::State::failed, 1600, ""});
  const std::vector<Hand> hands = {handOf("three-finger"), handOf("jaw")};
  const auto estimates = estimateCost(jobOf(200, 0), hands, database, plan);
  ASSERT_EQ(estimates.size(), 1U);
  const HandEstimate& e = estimates[0];
  EXPECT_EQ(e.rates.sets, 1U);
  EXPECT_EQ(e.missing, 3U);
  EXPECT_EQ(e.done, 1U);
  EXPECT_EQ(e.failed, 1U);
  EXPECT_EQ(e.trials, 4800);
  EXPECT_NEAR(e.rates.shareForceClosed, 0.2, 1e-12);
  EXPECT_NEAR(3600 * e.coreHours, 3 * (1 + 16) + 3, 1e-9);
  const double fixed = e.rates.bytesPerSet;
  // The map of a synthetic set does not grow with it: its 480 bytes count as the samples'.
  EXPECT_NEAR(1e9 * e.gigabytes, 3 * (fixed + 2 * (bytes - fixed)), 1);
  const auto kept = estimateCost(jobOf(200, 20), hands, database, plan);
  EXPECT_NEAR(1e9 * (e.gigabytes - kept[0].gigabytes), 3 * 300 * e.rates.bytesPerGrasp, 1);
  EXPECT_NEAR(3600 * (e.coreHours - kept[0].coreHours), 3 * 300 * 2.0 / 160, 1e-9);
}

TEST(Estimates, WithoutSetsComeFromConstantsAndUnknownSetsAreCounted) {
  const TestFolder folder;
  Job job = jobOf(0, 0);
  job.pitch = 0.004;
  const std::vector<PlannedSet> plan = {{"a", "three-finger", PlannedSet::State::missing, 0, ""}};
  const Database database(folder.path());
  const auto unknown = estimateCost(job, {handOf("three-finger")}, database, plan);
  ASSERT_EQ(unknown.size(), 1U);
  EXPECT_EQ(unknown[0].rates.sets, 0U);
  EXPECT_EQ(unknown[0].unknownSets, 1U);
  EXPECT_EQ(unknown[0].coreHours, 0);
  database.write(syntheticSet());  // has this pitch, and 12 samples
  const auto known = estimateCost(job, {handOf("three-finger")}, database, plan);
  EXPECT_EQ(known[0].unknownSets, 0U);
  EXPECT_EQ(known[0].trials, 12 * 4 * 2);
  const auto constants = estimateCost(jobOf(100, 0), {handOf("three-finger")}, Database(folder.path() / "none"),
                                      {{"a", "three-finger", PlannedSet::State::missing, 800, ""}});
  EXPECT_GT(constants[0].coreHours, 0);
  EXPECT_GT(constants[0].gigabytes, 0);
}

}  // namespace
}  // namespace handhold
