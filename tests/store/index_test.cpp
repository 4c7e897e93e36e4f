#include "core/error.h"
#include "core/file.h"
#include "store/database.h"
#include "store/synthetic_set.h"

#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

namespace handhold {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
namespace fs = std::filesystem;

std::string textOf(const GraspSetSummary& s) {
  return fmt::format(
      "{}",
      fmt::join(
          std::vector<std::string>{
              fmt::format("{} {} {} {}", s.path.string(), s.object, s.hand, s.inputHash),
              fmt::format("{} {} {} {} {}", s.generator, s.policy, s.setVersion, s.friction, s.coneEdges),
              fmt::format("{} {} {} {} {} {}", s.watertight, s.samples, s.rolls, s.preshapes, s.grasps, s.bytes),
              fmt::format("{} {}", s.trialsByReference, fmt::join(s.outcomes, ",")),
              fmt::format("{} {} {} {}", s.bestEpsilon, s.bestEpsilonLower, s.bestEpsilonUpper,
                          s.leastCriticalFriction),
              fmt::format("{} {} {}", s.bestLoadMargin, s.largestLoadMargin, s.loadMargins),
              fmt::format("{} {} {}", s.robustnessTrials, s.robustnessPosition, s.robustnessRotation),
              fmt::format("{} {} {}", s.bestRobustness, s.bestRobustnessLower, s.bestRobustnessUpper),
              fmt::format("{} {} {} {}", s.torsionRadius, fmt::join(s.seconds, ","), s.created, s.host),
              fmt::format("{} {}", s.objectNotes.size(), fmt::join(s.objectNotes, ","))},
          "; "));
}

class Index : public testing::Test {
 protected:
  Index() {
    for (const char* object : {"mug", "box", "can"}) database.write(named(object));
    database.write(named("mug", 2));
    GraspSet empty = syntheticSet({.grasps = 0});
    empty.object = "empty";
    empty.objectNotes = {"two\nlines", "", "\xc3\xa9"};
    empty.seconds = {{"load", 1.0 / 3}};
    database.write(empty);
  }

  static GraspSet named(const std::string& object, std::uint64_t seed = 1) {
    GraspSet set = syntheticSet({}, seed);
    set.object = object;
    set.friction = 0.5;
    const double best = object == "mug" ? 1 : object == "box" ? 0.5 : 0.25;
    for (double& epsilon : set.epsilon) epsilon *= best;
    for (std::size_t i = 0; i < set.epsilonUpper.size(); ++i) set.epsilonLower[i] = set.epsilonUpper[i] = std::nan("");
    for (float& friction : set.criticalFriction) friction = static_cast<float>(friction + 0.1 * best);
    return set;
  }

  std::vector<std::string> listed() {
    failures.clear();
    std::vector<std::string> lines;
    for (const GraspSetSummary& summary : database.summaries(failures)) lines.push_back(textOf(summary));
    return lines;
  }

  /// Makes a file unreadable for readSummary without touching what the index looks at.
  static void damageUnseen(const fs::path& path) {
    const auto time = fs::last_write_time(path);
    std::string bytes = bytesOf(path);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    writeBytes(path, bytes);
    fs::last_write_time(path, time);
  }

  TestFolder folder;
  Database database{folder.path()};
  fs::path index = folder.path() / "index.sqlite";
  std::vector<std::string> failures;
};

TEST_F(Index, GivesTheSameList) {
  const std::vector<std::string> before = listed();
  EXPECT_EQ(before.size(), 5u);
  EXPECT_EQ(database.writeIndex(failures), 5u);
  EXPECT_EQ(listed(), before);
  EXPECT_THAT(failures, IsEmpty());
  // The files are not read any more: a list from the index does not see damage that leaves size and time alone.
  for (const fs::path& path : database.files()) damageUnseen(path);
  EXPECT_EQ(listed(), before);
  fs::remove(index);
  EXPECT_THAT(listed(), IsEmpty());
  EXPECT_EQ(failures.size(), 5u);
}

TEST_F(Index, NeverTrustsAStaleRow) {
  database.writeIndex(failures);
  const fs::path box = database.setPath("box", "three-finger", 1), can = database.setPath("can", "three-finger", 1);
  // Another file of the same size at a later time, a file of another size at the same time, a new set, a removed one.
  GraspSet other = named("box", 9);
  other.epsilon[0] = 7;
  const fs::path written = database.write(other);
  fs::rename(written, box);
  fs::last_write_time(box, fs::last_write_time(box) + std::chrono::seconds(1));
  const auto time = fs::last_write_time(can);
  writeBytes(can, "short");
  fs::last_write_time(can, time);
  database.write(named("new"));
  fs::remove(database.setPath("empty", "three-finger", 1));
  const std::vector<std::string> withIndex = listed();
  EXPECT_THAT(failures, ElementsAre(HasSubstr("can/three-finger/v0001.h5")));
  EXPECT_THAT(withIndex[0], HasSubstr(" 7 "));
  fs::remove(index);
  EXPECT_EQ(withIndex, listed());
  EXPECT_EQ(withIndex.size(), 4u);
}

TEST_F(Index, IsWrittenAnewAndLeavesNothingElse) {
  database.writeIndex(failures);
  const std::string first = bytesOf(index);
  database.writeIndex(failures);
  EXPECT_EQ(bytesOf(index), first);
  database.write(named("new"));
  damageUnseen(database.write(named("bad")));
  EXPECT_EQ(database.writeIndex(failures), 6u);
  EXPECT_THAT(failures, ElementsAre(HasSubstr("bad/three-finger/v0001.h5: is damaged")));
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    if (entry.is_regular_file()) names.push_back(entry.path().filename());
  }
  EXPECT_THAT(names, ElementsAre("index.sqlite"));
}

TEST_F(Index, ListingWritesNothing) {
  database.writeIndex(failures);
  database.write(named("new"));
  const std::string bytes = bytesOf(index);
  listed();
  EXPECT_EQ(bytesOf(index), bytes);
  fs::remove(index);
  listed();
  EXPECT_FALSE(fs::exists(index));
}

// A bit that flips anywhere costs a warning and time, never a wrong answer.
TEST_F(Index, ADamagedIndexChangesNoAnswer) {
  const std::vector<std::string> right = listed();
  database.writeIndex(failures);
  const std::string bytes = bytesOf(index);
  testing::internal::CaptureStderr();
  for (std::size_t i = 0; i < bytes.size(); i += i < 100 ? 1 : 151) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ (1 << i % 8));
    writeBytes(index, damaged);
    EXPECT_EQ(listed(), right) << "byte " << i;
  }
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{1}, std::size_t{100}, bytes.size() / 2, bytes.size() - 1}) {
    writeBytes(index, bytes.substr(0, size));
    EXPECT_EQ(listed(), right) << size << " bytes";
  }
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("is damaged"));
}

TEST_F(Index, AForeignIndexIsOneWarning) {
  const std::vector<std::string> right = listed();
  database.writeIndex(failures);
  std::string other = bytesOf(index);  // of a version with another column
  other.replace(other.find("cone_edges"), 10, "cone_faces");
  for (const std::string& bytes : {std::string("a shopping list\n"), other}) {
    writeBytes(index, bytes);
    testing::internal::CaptureStderr();
    EXPECT_EQ(listed(), right);
    const std::string text = testing::internal::GetCapturedStderr();
    EXPECT_THAT(text, HasSubstr("index.sqlite: is not used: it is damaged, or of another version of Handhold"));
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
  }
  EXPECT_EQ(database.writeIndex(failures), 5u);  // in its place
  testing::internal::CaptureStderr();
  EXPECT_EQ(listed(), right);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// A folder may be copied or mounted elsewhere.
TEST_F(Index, HoldsPathsRelativeToTheDatabase) {
  database.writeIndex(failures);
  const TestFolder elsewhere;
  const fs::path moved = elsewhere.path() / "moved";
  fs::rename(folder.path(), moved);
  database = Database(moved);
  for (const fs::path& path : database.files()) damageUnseen(path);
  EXPECT_EQ(listed().size(), 5u);  // from the index
  EXPECT_THAT(failures, IsEmpty());
}

TEST_F(Index, AReadOnlyDatabaseIsListedButNotIndexed) {
  database.writeIndex(failures);
  const std::vector<std::string> before = listed();
  fs::permissions(folder.path(), fs::perms(0555));
  const pid_t child = ::fork();
  if (child == 0) {
    if (::geteuid() == 0 && ::seteuid(65534) != 0) ::_exit(2);  // root may write anywhere
    if (listed() != before) ::_exit(3);
    try {
      database.writeIndex(failures);
    } catch (const SystemError& error) {
      ::_exit(std::string(error.what()).find("Permission denied") == std::string::npos ? 4 : 0);
    }
    ::_exit(5);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  fs::permissions(folder.path(), fs::perms(0755));
  EXPECT_EQ(status, 0);
}

// With the index, sets that cannot pass are not opened; the answer and its counts are the same.
TEST_F(Index, QueriesPassOverSetsAndAnswerTheSame) {
  const auto answered = [&](const GraspQuery& query) {
    const QueryAnswer answer = database.query(query);
    std::string text;
    for (const FoundSet& set : answer.sets) {
      text += set.path.string();
      for (const FoundGrasp& grasp : set.grasps) text += fmt::format(" {}", grasp.grasp);
      text += "\n";
    }
    const LeftOut& out = answer.leftOut;
    return fmt::format("{}{} {} {} {} {} {} {} {} {}", text, answer.setsAsked, answer.graspsAsked, out.minPhysics,
                       out.minEpsilon, out.friction, out.unknownFriction, out.preshape, out.near,
                       fmt::join(answer.failures, ";"));
  };
  std::vector<GraspQuery> queries(6);
  queries[0].minEpsilon = 0.2;
  queries[1].friction = 0.22;
  queries[2].friction = 0.16;
  queries[2].minEpsilon = 0.1;
  queries[3].minPhysics = 0.5;
  queries[4].friction = 0;
  queries[5].minEpsilon = 0.001;
  queries[5].preshape = "*1";
  queries[5].top = 2;
  std::vector<std::string> before;
  for (const GraspQuery& query : queries) before.push_back(answered(query));
  EXPECT_THAT(before[0], HasSubstr("mug/three-finger/v0002.h5 0\n"));
  database.writeIndex(failures);
  for (std::size_t i = 0; i < queries.size(); ++i) EXPECT_EQ(answered(queries[i]), before[i]) << i;
  damageUnseen(database.setPath("can", "three-finger", 1));
  EXPECT_EQ(answered(queries[0]), before[0]);  // it was not opened
  GraspQuery tooMuch;
  tooMuch.friction = 0.45;  // "empty" was built with 0.4
  EXPECT_THROW(database.query(tooMuch), InputError);
}

}  // namespace
}  // namespace handhold
