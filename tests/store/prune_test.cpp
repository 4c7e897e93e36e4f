#include "store/prune.h"

#include "core/file.h"
#include "store/synthetic_set.h"

#include <chrono>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
namespace fs = std::filesystem;

class Prune : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* object : {"box", "mug"}) {
      GraspSet set = syntheticSet();
      set.object = object;
      for (int version = 1; version <= 4; ++version) database_.write(set);
    }
  }

  std::vector<std::string> names(const std::string& object) const {
    std::vector<std::string> result;
    for (const auto& entry : fs::directory_iterator(folder_.path() / object / "three-finger")) {
      result.push_back(entry.path().filename());
    }
    std::sort(result.begin(), result.end());
    return result;
  }

  TestFolder folder_;
  Database database_{folder_.path()};
};

TEST_F(Prune, KeepsTheNewestAndNumbersGoOn) {
  const PruneReport report = pruneDatabase(database_, {.keep = 2});
  EXPECT_THAT(names("mug"), ElementsAre("v0003.h5", "v0004.h5"));
  EXPECT_THAT(names("box"), ElementsAre("v0003.h5", "v0004.h5"));
  ASSERT_EQ(report.removed.size(), 4U);
  for (const auto& file : report.removed) EXPECT_GT(file.bytes, 512U);
  pruneDatabase(database_, {.keep = 1});
  EXPECT_THAT(names("mug"), ElementsAre("v0004.h5"));
  EXPECT_EQ(database_.write(syntheticSet()).filename(), "v0005.h5");
  EXPECT_THAT(pruneDatabase(database_, {.keep = 9}).removed, IsEmpty());
}

TEST_F(Prune, TouchesOnlyWhatIsSelectedAndNothingOnADryRun) {
  EXPECT_EQ(pruneDatabase(database_, {.keep = 1, .dryRun = true}).removed.size(), 6U);
  EXPECT_EQ(names("mug").size(), 4U);
  pruneDatabase(database_, {.keep = 1, .objectGlob = "m*"});
  EXPECT_EQ(names("mug").size(), 1U);
  EXPECT_EQ(names("box").size(), 4U);
  EXPECT_THAT(pruneDatabase(database_, {.keep = 1, .handGlob = "jaw"}).removed, IsEmpty());
}

TEST_F(Prune, PhysicsGoesWithItsVersion) {
  const fs::path folder = folder_.path() / "mug" / "three-finger";
  for (const char* name : {"physics-v0002.h5", "physics-v0004.h5", "notes.txt"}) writeBytes(folder / name, "x");
  pruneDatabase(database_, {.keep = 1});
  EXPECT_THAT(names("mug"), ElementsAre("notes.txt", "physics-v0004.h5", "v0004.h5"));
}

// A damaged newest version does not cost the last good one.
TEST_F(Prune, DamagedFilesAreLeftAndNotCounted) {
  const fs::path newest = folder_.path() / "mug" / "three-finger" / "v0004.h5";
  fs::resize_file(newest, 1000);
  const PruneReport report = pruneDatabase(database_, {.keep = 1});
  EXPECT_THAT(report.damaged, ElementsAre(newest));
  EXPECT_THAT(names("mug"), ElementsAre("v0003.h5", "v0004.h5"));
}

TEST_F(Prune, TemporaryFilesOfDeadBuildersGo) {
  const fs::path folder = folder_.path() / "mug" / "three-finger";
  const fs::path alive = temporaryName(folder), old = temporaryName(folder), top = temporaryName(folder_.path());
  for (const fs::path& path : {alive, old, top}) writeBytes(path, "half");
  for (const fs::path& path : {old, top}) {
    fs::last_write_time(path, fs::file_time_type::clock::now() - std::chrono::hours(48));
  }
  const PruneReport report = pruneDatabase(database_, {.keep = 4});
  EXPECT_EQ(report.removed.size(), 2U);
  EXPECT_TRUE(fs::exists(alive));
  EXPECT_FALSE(fs::exists(old));
  EXPECT_FALSE(fs::exists(top));
}

// Who has a file open reads it to its end.
TEST_F(Prune, LeavesAReaderItsFile) {
  const fs::path path = database_.setPath("mug", "three-finger", 1);
  const std::string before = bytesOf(path);
  std::ifstream stream(path, std::ios::binary);
  char first = 0;
  stream.get(first);
  pruneDatabase(database_, {.keep = 1});
  EXPECT_FALSE(fs::exists(path));
  const std::string rest{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(first + rest, before);
}

}  // namespace
}  // namespace handhold
