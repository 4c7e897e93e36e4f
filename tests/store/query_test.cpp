#include "store/query.h"

#include "core/error.h"
#include "store/database.h"
#include "store/refusal.h"
#include "store/synthetic_physics.h"
#include "store/synthetic_set.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
namespace fs = std::filesystem;

constexpr double kDegree = std::numbers::pi / 180;

/// A set whose grasps differ in all that a query can ask for.
GraspSet variedSet(const std::string& object = "mug", std::size_t grasps = 40, std::uint64_t seed = 1) {
  GraspSet set = syntheticSet({.samples = 20, .rolls = 4, .preshapes = 2, .grasps = grasps}, seed);
  set.object = object;
  SyntheticNumbers numbers(seed + 100);
  for (std::size_t row = 0; row < grasps; ++row) {
    set.criticalFriction[row] = row % 7 == 3 ? std::nanf("") : static_cast<float>(0.2 + 0.2 * numbers.next());
    const Eigen::Vector4d turn(numbers.next(), numbers.next(), numbers.next(), numbers.next());
    for (int i = 0; i < 4; ++i) set.handPose[7 * row + 3 + static_cast<std::size_t>(i)] = turn.normalized()[i];
  }
  return set;
}

class Query : public testing::Test {
 protected:
  std::vector<std::size_t> rows(const GraspQuery& query) {
    answer = database.query(query);
    std::vector<std::size_t> result;
    for (const FoundSet& found : answer.sets) {
      for (const FoundGrasp& grasp : found.grasps) result.push_back(grasp.grasp);
    }
    return result;
  }
  /// The rows of `set` for which `passes(row)`.
  std::vector<std::size_t> expected(const std::function<bool(std::size_t)>& passes) const {
    std::vector<std::size_t> result;
    for (std::size_t row = 0; row < set.graspCount(); ++row) {
      if (passes(row)) result.push_back(row);
    }
    return result;
  }
  Eigen::Vector3d vector(const std::vector<float>& values, std::size_t row) const {
    return {values[3 * row], values[3 * row + 1], values[3 * row + 2]};
  }
  std::string refusal(const GraspQuery& query) {
    return refusalOf([&] { database.query(query); });
  }

  TestFolder folder;
  Database database{folder.path()};
  GraspSet set = variedSet();
  QueryAnswer answer;
};

TEST_F(Query, WithoutFiltersFindsEveryRowAsItIsStored) {
  database.write(set);
  EXPECT_EQ(rows({}), expected([](std::size_t) { return true; }));
  EXPECT_EQ(answer.setsAsked, 1u);
  EXPECT_EQ(answer.graspsAsked, 40u);
  const FoundSet& found = answer.sets.at(0);
  EXPECT_EQ(found.path, database.setPath("mug", "three-finger", 1));
  EXPECT_EQ(found.object, "mug");
  EXPECT_EQ(found.hand, "three-finger");
  EXPECT_EQ(found.setVersion, 1);
  EXPECT_EQ(found.friction, 0.4);
  EXPECT_EQ(found.passed, 40u);
  EXPECT_TRUE(std::isnan(found.coverRadius));
  EXPECT_EQ(found.jointNames, set.jointNames);
  EXPECT_EQ(found.preshapeNames, set.preshapeNames);
  for (const FoundGrasp& g : found.grasps) {
    const std::size_t row = g.grasp;
    EXPECT_THAT(g.trial, ElementsAre(set.trial[3 * row], set.trial[3 * row + 1], set.trial[3 * row + 2]));
    EXPECT_EQ(g.epsilon, set.epsilon[row]);
    EXPECT_TRUE(g.epsilonLower == set.epsilonLower[row] || (std::isnan(g.epsilonLower) && row == 39));
    EXPECT_TRUE(g.epsilonUpper == set.epsilonUpper[row] || (std::isnan(g.epsilonUpper) && row == 39));
    EXPECT_TRUE(g.criticalFriction == set.criticalFriction[row] || (std::isnan(g.criticalFriction) && row % 7 == 3));
    const double* pose = &set.handPose[7 * row];
    EXPECT_TRUE(std::equal(g.handPose.begin(), g.handPose.end(), pose));
    EXPECT_TRUE(g.X_OH.translation().isApprox(Eigen::Vector3d(pose[0], pose[1], pose[2])));
    EXPECT_NEAR(
        Eigen::Quaterniond(g.X_OH.linear()).angularDistance(Eigen::Quaterniond(pose[6], pose[3], pose[4], pose[5])), 0,
        1e-7);
    ASSERT_EQ(g.jointPosition.size(), 3);
    for (int j = 0; j < 3; ++j) {
      EXPECT_EQ(g.jointPosition[j], set.jointPosition[3 * row + static_cast<std::size_t>(j)]);
      EXPECT_EQ(g.preshapeJointPosition[j], set.preshapeJointPosition[3 * row + static_cast<std::size_t>(j)]);
    }
    EXPECT_EQ(g.targetPoint, vector(set.targetPoint, row));
    EXPECT_EQ(g.approachDirection, vector(set.approachDirection, row));
    EXPECT_EQ(g.roll, set.roll[row]);
    EXPECT_EQ(g.backoff, set.backoff[row]);
    EXPECT_EQ(g.approachClear, row % 2 == 0);
    EXPECT_EQ(g.contacts, 2 + row % 3);
  }
}

TEST_F(Query, FiltersByEachProperty) {
  database.write(set);
  GraspQuery query;
  query.minEpsilon = set.epsilon[11];
  EXPECT_EQ(rows(query), expected([&](std::size_t row) { return row <= 11; }));
  EXPECT_EQ(answer.leftOut.minEpsilon, 28u);

  query = {};
  query.friction = 0.2;
  const auto expectedRows = expected([&](std::size_t row) { return set.criticalFriction[row] <= 0.2f; });
  EXPECT_EQ(rows(query), expectedRows);
  EXPECT_EQ(answer.leftOut.unknownFriction, 6u);  // rows 3, 10, ... 38
  EXPECT_EQ(answer.leftOut.friction, 34 - expectedRows.size());
  EXPECT_GT(expectedRows.size(), 5u);
  EXPECT_LT(expectedRows.size(), 30u);

  query = {};
  query.preshape = "*_1";
  EXPECT_EQ(rows(query), expected([&](std::size_t row) { return set.trial[3 * row + 2] == 1; }));
  EXPECT_EQ(answer.leftOut.preshape, 40 - rows(query).size());

  query = {};
  query.approach = {{0.1, 0, 2}, 30 * kDegree};
  const auto near = expected([&](std::size_t row) {
    return vector(set.approachDirection, row).normalized().dot(Eigen::Vector3d(0.1, 0, 2).normalized()) >=
           std::cos(30 * kDegree);
  });
  EXPECT_EQ(rows(query), near);
  EXPECT_EQ(answer.leftOut.approach, 40 - near.size());
  EXPECT_THAT(near, testing::Not(IsEmpty()));
  query.approach->halfAngle = std::numbers::pi;
  EXPECT_THAT(rows(query), SizeIs(40));

  query = {};
  query.near = {{0.2, 0.1, 0}, 0.7};
  const auto close = expected(
      [&](std::size_t row) { return (vector(set.targetPoint, row) - Eigen::Vector3d(0.2, 0.1, 0)).norm() <= 0.7; });
  EXPECT_EQ(rows(query), close);
  EXPECT_EQ(answer.leftOut.near, 40 - close.size());
  EXPECT_THAT(close, testing::Not(IsEmpty()));
  query.near = {vector(set.targetPoint, 5), 0};  // the point itself
  EXPECT_THAT(rows(query), ElementsAre(5));
}

// The job's own friction is stored as a double, the grasp's as a float: rounding leaves nobody out.
TEST_F(Query, AGraspThatNeedsAllTheFrictionPassesThere) {
  for (const double friction : {0.1, 0.3, 0.4, 0.7, 1.0 / 3}) {
    set.object = "friction_" + std::to_string(static_cast<int>(1000 * friction));
    set.friction = friction;
    set.criticalFriction.assign(40, static_cast<float>(friction));
    database.write(set);
    GraspQuery query;
    query.object = set.object;
    query.friction = friction;
    EXPECT_THAT(rows(query), SizeIs(40)) << friction;
  }
}

TEST_F(Query, AllFiltersHoldTogetherAndTopIsPerSet) {
  database.write(set);
  GraspSet other = variedSet("box", 30, 5);
  database.write(other);
  GraspQuery query;
  query.friction = 0.3;
  query.minEpsilon = 0.01;
  query.near = {Eigen::Vector3d::Zero(), 1.2};
  const std::vector<std::size_t> all = rows(query);
  for (const FoundSet& found : answer.sets) EXPECT_GT(found.grasps.size(), 4u);
  const LeftOut& out = answer.leftOut;
  EXPECT_EQ(all.size() + out.minEpsilon + out.friction + out.unknownFriction + out.near, answer.graspsAsked);
  query.top = 4;
  EXPECT_THAT(rows(query), SizeIs(8));
  EXPECT_EQ(answer.sets[0].object, "box");
  EXPECT_EQ(answer.sets[1].object, "mug");
  EXPECT_GT(answer.sets[1].passed, 4u);
  query.top = 1000;
  EXPECT_EQ(rows(query), all);
}

TEST_F(Query, DiverseCoversWhatPasses) {
  database.write(set);
  GraspQuery query;
  query.near = {Eigen::Vector3d::Zero(), 1.1};
  const std::vector<std::size_t> all = rows(query);
  ASSERT_GT(all.size(), 12u);
  query.top = 6;
  query.diverse = true;
  const std::vector<std::size_t> chosen = rows(query);
  EXPECT_THAT(chosen, SizeIs(6));
  EXPECT_EQ(chosen[0], all[0]);
  EXPECT_TRUE(std::is_sorted(chosen.begin(), chosen.end()));
  double radius = 0;
  for (const std::size_t row : all) {
    double nearest = 1e9;
    for (const std::size_t kept : chosen) {
      const Eigen::Isometry3d a = set.X_OH(row), b = set.X_OH(kept);
      const double angle = Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
      nearest = std::min(nearest, (a.translation() - b.translation()).norm() + set.torqueScale * angle);
    }
    radius = std::max(radius, nearest);
  }
  EXPECT_NEAR(answer.sets[0].coverRadius, radius, 1e-7);
  query.top = 100;
  EXPECT_EQ(rows(query), all);
  EXPECT_EQ(answer.sets[0].coverRadius, 0);
}

TEST_F(Query, PicksSetsByNameAndVersion) {
  database.write(set);
  database.write(set);
  database.write(variedSet("mug-2"));
  database.write(variedSet("box"));
  const auto picked = [&](const GraspQuery& query) {
    std::vector<std::string> names;
    for (const FoundSet& found : database.query(query).sets) {
      names.push_back(found.object + std::to_string(found.setVersion));
    }
    return names;
  };
  GraspQuery query;
  EXPECT_THAT(picked(query), ElementsAre("box1", "mug2", "mug-21"));
  query.object = "m?g*";
  EXPECT_THAT(picked(query), ElementsAre("mug2", "mug-21"));
  query.setVersion = 1;
  EXPECT_THAT(picked(query), ElementsAre("mug1", "mug-21"));
  query.setVersion = 2;
  EXPECT_THAT(picked(query), ElementsAre("mug2"));
  query.setVersion = 3;
  EXPECT_THAT(refusal(query), HasSubstr("object \"m?g*\", hand \"*\", version 3 picks no set of "));
  query = {};
  query.hand = "jaw";
  EXPECT_THAT(refusal(query), HasSubstr("hand \"jaw\" picks no set"));
}

TEST_F(Query, AnEmptySetOrFilterIsAnEmptyAnswer) {
  set = syntheticSet({.grasps = 0});
  database.write(set);
  GraspQuery query;
  query.top = 3;
  query.diverse = true;
  query.minEpsilon = 0;
  query.friction = 0.1;
  EXPECT_THAT(rows(query), IsEmpty());
  EXPECT_EQ(answer.setsAsked, 1u);
  EXPECT_EQ(answer.graspsAsked, 0u);
  set = variedSet("box");
  database.write(set);
  query.minEpsilon = 9;
  EXPECT_THAT(rows(query), IsEmpty());
  EXPECT_EQ(answer.leftOut.minEpsilon, 40u);
}

// No set was simulated yet; one with results that cannot be read is no silent "no".
TEST_F(Query, LeavesOutWhatWasNotSimulated) {
  const fs::path path = database.write(set);
  GraspQuery query;
  query.minPhysics = 0.5;
  EXPECT_THAT(rows(query), IsEmpty());
  EXPECT_EQ(answer.leftOut.notSimulated, 40u);
  writeBytes(path.parent_path() / "physics-v0001.h5", "x");
  EXPECT_THAT(rows(query), IsEmpty());
  EXPECT_THAT(answer.failures, ElementsAre(HasSubstr("physics-v0001.h5: holds no physics results: it does not start")));
}

// Grasps 0 to 9 simulated, grasp i held in i of six directions (6 from the sixth on).
TEST_F(Query, MinPhysicsIsTheShareOfDirectionsHeld) {
  const fs::path path = database.write(set);
  const PhysicsSet physics = physicsOf(readGraspSet(path), 10);
  writePhysics(physicsPath(path), physics);
  GraspQuery query;
  query.minPhysics = 0.5;
  EXPECT_THAT(rows(query), ElementsAre(3, 4, 5, 6, 7, 8, 9));
  EXPECT_EQ(answer.leftOut.minPhysics, 3u);
  EXPECT_EQ(answer.leftOut.notSimulated, 30u);
  EXPECT_DOUBLE_EQ(answer.sets[0].grasps[1].physics, 4.0 / 6);
  query.minPhysics = 0;
  EXPECT_THAT(rows(query), SizeIs(10));
}

// Results of another set, under this one's name.
TEST_F(Query, PhysicsOfAnotherSetIsRefused) {
  const fs::path path = database.write(set);
  PhysicsSet physics = physicsOf(readGraspSet(path), 10);
  physics.inputHash = "ff";
  writePhysics(physicsPath(path), physics);
  GraspQuery query;
  query.minPhysics = 0.5;
  EXPECT_THAT(rows(query), IsEmpty());
  EXPECT_THAT(answer.failures, ElementsAre(HasSubstr("belongs to version 1 with input hash ff, want 1 with")));
}

TEST_F(Query, ADamagedSetIsNamedAndTheOthersAnswer) {
  database.write(set);
  const fs::path path = database.write(variedSet("box"));
  std::string bytes = bytesOf(path);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  fs::remove(path);
  writeBytes(path, bytes);
  EXPECT_THAT(rows({}), SizeIs(40));
  EXPECT_THAT(answer.failures, ElementsAre(HasSubstr("box/three-finger/v0001.h5: is damaged")));
}

TEST_F(Query, RefusesNonsense) {
  database.write(set);
  const double kNan = std::nan("");
  const auto expectRefusal = [&](const std::function<void(GraspQuery&)>& change, const std::string& message) {
    GraspQuery query;
    change(query);
    EXPECT_THAT(refusal(query), HasSubstr(message));
  };
  expectRefusal([](auto& q) { q.friction = 0.41; }, "friction is 0.41, want at most 0.4: ");
  expectRefusal([](auto& q) { q.friction = -1; }, "friction is -1, want a number from 0");
  expectRefusal([&](auto& q) { q.minEpsilon = kNan; }, "min-epsilon is nan, want a number");
  expectRefusal([](auto& q) { q.minPhysics = 1.5; }, "min-physics is 1.5, want a share");
  expectRefusal([](auto& q) { q.setVersion = 0; }, "set-version is 0, want a number from 1");
  expectRefusal([](auto& q) { q.top = 0; }, "top is 0, want 1 or more");
  expectRefusal([](auto& q) { q.diverse = true; }, "diverse is asked for without top");
  expectRefusal([](auto& q) { q.approach = {Eigen::Vector3d::Zero(), 1}; }, "approach is 0,0,0, want a direction");
  expectRefusal([](auto& q) { q.approach = {Eigen::Vector3d::UnitX(), 4}; }, "want 0 to 180 degrees");
  expectRefusal([&](auto& q) { q.near = {{0, kNan, 0}, 1}; }, "near is 0,nan,0, want three numbers");
  expectRefusal([](auto& q) { q.near = {{0, 0, 0}, -1}; }, "radius is -1, want metres, from 0");
  try {
    Database(folder.path() / "none").query({});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("none: is no folder, want a database"));
  }
}

}  // namespace
}  // namespace handhold
