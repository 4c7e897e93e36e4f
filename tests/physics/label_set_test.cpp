#include "physics/label_set.h"

#include "core/error.h"
#include "core/hash.h"
#include "store/synthetic_set.h"
#include "support/toy_box_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

const Hand& jaw() {
  static const Hand hand = loadHand(HANDHOLD_SOURCE_DIR "/hands/jaw");
  return hand;
}

/// The toy box of 50 x 80 x 120 mm with the jaw around it; made once.
class LabelSet : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const TestFolder database;
    set = SetLoader().load(Database(database.path()).write(handhold::testing::toyBoxSet(jaw())));
  }
  static void TearDownTestSuite() { set.reset(); }

  std::optional<PhysicsSet> label(std::size_t top, int threads, const std::optional<PhysicsSet>& known = {}) {
    return labelSet(*set, {{PhysicsTest::pull}, top}, known, folder.path(), JobSystem(threads), counters, cancel);
  }

  static inline std::unique_ptr<SimulatedSet> set;
  TestFolder folder;
  BuildCounters counters;
  std::atomic<bool> cancel = false;
};

TEST_F(LabelSet, EqualForAnyNumberOfThreads) {
  const auto one = label(2, 1), three = label(2, 3);
  ASSERT_TRUE(one && three);
  EXPECT_EQ(counters.trials, 4u);
  writePhysics(folder.path() / "one", *one);
  writePhysics(folder.path() / "three", *three);
  EXPECT_EQ(bytesOf(folder.path() / "one"), bytesOf(folder.path() / "three"));
  EXPECT_EQ(one->friction, 1.5 * set->set().friction);
  EXPECT_EQ(one->grasp, (std::vector<std::uint32_t>{0, 1}));
}

// What is known is taken over, unless the settings are others.
TEST_F(LabelSet, KnownGraspsAreNotSimulatedAgain) {
  const auto first = label(1, 1);
  ASSERT_TRUE(first);
  PhysicsSet known = *first;
  known.displacement[0] = 0.0123f;  // a mark
  EXPECT_EQ(label(1, 1, known)->displacement[0], 0.0123f);
  known.settings += "other\n";
  EXPECT_EQ(label(1, 1, known)->displacement[0], first->displacement[0]);
}

TEST_F(LabelSet, StoppedItLeavesNothing) {
  cancel = true;
  EXPECT_FALSE(label(1, 1));
}

// The chunk of a run that was stopped after it is taken over, a damaged one is not.
TEST_F(LabelSet, GoesOnWhereItWasStopped) {
  const auto whole = label(1, 1);
  ASSERT_TRUE(whole);
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    EXPECT_FALSE(entry.path().filename().string().starts_with(".chunks")) << "a whole set leaves no chunks";
  }
  PhysicsSet chunk = *whole;
  chunk.displacement[0] = 0.0123f;
  const std::string key = chunk.inputHash + chunk.settings;
  const fs::path chunks = folder.path() / (".chunks-physics-" + hashBytes(key.data(), key.size()));
  fs::create_directories(chunks);
  writePhysics(chunks / "000000", chunk);
  EXPECT_EQ(label(1, 1)->displacement[0], 0.0123f);
  fs::create_directories(chunks);
  writeBytes(chunks / "000000", "damaged");
  EXPECT_EQ(label(1, 1)->displacement[0], whole->displacement[0]);
}

TEST(CatalogMass, IsThatOfTheEntry) {
  const char* job =
      "catalog:\n"
      "  - {name: mug, mesh: meshes/a.obj, unit: m, mass: 0.3}\n"
      "  - {mesh: meshes/part.stl, mass: 0.5}\n"
      "  - {name: bare, mesh: meshes/b.obj}\n"
      "  - {folder: ycb, glob: \"004_*\", mass: 0.514}\n";
  EXPECT_EQ(catalogMass(job, "mug"), 0.3);
  EXPECT_EQ(catalogMass(job, "part"), 0.5);
  EXPECT_EQ(catalogMass(job, "bare"), 0);
  EXPECT_EQ(catalogMass(job, "004_sugar_box"), 0.514);
  EXPECT_EQ(catalogMass(job, "other"), 0);
  EXPECT_EQ(catalogMass("no: [job", "mug"), 0);
}

}  // namespace
}  // namespace handhold
