#include "core/file.h"

#include "core/error.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <set>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::StartsWith;
using testing::StrEq;
using testing::ThrowsMessage;

/// A folder of its own for each test, removed at the end.
class FileTest : public testing::Test {
 protected:
  FileTest() {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(testing::TempDir()) / fmt::format("handhold-file-{}-{}", ::getpid(), info->name());
    fs::create_directories(folder_);
  }
  ~FileTest() override { fs::remove_all(folder_); }

  fs::path write(const std::string& name, const std::string& content) const {
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return folder_ / name;
  }
  std::set<std::string> names() const {
    std::set<std::string> result;
    for (const auto& entry : fs::directory_iterator(folder_)) result.insert(entry.path().filename());
    return result;
  }

  fs::path folder_;
};

using ReadFile = FileTest;
using PublishFile = FileTest;
using TemporaryName = FileTest;

TEST_F(ReadFile, GivesEveryByte) {
  const std::string bytes = std::string("a\0b\r\n\xff", 6) + std::string(200'000, 'x') + "end";
  EXPECT_EQ(readFile(write("bytes", bytes)), bytes);
  EXPECT_EQ(readFile(write("empty", "")), "");
}

TEST_F(ReadFile, RefusesMissingFileAndFolder) {
  EXPECT_THAT([&] { readFile(folder_ / "none"); },
              ThrowsMessage<InputError>(StrEq((folder_ / "none: cannot be read: No such file or directory").string())));
  EXPECT_THAT([&] { readFile(folder_); },
              ThrowsMessage<InputError>(StrEq(folder_.string() + ": cannot be read: is a folder")));
  EXPECT_THAT([&] { readFile(write("plain", "x") / "below"); },
              ThrowsMessage<InputError>(HasSubstr("Not a directory")));
}

// It opens, but address 0 cannot be read: a failure half way must not look like a short file.
TEST_F(ReadFile, RefusesFileWhoseReadingFails) {
  EXPECT_THAT([] { readFile("/proc/self/mem"); },
              ThrowsMessage<InputError>(StartsWith("/proc/self/mem: cannot be read: ")));
}

TEST_F(PublishFile, MovesTheContentAndRemovesTheTemporary) {
  EXPECT_TRUE(publishFile(write(".tmp", "content"), folder_ / "v0001.h5"));
  EXPECT_EQ(readFile(folder_ / "v0001.h5"), "content");
  EXPECT_EQ(names(), std::set<std::string>{"v0001.h5"});
}

TEST_F(PublishFile, NeverOverwrites) {
  write("v0001.h5", "old");
  EXPECT_FALSE(publishFile(write(".tmp", "new"), folder_ / "v0001.h5"));
  EXPECT_EQ(readFile(folder_ / "v0001.h5"), "old");
  EXPECT_EQ(names(), std::set<std::string>{"v0001.h5"});
}

TEST_F(PublishFile, ReplaceFileTakesThePlaceOfAFile) {
  for (const char* content : {"first", "second"}) {
    replaceFile(write(".tmp", content), folder_ / "index");
    EXPECT_EQ(readFile(folder_ / "index"), content);
  }
  EXPECT_EQ(names(), std::set<std::string>{"index"});
  fs::create_directory(folder_ / "taken");
  EXPECT_THAT([&] { replaceFile(write(".tmp", "x"), folder_ / "taken"); },
              ThrowsMessage<SystemError>(HasSubstr("taken: cannot be replaced: ")));
  EXPECT_EQ(names(), (std::set<std::string>{"index", "taken"}));
}

// A link that leads nowhere is a name that is taken.
TEST_F(PublishFile, NeverFollowsALink) {
  fs::create_symlink(folder_ / "elsewhere", folder_ / "v0001.h5");
  EXPECT_FALSE(publishFile(write(".tmp", "new"), folder_ / "v0001.h5"));
  EXPECT_FALSE(fs::exists(folder_ / "elsewhere"));
}

// Of many publishers of one name exactly one wins, and the file is whole.
TEST_F(PublishFile, OneOfManyWins) {
  constexpr int kThreads = 8;
  std::vector<std::thread> threads;
  std::vector<int> won(kThreads, 0);
  std::vector<fs::path> temporaries;
  for (int i = 0; i < kThreads; ++i) {
    temporaries.push_back(write(".tmp" + std::to_string(i), std::string(10'000, static_cast<char>('a' + i))));
  }
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([&, i] { won[i] = publishFile(temporaries[i], folder_ / "v0001.h5") ? 1 : 0; });
  }
  for (auto& thread : threads) thread.join();
  const auto winner = std::find(won.begin(), won.end(), 1);
  ASSERT_EQ(std::count(won.begin(), won.end(), 1), 1);
  EXPECT_EQ(readFile(folder_ / "v0001.h5"), std::string(10'000, static_cast<char>('a' + (winner - won.begin()))));
  EXPECT_EQ(names(), std::set<std::string>{"v0001.h5"});
}

TEST_F(PublishFile, OtherRefusalsThrowAndLeaveNoTemporary) {
  const fs::path target = folder_ / "no_such_folder" / "v0001.h5";
  EXPECT_THAT([&] { publishFile(write(".tmp", "x"), target); },
              ThrowsMessage<SystemError>(StrEq(target.string() + ": cannot be created: No such file or directory")));
  EXPECT_TRUE(names().empty());
  EXPECT_THAT([&] { publishFile(folder_ / "never_written", folder_ / "v"); },
              ThrowsMessage<SystemError>(HasSubstr("never_written: cannot be opened: No such file or directory")));
}

TEST_F(PublishFile, TakesNamesWithoutAFolder) {
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  write(".tmp", "content");
  bool published = false;
  EXPECT_NO_THROW(published = publishFile(".tmp", "v0001.h5"));
  fs::current_path(before);
  EXPECT_TRUE(published);
  EXPECT_EQ(readFile(folder_ / "v0001.h5"), "content");
}

TEST_F(TemporaryName, IsHiddenAndUnique) {
  const fs::path a = temporaryName(folder_), b = temporaryName(folder_);
  EXPECT_NE(a, b);
  EXPECT_EQ(a.parent_path(), folder_);
  EXPECT_THAT(a.filename().string(), StartsWith("."));
  EXPECT_THAT(a.filename().string(), HasSubstr(std::to_string(::getpid())));
}

using ReplaceFile = FileTest;
using AbandonedTemporary = FileTest;

TEST_F(ReplaceFile, WritesAnewAndOver) {
  replaceContent(folder_ / "record", "first, longer");
  EXPECT_EQ(readFile(folder_ / "record"), "first, longer");
  replaceContent(folder_ / "record", "second");
  EXPECT_EQ(readFile(folder_ / "record"), "second");
  EXPECT_EQ(names(), std::set<std::string>{"record"});
}

TEST_F(ReplaceFile, SaysWhyItCannot) {
  EXPECT_THAT([&] { replaceContent(folder_ / "none" / "record", "x"); },
              ThrowsMessage<SystemError>(HasSubstr("none/record: cannot be written: No such file or directory")));
  fs::create_directories(folder_ / "taken" / "below");
  EXPECT_THAT([&] { replaceContent(folder_ / "taken", "x"); }, ThrowsMessage<SystemError>(HasSubstr("Is a directory")));
  EXPECT_EQ(names(), std::set<std::string>{"taken"});
}

TEST_F(AbandonedTemporary, IsThatOfADeadProcessOrAnOldOne) {
  const fs::path mine = temporaryName(folder_);
  write(mine.filename(), "being written");
  EXPECT_FALSE(isAbandonedTemporary(mine));
  const auto old = fs::file_time_type::clock::now() - std::chrono::hours(7);
  fs::last_write_time(mine, old);
  EXPECT_TRUE(isAbandonedTemporary(mine));

  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  std::string name = temporaryName(folder_).filename().string();
  const std::string pid = fmt::format("-{}-", ::getpid());
  name.replace(name.rfind(pid), pid.size(), fmt::format("-{}-", child));
  EXPECT_TRUE(isAbandonedTemporary(write(name, "half")));
  EXPECT_FALSE(isAbandonedTemporary(write(name + "-x", "of another form")));
  // Another machine's process cannot be asked for: time alone tells.
  EXPECT_FALSE(isAbandonedTemporary(write(fmt::format(".tmp-elsewhere.example-{}-0", child), "x")));
  const fs::path other = write("v0001.h5", "x");
  fs::last_write_time(other, old);
  EXPECT_FALSE(isAbandonedTemporary(other));
}

// A file system may give a removed folder's number to the next one that is made.
TEST_F(FileTest, AnOpenFolderIsNotOneMadeInItsPlace) {
  const fs::path folder = folder_ / "open";
  EXPECT_TRUE(OpenFolder(folder).isAt(folder));  // not there: nothing is known
  fs::create_directories(folder);
  {
    const OpenFolder open(folder);
    EXPECT_TRUE(open.isAt(folder));
    EXPECT_TRUE(open.isAt(folder / "." / ""));
    EXPECT_FALSE(open.isAt(folder.parent_path()));
    fs::remove(folder);
    EXPECT_FALSE(open.isAt(folder));
    fs::create_directories(folder);
    EXPECT_FALSE(open.isAt(folder));
  }
  EXPECT_TRUE(OpenFolder(folder).isAt(folder));
}

TEST(MatchesGlob, ShellPatterns) {
  EXPECT_TRUE(matchesGlob("mug", "*"));
  EXPECT_TRUE(matchesGlob("mug", "m?g"));
  EXPECT_TRUE(matchesGlob("mug_2", "mug_[0-9]"));
  EXPECT_TRUE(matchesGlob("a/b.ply", "*/*.ply"));
  EXPECT_TRUE(matchesGlob("", ""));
  EXPECT_FALSE(matchesGlob("mug", "m"));
  EXPECT_FALSE(matchesGlob("mug", "MUG"));
  EXPECT_FALSE(matchesGlob("a/b.ply", "*.ply"));
  EXPECT_FALSE(matchesGlob("a/b", "a?b"));
  EXPECT_FALSE(matchesGlob("mug", ""));
}

TEST(RequireName, GoodNames) {
  for (const std::string& name :
       {std::string("mug"), std::string("003_cracker-box.v2+"), std::string("7"), std::string(100, 'a')}) {
    EXPECT_NO_THROW(requireName(name, "f.yaml:3", "name")) << name;
  }
}

// Such a name would leave its folder, hide, or be taken for something else.
TEST(RequireName, BadNames) {
  const std::string bad[] = {"",
                             ".",
                             "..",
                             "../up",
                             "a/b",
                             "/abs",
                             ".hidden",
                             "-option",
                             "_x",
                             "a b",
                             "a\\b",
                             "a\nb",
                             "caf\xc3\xa9",
                             "a*",
                             "a:b",
                             "${X}",
                             std::string("a\0b", 3),
                             std::string(101, 'a')};
  for (const std::string& name : bad) {
    SCOPED_TRACE(name);
    EXPECT_THAT([&] { requireName(name, "f.yaml:3", "name"); },
                ThrowsMessage<InputError>(
                    testing::AllOf(StartsWith("f.yaml:3: name is \""), HasSubstr("want 1 to 100 letters, digits"))));
  }
}

TEST(ExpandEnvironment, ReplacesEveryVariable) {
  ::setenv("HANDHOLD_TEST_A", "/data", 1);
  ::setenv("HANDHOLD_TEST_B", "${HANDHOLD_TEST_A}", 1);
  EXPECT_EQ(expandEnvironment("${HANDHOLD_TEST_A}/x", "f"), "/data/x");
  EXPECT_EQ(expandEnvironment("a${HANDHOLD_TEST_A}b${HANDHOLD_TEST_A}", "f"), "a/datab/data");
  EXPECT_EQ(expandEnvironment("${HANDHOLD_TEST_B}", "f"), "${HANDHOLD_TEST_A}");  // once, not again and again
  EXPECT_EQ(expandEnvironment("plain $HOME {x} 100%", "f"), "plain $HOME {x} 100%");
  EXPECT_EQ(expandEnvironment("${open", "f"), "${open");
  EXPECT_EQ(expandEnvironment("", "f"), "");
}

TEST(ExpandEnvironment, RefusesUnsetVariable) {
  ::unsetenv("HANDHOLD_TEST_NONE");
  EXPECT_THAT([] { expandEnvironment("x/${HANDHOLD_TEST_NONE}/y", "f.yaml:4"); },
              ThrowsMessage<InputError>(
                  StrEq("f.yaml:4: ${HANDHOLD_TEST_NONE} is not set, want an environment variable with a path")));
  EXPECT_THAT([] { expandEnvironment("${}", "f.yaml:4"); }, ThrowsMessage<InputError>(HasSubstr("${} is not set")));
}

// What a shell makes of it is what was given.
TEST(ShellQuoted, IsOneWordOfAShell) {
  EXPECT_EQ(shellQuoted("/data/db-1_a.b"), "/data/db-1_a.b");
  for (const std::string word :
       {"", " ", "a b", "it's", "$HOME `id` \\ \"x\"", "*?[a]", "~", "#x", "a\nb", "-n;&|<>(){}!"}) {
    std::FILE* pipe = ::popen(("printf '<%s>' " + shellQuoted(word)).c_str(), "r");
    ASSERT_NE(pipe, nullptr);
    char output[100] = {};
    std::fread(output, 1, sizeof output - 1, pipe);
    EXPECT_EQ(::pclose(pipe), 0);
    EXPECT_EQ(output, "<" + word + ">");
  }
}

TEST(ProgramFolder, HoldsThisProgram) { EXPECT_TRUE(fs::is_directory(programFolder())); }

}  // namespace
}  // namespace handhold
