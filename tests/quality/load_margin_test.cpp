#include "quality/load_margin.h"

#include "bench/grasp_like_actuation.h"
#include "quality/references.h"
#include "support/random_contacts.h"
#include "support/sanitized.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using bench::graspLikeActuation;
using bench::graspLikeContacts;
using bench::withNormalLimits;
using testing::randomContacts;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Relative. The solver stops within 1e-7, GLPK and CLP keep rows to 1e-9.
constexpr double kLoadTol = 1e-6;
constexpr double kFriction = 0.5;
constexpr double kReach = 0.03;  // m, of a jaw's contact from the centre
#ifdef HANDHOLD_SANITIZED
constexpr int kCases = 30;
#else
constexpr int kCases = 300;
#endif

WrenchModel model(double friction = kFriction, double torqueScale = 0.05) {
  return {{0, 0, 0}, torqueScale, friction, 8};
}

/// Two points on the x axis; the tangents of their cones are y and z, so that the cones are exact along both.
std::vector<Contact> jaws() { return {{{kReach, 0, 0}, {-1, 0, 0}, 0}, {{-kReach, 0, 0}, {1, 0, 0}, 1}}; }

/// A jaw each, sliding along x.
Actuation independentJaws(double effort) {
  Actuation actuation;
  actuation.motion = Eigen::MatrixXd::Zero(12, 2);
  actuation.motion(0, 0) = 1;
  actuation.motion(6, 1) = -1;
  actuation.effort = Eigen::Vector2d(effort, effort);
  return actuation;
}

TaskWrenches task(const Vector6d& wrench) { return TaskWrenches(wrench); }
Vector6d along(int axis) { return Vector6d::Unit(axis); }

double loadOf(const std::vector<Contact>& contacts, const Actuation& actuation, const TaskWrenches& tasks,
              const WrenchModel& with = model()) {
  return LoadMarginSolver(with).solve(contacts, actuation, tasks).load;
}

// Each jaw presses with F; friction holds 2 mu F across, the jaws' own force F along the line between them.
TEST(LoadMargin, IndependentJaws) {
  const Actuation actuation = independentJaws(20);
  for (const int axis : {1, 2}) {
    EXPECT_NEAR(loadOf(jaws(), actuation, task(along(axis))), 2 * kFriction * 20, kLoadTol * 20);
    EXPECT_NEAR(loadOf(jaws(), actuation, task(-along(axis))), 2 * kFriction * 20, kLoadTol * 20);
  }
  EXPECT_NEAR(loadOf(jaws(), actuation, task(along(0))), 20, kLoadTol * 20);
  // A torque about y or z: friction at the two points, its arm the reach.
  EXPECT_NEAR(loadOf(jaws(), actuation, task(along(4))), 2 * kFriction * 20 * kReach, kLoadTol);
  EXPECT_NEAR(loadOf(jaws(), actuation, task(along(5))), 2 * kFriction * 20 * kReach, kLoadTol);
  TaskWrenches both(6, 2);
  both << along(0), along(2);
  EXPECT_NEAR(loadOf(jaws(), actuation, both), 20, kLoadTol * 20);
  // About the line itself points resist nothing.
  const LoadMargin spin = LoadMarginSolver(model()).solve(jaws(), actuation, task(along(3)));
  EXPECT_EQ(spin.verdict, LoadVerdict::zero);
  EXPECT_EQ(spin.load, 0);
}

// One drive presses both jaws: it bears the sum of their forces.
TEST(LoadMargin, CoupledJaws) {
  const Actuation apart = independentJaws(8);
  Actuation coupled;
  coupled.motion = apart.motion.rowwise().sum();
  coupled.effort = Eigen::VectorXd::Constant(1, 20);
  EXPECT_NEAR(loadOf(jaws(), coupled, task(along(2))), kFriction * 20, kLoadTol * 20);
  EXPECT_NEAR(loadOf(jaws(), coupled, task(along(0))), 20, kLoadTol * 20);
  // What the follower's transmission bears limits its jaw: N2 <= 8, N1 + N2 <= 20, N1 = N2 across.
  coupled.motion.conservativeResize(12, 2);
  coupled.motion.col(1) = apart.motion.col(1);
  coupled.effort = Eigen::Vector2d(20, 8);
  EXPECT_NEAR(loadOf(jaws(), coupled, task(along(2))), 2 * kFriction * 8, kLoadTol * 20);
  EXPECT_NEAR(loadOf(jaws(), coupled, task(-along(0))), 8, kLoadTol * 20);
  EXPECT_NEAR(loadOf(jaws(), coupled, task(along(0))), 20, kLoadTol * 20);
}

// A lever: the joint's torque over its arm is the normal force.
TEST(LoadMargin, RevoluteJaws) {
  constexpr double kArm = 0.08, kTorque = 2;
  Actuation actuation;
  actuation.motion = Eigen::MatrixXd::Zero(12, 2);
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d axis = (i == 0 ? -1 : 1) * Eigen::Vector3d::UnitY();
    const Eigen::Vector3d origin(i == 0 ? kReach : -kReach, 0, -kArm);
    actuation.motion.col(i).segment<3>(6 * i) = axis.cross(-origin);
    actuation.motion.col(i).segment<3>(6 * i + 3) = axis;
  }
  actuation.effort = Eigen::Vector2d(kTorque, kTorque);
  const double force = kTorque / kArm;
  EXPECT_NEAR(loadOf(jaws(), actuation, task(along(1))), 2 * kFriction * force, kLoadTol * force);
  // Along z the friction passes through the axis and loads no joint.
  EXPECT_NEAR(loadOf(jaws(), actuation, task(along(2))), 2 * kFriction * force, kLoadTol * force);
}

TEST(LoadMargin, NormalForceLimits) {
  Actuation none;
  none.motion.resize(12, 0);
  const Actuation limited = withNormalLimits(none, jaws(), 5);
  EXPECT_NEAR(loadOf(jaws(), limited, task(along(1))), 2 * kFriction * 5, kLoadTol * 5);
}

// A grasp-like instance, or joints that press along random normals. Its sizes depend on the seed.
struct Instance {
  std::vector<Contact> contacts;
  Actuation actuation;
  TaskWrenches tasks;
  WrenchModel with;
};
Instance instance(int seed) {
  const int nContacts = 3 + seed % 8;
  Instance result;
  if (seed % 2 == 0) {
    result.contacts = graspLikeContacts(seed, nContacts);
    result.actuation = graspLikeActuation(result.contacts, seed);
    result.with = model(0.3 + 0.1 * (seed % 5), 0.09);
  } else {
    result.contacts = randomContacts(seed, nContacts, 0.3);
    Actuation none;
    none.motion.resize(6 * nContacts, 0);
    result.actuation = withNormalLimits(none, result.contacts, 1);
    for (int d = 0; d < nContacts; ++d) result.actuation.effort[d] = 1 + d % 3;
    result.with = model(0.3 + 0.1 * (seed % 5), 1);
  }
  result.tasks = weightDirections(6 + seed % 3);
  result.tasks.col(0) << 0.3, 0, 0.2, 0.01, -0.02, 0.005;
  return result;
}

TEST(LoadMargin, AgreesWithGlpk) {
  int nOptimal = 0, nZero = 0;
  for (int seed = 0; seed < kCases; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance some = instance(seed);
    const LoadMargin margin = LoadMarginSolver(some.with).solve(some.contacts, some.actuation, some.tasks);
    const double byGlpk = testing::glpkLoad(testing::taskProgram(some.contacts, some.actuation, some.tasks, some.with));
    ASSERT_NE(margin.verdict, LoadVerdict::failed);
    if (margin.verdict == LoadVerdict::unbounded) {
      EXPECT_EQ(byGlpk, HUGE_VAL);
    } else {
      EXPECT_NEAR(margin.load, byGlpk, kLoadTol * byGlpk + 1e-7);
      EXPECT_GE(margin.load + margin.gap, byGlpk * (1 - kLoadTol));
      nZero += margin.verdict == LoadVerdict::zero;
      nOptimal += margin.verdict == LoadVerdict::optimal;
    }
  }
  EXPECT_GT(nOptimal, kCases / 2);
  EXPECT_GT(nZero, 0);
}

// The tasks share nothing but the load: the margin is the least of theirs.
TEST(LoadMargin, IsTheLeastOfItsTasks) {
  for (int seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const Instance some = instance(seed);
    double least = HUGE_VAL;
    for (Eigen::Index t = 0; t < some.tasks.cols(); ++t) {
      least = std::min(least, loadOf(some.contacts, some.actuation, task(some.tasks.col(t)), some.with));
    }
    const double load = loadOf(some.contacts, some.actuation, some.tasks, some.with);
    if (std::isinf(least)) {
      EXPECT_EQ(load, least);
    } else {
      EXPECT_NEAR(load, least, kLoadTol * least);
    }
  }
}

TEST(LoadMargin, GrowsWithEffortAndFriction) {
  for (int seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Instance some = instance(seed);
    const double load = loadOf(some.contacts, some.actuation, some.tasks, some.with);
    WrenchModel rougher = some.with;
    rougher.friction *= 1.3;
    EXPECT_GE(loadOf(some.contacts, some.actuation, some.tasks, rougher), load * (1 - kLoadTol));
    Instance stronger = some;
    stronger.actuation.effort *= 3;
    const double threefold = loadOf(some.contacts, stronger.actuation, some.tasks, some.with);
    if (std::isfinite(load)) {
      EXPECT_NEAR(threefold, 3 * load, 3 * kLoadTol * load);
    }
    stronger.actuation.effort = some.actuation.effort;
    stronger.actuation.effort[0] *= 2;
    EXPECT_GE(loadOf(some.contacts, stronger.actuation, some.tasks, some.with), load * (1 - kLoadTol));
    stronger.tasks = 2 * some.tasks;  // a load that weighs twice as much
    if (std::isfinite(load)) {
      EXPECT_NEAR(loadOf(some.contacts, some.actuation, stronger.tasks, some.with), load / 2, kLoadTol * load);
    }
  }
}

TEST(LoadMargin, DegenerateSets) {
  LoadMarginSolver solver(model());
  Actuation none;
  none.motion.resize(0, 0);
  EXPECT_EQ(solver.solve({}, none, weightDirections(6)).verdict, LoadVerdict::zero);
  EXPECT_EQ(solver.solve({}, none, TaskWrenches(6, 0)).verdict, LoadVerdict::unbounded);
  EXPECT_EQ(solver.solve({}, none, TaskWrenches::Zero(6, 3)).verdict, LoadVerdict::unbounded);
  const std::vector<Contact> one = {jaws()[0]};
  Actuation push;
  push.motion = independentJaws(5).motion.topLeftCorner(6, 1);
  push.effort = Eigen::VectorXd::Constant(1, 5);
  EXPECT_EQ(solver.solve(one, push, weightDirections(6)).verdict, LoadVerdict::zero);
  // Pushed against the one contact, the object rests on it.
  EXPECT_NEAR(solver.solve(one, push, task(along(0))).load, 5, 5 * kLoadTol);
  EXPECT_EQ(solver.solve(jaws(), independentJaws(5), weightDirections(6)).verdict, LoadVerdict::optimal);
  // A joint whose contact passes through it bears anything.
  Actuation through = independentJaws(5);
  through.motion.setZero();
  EXPECT_EQ(solver.solve(jaws(), through, task(along(2))).verdict, LoadVerdict::unbounded);
  EXPECT_EQ(solver.solve(jaws(), through, task(along(2))).load, std::numeric_limits<double>::infinity());
  // Twice the same contacts are the same cones.
  for (int seed = 0; seed < 10; ++seed) {
    const Instance some = instance(seed);
    std::vector<Contact> twice = some.contacts;
    twice.insert(twice.end(), some.contacts.begin(), some.contacts.end());
    Actuation actuation = some.actuation;
    actuation.motion = some.actuation.motion.replicate(2, 1);
    const double load = loadOf(some.contacts, some.actuation, some.tasks, some.with);
    EXPECT_NEAR(loadOf(twice, actuation, some.tasks, some.with), load, kLoadTol * load) << seed;
  }
}

// No joint at all: whatever is force closed bears any load, the rest none in some direction.
TEST(LoadMargin, WithoutJointsItIsForceClosure) {
  for (int seed = 0; seed < 40; ++seed) {
    const std::vector<Contact> contacts = randomContacts(seed, 3 + seed % 6, 0.3);
    Actuation none;
    none.motion.resize(6 * static_cast<Eigen::Index>(contacts.size()), 0);
    TaskWrenches tasks(6, 12);
    tasks << Eigen::Matrix<double, 6, 6>::Identity(), -Eigen::Matrix<double, 6, 6>::Identity();
    const bool closed = testForceClosure(frictionConeWrenches(contacts, model(0.5, 1))).verdict == ForceClosure::closed;
    EXPECT_EQ(LoadMarginSolver(model(0.5, 1)).solve(contacts, none, tasks).verdict,
              closed ? LoadVerdict::unbounded : LoadVerdict::zero)
        << seed;
  }
}

TEST(LoadMargin, NumbersThatAreNoneFail) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  LoadMarginSolver solver(model());
  std::vector<Contact> contacts = jaws();
  contacts[0].position.x() = nan;
  Actuation actuation = independentJaws(5);
  EXPECT_EQ(solver.solve(contacts, actuation, weightDirections(6)).verdict, LoadVerdict::failed);
  EXPECT_TRUE(std::isnan(solver.solve(contacts, actuation, weightDirections(6)).load));
  actuation.motion(0, 0) = nan;
  EXPECT_EQ(solver.solve(jaws(), actuation, weightDirections(6)).verdict, LoadVerdict::failed);
  EXPECT_EQ(solver.solve(jaws(), independentJaws(5), nan * weightDirections(6)).verdict, LoadVerdict::failed);
}

// Analyses and memory of other grasps change no bit.
TEST(LoadMargin, DoesNotDependOnWhatWasSolvedBefore) {
  std::vector<double> fresh;
  for (int seed = 0; seed < 24; seed += 2) {
    const Instance some = instance(seed);
    fresh.push_back(loadOf(some.contacts, some.actuation, some.tasks, model(0.5, 0.09)));
  }
  LoadMarginSolver kept(model(0.5, 0.09));
  for (int pass = 0; pass < 2; ++pass) {
    for (int seed = 22; seed >= 0; seed -= 2) {
      const Instance some = instance(seed);
      const double load = kept.solve(some.contacts, some.actuation, some.tasks).load;
      EXPECT_EQ(load, fresh[static_cast<std::size_t>(seed / 2)]) << seed;
    }
  }
}

// The factorisation is the simplicial one, which has no use for a BLAS and its threads.
TEST(LoadMargin, StartsNoThreads) {
  const auto threads = [] {
    const std::filesystem::directory_iterator tasks("/proc/self/task");
    return std::distance(begin(tasks), end(tasks));
  };
  const auto before = threads();
  const std::vector<Contact> contacts = graspLikeContacts(1, 16);
  const LoadMargin margin =
      LoadMarginSolver(model(0.5, 0.09)).solve(contacts, graspLikeActuation(contacts, 1), weightDirections(50));
  EXPECT_EQ(margin.verdict, LoadVerdict::optimal);
  EXPECT_EQ(threads(), before);
}

TEST(WeightDirections, AreSpreadOverTheSphere) {
  constexpr double kWidestGap = 1.3;  // rad at 6 directions; the octahedron's is 0.96
  for (const int count : {6, 14, 50}) {
    const TaskWrenches tasks = weightDirections(count);
    ASSERT_EQ(tasks.cols(), count);
    EXPECT_LT((tasks.topRows<3>().colwise().norm().array() - 1).abs().maxCoeff(), 1e-12);
    EXPECT_TRUE(tasks.bottomRows<3>().isZero(0));
    const RandomStream stream(5);
    for (std::uint64_t i = 0; i < 200; ++i) {
      const Eigen::Vector3d d = testing::randomUnitVector(stream, 2 * i);
      const double nearest = (d.transpose() * tasks.topRows<3>()).maxCoeff();
      EXPECT_GT(nearest, std::cos(kWidestGap * std::sqrt(6.0 / count))) << count;
    }
  }
}

}  // namespace
}  // namespace handhold
