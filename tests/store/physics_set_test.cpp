#include "store/physics_set.h"

#include "store/refusal.h"
#include "store/synthetic_physics.h"
#include "store/synthetic_set.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

class PhysicsFile : public testing::Test {
 protected:
  std::string refusal(const std::string& bytes) {
    const fs::path path = folder.path() / "physics-v0001.h5";
    writeBytes(path, bytes);
    return refusalOf([&] { readPhysics(path); });
  }

  TestFolder folder;
  PhysicsSet physics = physicsOf(syntheticSet({.samples = 20, .rolls = 4, .preshapes = 2, .grasps = 40}, 1), 8);
};

TEST_F(PhysicsFile, EveryNumberComesBack) {
  const fs::path path = folder.path() / "physics-v0001.h5";
  physics.generator = "test";
  physics.mass = 0.3;
  writePhysics(path, physics);
  const PhysicsSet read = readPhysics(path);
  EXPECT_EQ(read.object, physics.object);
  EXPECT_EQ(read.inputHash, physics.inputHash);
  EXPECT_EQ(read.settings, physics.settings);
  EXPECT_EQ(read.generator, "test");
  EXPECT_EQ(read.mass, 0.3);
  EXPECT_EQ(read.grasp, physics.grasp);
  EXPECT_EQ(read.outcome, physics.outcome);
  EXPECT_EQ(read.settledContacts, physics.settledContacts);
  EXPECT_EQ(read.squeeze, physics.squeeze);
  EXPECT_EQ(read.fallSeconds, physics.fallSeconds);
  EXPECT_EQ(read.directionNames, physics.directionNames);
  const std::string bytes = bytesOf(path);
  writePhysics(path, read);  // over itself
  EXPECT_EQ(bytesOf(path), bytes);
}

TEST_F(PhysicsFile, SharesAndCountsAreOfTheDirectionsHeld) {
  EXPECT_EQ(countHeld(physics, "pull"), 2u);  // grasps 6 and 7
  const std::vector<double> held = shareHeld(physics, 40);
  EXPECT_DOUBLE_EQ(held[0], 0);
  EXPECT_DOUBLE_EQ(held[3], 0.5);
  EXPECT_DOUBLE_EQ(held[7], 1);
  EXPECT_TRUE(std::isnan(held[8]));
}

TEST_F(PhysicsFile, DamageIsTold) {
  const fs::path path = folder.path() / "whole";
  writePhysics(path, physics);
  std::string bytes = bytesOf(path);
  EXPECT_THAT(refusal(""), HasSubstr("physics-v0001.h5: holds no physics results"));
  EXPECT_THAT(refusal(bytes.substr(0, bytes.size() - 1)), HasSubstr("is damaged: the checksum"));
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  EXPECT_THAT(refusal(bytes), HasSubstr("is damaged: the checksum"));
}

TEST_F(PhysicsFile, ContradictionsAreRefused) {
  const fs::path path = folder.path() / "physics-v0001.h5";
  const auto message = [&](const PhysicsSet& wrong) { return refusalOf([&] { writePhysics(path, wrong); }); };
  PhysicsSet wrong = physics;
  wrong.rotation.pop_back();
  EXPECT_THAT(message(wrong), HasSubstr("/load/rotation has 47 numbers, want shape (8, 6)"));
  wrong = physics;
  wrong.outcome[3] = 2;
  EXPECT_THAT(message(wrong), HasSubstr("/load/outcome is 2 at element 3, want below 2"));
  wrong = physics;
  std::swap(wrong.grasp[0], wrong.grasp[1]);
  EXPECT_THAT(message(wrong), HasSubstr("/grasp row 1 is 0 after 1, want rising numbers"));
  EXPECT_FALSE(fs::exists(path));
}

}  // namespace
}  // namespace handhold
