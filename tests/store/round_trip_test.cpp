#include "store/database.h"
#include "store/layout.h"
#include "store/synthetic_set.h"

#include <chrono>
#include <cmath>
#include <iostream>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

// What is written is read again, to the last bit.
TEST(RoundTrip, KeepsEveryField) {
  const TestFolder folder;
  const GraspSet set = syntheticSet();
  const fs::path path = Database(folder.path()).write(set);
  const GraspSet copy = readGraspSet(path);
  EXPECT_EQ(firstDifference(set, copy), "");
  EXPECT_EQ(copy.setVersion, 1);
  EXPECT_EQ(copy.epsilonLower.front(), set.epsilonLower.front());
  EXPECT_TRUE(std::isnan(copy.epsilonUpper.back()));
  EXPECT_TRUE(std::isnan(copy.criticalFriction.back()));
  EXPECT_EQ(copy.loadMargin[1], std::numeric_limits<float>::infinity());
  EXPECT_TRUE(std::isnan(copy.loadMargin.back()));
  EXPECT_EQ(copy.robustness[1], 0.52F);
  EXPECT_TRUE(std::isnan(copy.robustnessUpper.back()));
  EXPECT_EQ(copy.generator, set.generator);
  EXPECT_EQ(copy.seconds, set.seconds);
  EXPECT_EQ(copy.host, set.host);
  EXPECT_EQ(copy.created, set.created);
  EXPECT_EQ(copy.linkNames, set.linkNames);
  EXPECT_EQ(copy.linkMeshes[2].vertices, set.linkMeshes[2].vertices);
  EXPECT_EQ(copy.seed, set.seed);
  EXPECT_EQ(copy.job, set.job);
}

// A set without any grasp is a set: its arrays have no row but their columns.
TEST(RoundTrip, KeepsASetWithoutGrasps) {
  const TestFolder folder;
  const GraspSet set = syntheticSet({.samples = 3, .rolls = 2, .preshapes = 1, .grasps = 0});
  const GraspSet copy = readGraspSet(Database(folder.path()).write(set));
  EXPECT_EQ(firstDifference(set, copy), "");
  EXPECT_EQ(copy.graspCount(), 0u);
  EXPECT_EQ(copy.neighbors, 5);
  EXPECT_EQ(copy.contactBegin, std::vector<std::uint32_t>{0});
}

// Not even a sample, a joint or a link with geometry: shapes of nothing survive too.
TEST(RoundTrip, KeepsASetOfNothing) {
  const TestFolder folder;
  GraspSet set;
  set.object = "dust";
  set.hand = "none";
  set.inputHash = "0";
  const GraspSet copy = readGraspSet(Database(folder.path()).write(set));
  EXPECT_EQ(firstDifference(set, copy), "");
  EXPECT_TRUE(copy.urdf.empty());
}

// Texts longer than the 64 KiB that HDF5 allows an attribute's own bytes.
TEST(RoundTrip, KeepsLongTexts) {
  const TestFolder folder;
  GraspSet set = syntheticSet();
  set.job.assign(300'000, 'j');
  set.urdf.assign(2'000'000, 'u');
  set.objectNotes.assign(5000, std::string(40, 'n'));
  EXPECT_EQ(firstDifference(set, readGraspSet(Database(folder.path()).write(set))), "");
}

TEST(RoundTrip, SummaryCountsOutcomes) {
  const TestFolder folder;
  const GraspSet set = syntheticSet();
  const fs::path path = Database(folder.path()).write(set);
  const GraspSetSummary summary = readSummary(path);
  EXPECT_EQ(summary.path, path);
  EXPECT_EQ(summary.object, "mug");
  EXPECT_EQ(summary.hand, "three-finger");
  EXPECT_EQ(summary.setVersion, 1);
  EXPECT_EQ(summary.samples, 12u);
  EXPECT_EQ(summary.rolls, 4u);
  EXPECT_EQ(summary.preshapes, 2u);
  EXPECT_EQ(summary.grasps, 17u);
  EXPECT_EQ(summary.trialsByReference, set.trialsByReference);
  EXPECT_EQ(summary.torsionRadius, 0.004);
  EXPECT_EQ(summary.bytes, fs::file_size(path));
  EXPECT_EQ(summary.bestEpsilon, set.epsilon.front());
  EXPECT_EQ(summary.bestEpsilonLower, set.epsilonLower.front());
  EXPECT_EQ(summary.bestEpsilonUpper, set.epsilonUpper.front());
  EXPECT_EQ(summary.leastCriticalFriction, set.criticalFriction.front());  // past the grasp that has none
  EXPECT_EQ(summary.bestLoadMargin, set.loadMargin.front());
  EXPECT_EQ(summary.largestLoadMargin, std::numeric_limits<float>::infinity());
  EXPECT_EQ(summary.loadMargins, 8u);
  EXPECT_EQ(summary.robustnessTrials, 100);
  EXPECT_EQ(summary.bestRobustness, 0.5F);
  EXPECT_EQ(summary.bestRobustnessLower, 0.4F);
  EXPECT_EQ(summary.bestRobustnessUpper, 0.6F);
  EXPECT_TRUE(summary.watertight);
  EXPECT_EQ(summary.objectNotes, set.objectNotes);
  EXPECT_EQ(summary.seconds, set.seconds);
  ASSERT_EQ(summary.outcomes.size(), kOutcomeNames.size());
  EXPECT_EQ(summary.outcomes[0], std::pair(std::string("force_closed"), std::size_t{17}));
  EXPECT_EQ(summary.outcomes[1], std::pair(std::string("not_force_closed"), std::size_t{0}));
  EXPECT_EQ(summary.outcomes[3], std::pair(set.outcomeNames[3], std::size_t{12 * 4 * 2 - 17}));
  EXPECT_EQ(readInputHash(path), set.inputHash);
}

// Times and hosts lie in /timings alone: without them two files are equal byte for byte but for their version.
TEST(Bytes, DependOnTheSetAlone) {
  const TestFolder first, second;
  const GraspSet set = syntheticSet();
  EXPECT_EQ(bytesOf(Database(first.path()).write(set)), bytesOf(Database(second.path()).write(set)));
}

TEST(Bytes, OfOtherTimingsAreAnEqualSet) {
  const TestFolder first, second;
  GraspSet set = syntheticSet();
  const fs::path a = Database(first.path()).write(set);
  set.seconds["simulate"] = 99;
  set.host = "another machine";
  set.created = "2030-12-31T23:59:59Z";
  const fs::path b = Database(second.path()).write(set);
  EXPECT_EQ(firstDifference(readGraspSet(a), readGraspSet(b)), "");
  EXPECT_NE(bytesOf(a), bytesOf(b));
}

// HDF5 leaves gaps in its files; what stood in memory before must not be in them.
TEST(Bytes, HoldNoneOfTheMemoryBefore) {
  const GraspSet set = syntheticSet();
  const std::string first = encodeGraspSet(set);
  for (int round = 0; round < 20; ++round) {
    std::vector<std::unique_ptr<std::string>> dirt;
    for (std::size_t size = 16; size < 100'000; size += size / 4) {
      dirt.push_back(std::make_unique<std::string>(size, static_cast<char>('A' + round)));
    }
    dirt.clear();
    ASSERT_EQ(encodeGraspSet(set), first) << "round " << round;
  }
}

// `head -c 512` tells a person what the file is.
TEST(Bytes, BeginWithText) {
  GraspSet set = syntheticSet();
  set.setVersion = 7;
  const std::string block = encodeGraspSet(set).substr(0, kBlockBytes);
  EXPECT_THAT(block, HasSubstr("HANDHOLD GRASP SET\nformat_version 1\nobject mug\nhand three-finger\nset_version 7\n"
                               "input_hash 00112233445566778899aabbccddeeff\nbytes "));
}

// The longest names and hash still fit.
TEST(Bytes, BlockHoldsTheLongestNames) {
  const SetBlock block{std::string(100, 'o'),
                       std::string(100, 'h'),
                       std::numeric_limits<int>::max(),
                       std::string(64, 'f'),
                       std::numeric_limits<std::size_t>::max(),
                       std::string(32, 'c')};
  const std::string bytes = encodeBlock(block);
  EXPECT_EQ(bytes.size(), kBlockBytes);
  EXPECT_EQ(bytes.back(), '\0');
}

struct Change {
  const char* path;
  void (*apply)(GraspSet&);
};

// Each kind of field, under the name that db/FORMAT.md gives it.
TEST(FirstDifference, NamesTheField) {
  const Change changes[] = {
      {"/@friction", [](GraspSet& s) { s.friction = 0.5; }},
      {"/@torsion_radius", [](GraspSet& s) { s.torsionRadius = 0; }},
      {"/@robustness_trials", [](GraspSet& s) { ++s.robustnessTrials; }},
      {"/@robustness_position", [](GraspSet& s) { s.robustnessPosition = 0; }},
      {"/@robustness_rotation", [](GraspSet& s) { s.robustnessRotation = 0; }},
      {"/grasps/robustness", [](GraspSet& s) { s.robustness[0] = 0.55F; }},
      {"/@job", [](GraspSet& s) { s.job += " "; }},
      {"/@seed", [](GraspSet& s) { ++s.seed; }},
      {"/object/vertices", [](GraspSet& s) { s.objectMesh.vertices[0].x() = 1; }},
      {"/object/triangles", [](GraspSet& s) { s.objectMesh.triangles.pop_back(); }},
      {"/object/center_of_mass", [](GraspSet& s) { s.centerOfMass.z() = 0; }},
      {"/object@watertight", [](GraspSet& s) { s.watertight = false; }},
      {"/object/notes", [](GraspSet& s) { s.objectNotes.clear(); }},
      {"/hand/urdf", [](GraspSet& s) { s.urdf = "x"; }},
      {"/hand/links/finger%2F1/vertices", [](GraspSet& s) { s.linkMeshes[2].vertices[0].x() = 1; }},
      {"/trials/outcome", [](GraspSet& s) { s.outcome[5] = 1; }},
      {"/trials/outcome@names", [](GraspSet& s) { s.outcomeNames[1] = "x"; }},
      {"/trials@by_reference", [](GraspSet& s) { ++s.trialsByReference; }},
      {"/grasps/epsilon", [](GraspSet& s) { s.epsilon[0] = 1; }},
      {"/samples/point",
       [](GraspSet& s) {
         s.samples = 0;
         s.samplePoint.clear();
       }},
      {"/distance_map/weight", [](GraspSet& s) { s.mapWeight[3] = 0; }},
  };
  for (const Change& change : changes) {
    GraspSet changed = syntheticSet();
    change.apply(changed);
    EXPECT_EQ(firstDifference(syntheticSet(), changed), change.path);
  }
}

TEST(FirstDifference, IgnoresWhoWroteIt) {
  GraspSet other = syntheticSet();
  other.generator = "handhold later";
  other.setVersion = 9;
  other.host = other.created = "x";
  other.seconds.clear();
  EXPECT_EQ(firstDifference(syntheticSet(), other), "");
}

// The size of a set of the demo job. Prints its times; they are no verdict.
TEST(RoundTrip, LargeSet) {
  const TestFolder folder;
  const GraspSet set = syntheticSet({.samples = 2000, .rolls = 16, .preshapes = 4, .grasps = 10'000});
  const auto since = [](auto begin) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  };
  auto begin = std::chrono::steady_clock::now();
  const fs::path path = Database(folder.path()).write(set);
  const double writeMs = since(begin);
  begin = std::chrono::steady_clock::now();
  const GraspSet copy = readGraspSet(path);
  const double readMs = since(begin);
  begin = std::chrono::steady_clock::now();
  EXPECT_EQ(readSummary(path).grasps, 10'000u);
  const double summaryMs = since(begin);
  begin = std::chrono::steady_clock::now();
  EXPECT_EQ(readInputHash(path), set.inputHash);
  const double hashMs = since(begin);
  EXPECT_EQ(firstDifference(set, copy), "");
  std::cout << "10,000 grasps, 128,000 trials: " << fs::file_size(path) << " bytes, write " << writeMs << " ms, read "
            << readMs << " ms, summary " << summaryMs << " ms, input hash " << hashMs << " ms\n";
}

}  // namespace
}  // namespace handhold
