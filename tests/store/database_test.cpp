#include "store/database.h"

#include "core/error.h"
#include "store/synthetic_set.h"

#include <csignal>
#include <thread>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace handhold {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
namespace fs = std::filesystem;

std::vector<std::string> fileNames(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) names.push_back(entry.path().filename());
  }
  std::sort(names.begin(), names.end());
  return names;
}

TEST(Database, CountsVersionsUp) {
  const TestFolder folder;
  const Database database(folder.path() / "new" / "db");
  EXPECT_EQ(database.newestVersion("mug", "three-finger"), 0);
  EXPECT_TRUE(database.files().empty());
  GraspSet set = syntheticSet();
  set.setVersion = 77;  // ignored
  const fs::path first = database.write(set);
  const fs::path second = database.write(set);
  EXPECT_EQ(first, folder.path() / "new/db/mug/three-finger/v0001.h5");
  EXPECT_EQ(second, database.setPath("mug", "three-finger", 2));
  EXPECT_EQ(database.newestVersion("mug", "three-finger"), 2);
  EXPECT_EQ(readGraspSet(first).setVersion, 1);
  EXPECT_EQ(readGraspSet(second).setVersion, 2);
  EXPECT_THAT(fileNames(folder.path()), ElementsAre("v0001.h5", "v0002.h5"));
}

// The next version follows the newest, also over a gap and beyond four digits.
TEST(Database, GoesOnAfterTheNewest) {
  const TestFolder folder;
  const Database database(folder.path());
  const fs::path target = database.write(syntheticSet()).parent_path();
  fs::rename(target / "v0001.h5", target / "v9999.h5");
  EXPECT_EQ(database.write(syntheticSet()), target / "v10000.h5");
  EXPECT_EQ(database.write(syntheticSet()), target / "v10001.h5");
}

TEST(Database, NeverChangesAFile) {
  const TestFolder folder;
  const Database database(folder.path());
  const fs::path path = database.setPath("mug", "three-finger", 1);
  fs::create_directories(path.parent_path());
  writeBytes(path, "somebody's file");
  EXPECT_EQ(database.write(syntheticSet()).filename(), "v0002.h5");
  EXPECT_EQ(bytesOf(path), "somebody's file");
}

TEST(Database, ListsSetsInOrder) {
  const TestFolder folder;
  const Database database(folder.path());
  for (const char* object : {"mug", "mug-2", "box"}) {
    GraspSet set = syntheticSet();
    set.object = object;
    database.write(set);
  }
  const fs::path mug = database.setPath("mug", "three-finger", 1).parent_path();
  fs::copy(mug / "v0001.h5", mug / "v10000.h5");
  fs::copy(mug / "v0001.h5", mug / "v0002.h5");
  for (const char* other : {"physics-v0001.h5", "v1.h5", "v0000.h5", "v-001.h5", "v0001.h5.part", ".tmp-v0001.h5"}) {
    writeBytes(mug / other, "x");
  }
  writeBytes(folder.path() / "v0001.h5", "x");
  std::vector<std::string> found;
  for (const fs::path& path : database.files()) found.push_back(fs::relative(path, folder.path()));
  EXPECT_THAT(found, ElementsAre("box/three-finger/v0001.h5", "mug/three-finger/v0001.h5", "mug/three-finger/v0002.h5",
                                 "mug/three-finger/v10000.h5", "mug-2/three-finger/v0001.h5"));
}

// Names become folders, so none may lead out of the database.
TEST(Database, RefusesNamesThatArePaths) {
  const TestFolder folder;
  const Database database(folder.path() / "db");
  for (const char* name : {"..", "../mug", "a/b", "", ".hidden"}) {
    GraspSet set = syntheticSet();
    set.object = name;
    EXPECT_THROW(database.write(set), InputError) << name;
    set = syntheticSet();
    set.hand = name;
    EXPECT_THROW(database.write(set), InputError) << name;
    EXPECT_THROW(database.setPath("mug", name, 1), InputError) << name;
    EXPECT_THROW(database.newestVersion(name, "jaw"), InputError) << name;
  }
  EXPECT_FALSE(fs::exists(folder.path() / "db"));
}

// Builders that finish the same set at the same time each get a version, and every file is whole.
TEST(Database, TwoWritersGetTwoVersions) {
  constexpr int kThreads = 2, kRounds = 10;
  const TestFolder folder;
  const Database database(folder.path());
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&database] {
      for (int i = 0; i < kRounds; ++i) database.write(syntheticSet());
    });
  }
  for (std::thread& thread : threads) thread.join();
  const std::vector<fs::path> files = database.files();
  ASSERT_EQ(files.size(), static_cast<std::size_t>(kThreads * kRounds));
  for (std::size_t i = 0; i < files.size(); ++i) {
    EXPECT_EQ(files[i], database.setPath("mug", "three-finger", static_cast<int>(i) + 1));
    EXPECT_EQ(readGraspSet(files[i]).setVersion, static_cast<int>(i) + 1);
  }
  EXPECT_EQ(fileNames(folder.path()).size(), files.size());
}

/// Runs `prepare`, then writes a set, in a child process, and returns the text of its SystemError.
template <class Prepare>
std::string systemErrorOfWriting(const fs::path& folder, const Prepare& prepare) {
  int ends[2];
  if (::pipe(ends) != 0) return "no pipe";
  const pid_t child = ::fork();
  if (child == 0) {
    std::string text = "NO ERROR";
    prepare();
    try {
      Database(folder).write(syntheticSet());
    } catch (const SystemError& error) {
      text = error.what();
    } catch (...) {
      text = "ANOTHER ERROR";
    }
    const bool sent = ::write(ends[1], text.data(), text.size()) == static_cast<ssize_t>(text.size());
    ::_exit(sent ? 0 : 1);
  }
  ::close(ends[1]);
  std::string text(1000, '\0');
  const ssize_t size = ::read(ends[0], text.data(), text.size());
  ::close(ends[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  text.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  return status == 0 ? text : "child failed";
}

// A full disk, as a limit on the size of files: wherever the writing stops, nothing is left behind.
TEST(Database, LeavesNothingBehindOnAFullDisk) {
  for (const rlim_t limit : {rlim_t{0}, rlim_t{512}, rlim_t{4096}, rlim_t{10'000}}) {
    const TestFolder folder;
    const std::string text = systemErrorOfWriting(folder.path(), [limit] {
      std::signal(SIGXFSZ, SIG_IGN);
      const rlimit limits{limit, limit};
      ::setrlimit(RLIMIT_FSIZE, &limits);
    });
    EXPECT_THAT(text, HasSubstr(folder.path().string() + "/mug/three-finger/.tmp-"));
    EXPECT_THAT(text, HasSubstr("cannot be written: File too large"));
    EXPECT_TRUE(fileNames(folder.path()).empty());
  }
}

TEST(Database, RefusesAFolderWithoutPermission) {
  const TestFolder folder;
  const fs::path target = folder.path() / "mug" / "three-finger";
  fs::create_directories(target);
  fs::permissions(folder.path(), fs::perms(0755));
  fs::permissions(target, fs::perms(0555));
  const std::string text = systemErrorOfWriting(folder.path(), [] {
    if (::geteuid() == 0 && ::seteuid(65534) != 0) ::_exit(2);  // root may write anywhere
  });
  EXPECT_THAT(text, HasSubstr("cannot be created: Permission denied"));
  fs::permissions(target, fs::perms(0755));
  EXPECT_TRUE(fileNames(folder.path()).empty());
}

TEST(Database, RefusesAFolderThatIsAFile) {
  const TestFolder folder;
  const fs::path file = folder.path() / "db";
  writeBytes(file, "x");
  try {
    Database(file).write(syntheticSet());
    FAIL() << "written into a file";
  } catch (const SystemError& error) {
    EXPECT_THAT(error.what(), HasSubstr("/db/mug/three-finger: cannot be created: "));
  }
}

// Locks fail on some network file systems, and nothing here needs one: a set that somebody else has locked is read.
TEST(Database, ReadsWithoutLocking) {
  const TestFolder folder;
  const fs::path path = Database(folder.path()).write(syntheticSet());
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_EQ(::flock(descriptor, LOCK_EX | LOCK_NB), 0);
  EXPECT_EQ(readGraspSet(path).object, "mug");
  EXPECT_EQ(readSummary(path).object, "mug");
  ::close(descriptor);
}

}  // namespace
}  // namespace handhold
