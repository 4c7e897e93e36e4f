// Whole builds of small jobs: equal sets for any thread count, versions, failures, cancelling.
#include "build/build_job.h"
#include "build/build_set.h"
#include "build/failures.h"
#include "build/keep.h"
#include "build/mesh_hashes.h"
#include "core/error.h"
#include "quality/true_cone.h"

#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

/// Computes grasps again from what the set records of them.
void expectRecomputed(const GraspSet& set) {
  const WrenchModel model{set.centerOfMass, set.torqueScale, set.friction, set.coneEdges, set.torsionRadius};
  TrueCones cones(model);
  for (std::size_t i = 0; i < set.graspCount(); i += 3) {
    std::vector<Contact> contacts;
    for (std::size_t c = set.contactBegin[i]; c < set.contactBegin[i + 1]; ++c) {
      const auto vector = [&](const std::vector<float>& v) {
        return Eigen::Vector3d(v[3 * c], v[3 * c + 1], v[3 * c + 2]);
      };
      contacts.push_back({vector(set.contactPosition), vector(set.contactNormal), set.contactLink[c]});
    }
    const WrenchMatrix wrenches = frictionConeWrenches(contacts, model);
    EXPECT_EQ(epsilonMetric(wrenches, testForceClosure(wrenches)), set.epsilon[i]);
    const EpsilonBounds bounds = cones.epsilonBounds(contacts);
    EXPECT_EQ(bounds.lower, set.epsilonLower[i]);
    EXPECT_EQ(bounds.upper, set.epsilonUpper[i]);
    EXPECT_LE(set.epsilon[i], set.epsilonUpper[i] + 4 * kEpsilonTolerance);  // the linearised cone lies inside
    EXPECT_EQ(static_cast<float>(cones.criticalFriction(contacts).friction), set.criticalFriction[i]);
  }
}

class Build : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) /
              (std::string("build_") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  Job job(const std::string& catalog, const std::string& hands = "jaw", const std::string& more = "",
          const std::string& top = "") const {
    const std::string source = HANDHOLD_SOURCE_DIR;
    std::ofstream(folder_ / "job.yaml") << "catalog:\n"
                                        << catalog << "hands: [" << source << "/hands/" << hands << "]\n"
                                        << "sampling: {samples: 12, rolls: 3" << more << "}\nquality: {friction: 0.5}\n"
                                        << top;
    return loadJob((folder_ / "job.yaml").string());
  }

  static std::string entry(const std::string& name, const std::string& file) {
    return "  - {name: " + name + ", mesh: " HANDHOLD_SOURCE_DIR "/meshes/" + file + ", unit: m}\n";
  }

  std::vector<SetReport> build(const Job& job, const std::string& database, int threads, bool force = false) const {
    BuildOptions options;
    options.threads = threads;
    options.force = force;
    options.progress = ProgressMode::none;
    return buildJob(job, loadHands(job), Database(folder_ / database), options, never_);
  }

  fs::path folder_;
  const std::atomic<bool> never_{false};
};

TEST_F(Build, IsEqualForOneAndManyThreads) {
  const Job barrett = job(entry("t_bar", "t_bar.ply"), "barrett");
  const auto one = build(barrett, "one", 1), three = build(barrett, "three", 3);
  const GraspSet a = readGraspSet(one[0].summary.path), b = readGraspSet(three[0].summary.path);
  EXPECT_EQ(firstDifference(a, b), "");
  EXPECT_EQ(a.trialCount(), 12U * 3 * a.preshapes);
  EXPECT_GT(a.graspCount(), 0U);
}

TEST_F(Build, EveryTrialHasAnOutcomeAndTheTableAgrees) {
  const auto reports = build(job(entry("box", "box.stl"), "barrett"), "db", 2);
  const GraspSet set = readGraspSet(reports[0].summary.path);
  std::size_t closed = 0;
  for (std::size_t i = 0; i < set.trialCount(); ++i) {
    const auto outcome = static_cast<GraspOutcome>(set.outcome[i]);
    EXPECT_NE(outcome, GraspOutcome::notRun);
    EXPECT_NE(outcome, GraspOutcome::solveFailed);
    const bool positive = outcome == GraspOutcome::forceClosed || outcome == GraspOutcome::selfCollision;
    EXPECT_EQ(set.trialEpsilon[i] > 0, positive);
    closed += outcome == GraspOutcome::forceClosed ? 1 : 0;
  }
  EXPECT_EQ(closed, set.graspCount());
  for (std::size_t i = 0; i < set.graspCount(); ++i) {
    const std::size_t trial =
        (set.trial[3 * i] * set.rolls + set.trial[3 * i + 1]) * set.preshapes + set.trial[3 * i + 2];
    EXPECT_EQ(set.trialEpsilon[trial], static_cast<float>(set.epsilon[i]));
    EXPECT_EQ(set.outcome[trial], static_cast<std::uint8_t>(GraspOutcome::forceClosed));
    for (int axis = 0; axis < 3; ++axis) {  // the contract: the approach direction is the negative normal
      EXPECT_EQ(set.approachDirection[3 * i + axis], -set.sampleNormal[3 * set.trial[3 * i] + axis]);
      EXPECT_EQ(set.targetPoint[3 * i + axis], set.samplePoint[3 * set.trial[3 * i] + axis]);
    }
  }
}

// Beside the policies' results: which of them ran how many trials, and what the hand's fields took, once a run.
TEST_F(Build, SetsSayWhichPolicyRanTheirTrials) {
  const std::string objects = entry("box", "box.stl") + entry("t_bar", "t_bar.ply");
  const auto fast = build(job(objects), "fast", 2);
  const auto reference = build(job(objects, "jaw", "", "simulation: reference\n"), "reference", 2);
  for (std::size_t i = 0; i < 2; ++i) {
    ASSERT_EQ(fast[i].state, SetReport::State::built);
    const GraspSetSummary &a = fast[i].summary, &b = reference[i].summary;
    EXPECT_NE(a.inputHash, b.inputHash);
    EXPECT_EQ(b.trialsByReference, b.samples * b.rolls * b.preshapes);
    EXPECT_LE(a.trialsByReference, b.trialsByReference);
    EXPECT_FALSE(b.seconds.contains("fields"));
    EXPECT_EQ(a.seconds.at("fields") > 0, i == 0);  // counted in the first set that needs them
    for (const char* stage : {"load", "sample", "prepare", "policy", "force_closure", "epsilon", "approach", "bounds",
                              "load_margin", "table"}) {
      EXPECT_GE(a.seconds.at(stage), 0) << stage;
    }
    EXPECT_GT(a.seconds.at("policy"), 0);
  }
}

// What a set records is enough to compute each of its grasps again.
TEST_F(Build, GraspsAreRecomputedFromTheirRecord) {
  const Job mug = job(entry("mug", "mug.obj"), "barrett");
  const GraspSet set = readGraspSet(build(mug, "db", 2)[0].summary.path);
  ASSERT_GT(set.graspCount(), 3U);
  expectRecomputed(set);
}

// A hand that ships with soft fingers: two contacts are no longer too few, and every grasp is computed again from its
// record. The same hand with the default written out is another input with the same results.
TEST_F(Build, SoftFingersOfAHand) {
  const auto variant = [&](const std::string& line) {
    const fs::path hand = folder_ / "jaw";
    fs::copy(fs::path(HANDHOLD_SOURCE_DIR) / "hands" / "jaw", hand,
             fs::copy_options::recursive | fs::copy_options::overwrite_existing);
    std::ofstream(hand / "hand.yaml", std::ios::app) << line << "\n";
    Job soft = job(entry("wine_glass", "wine_glass.ply"));
    soft.handPaths = {hand.string()};
    return readGraspSet(build(soft, "db", 2)[0].summary.path);
  };
  const GraspSet point = variant("contact: {model: point}");
  const GraspSet plain = readGraspSet(build(job(entry("wine_glass", "wine_glass.ply")), "plain", 2)[0].summary.path);
  EXPECT_NE(point.inputHash, plain.inputHash);
  EXPECT_EQ(point.outcome, plain.outcome);
  EXPECT_EQ(point.epsilonLower, plain.epsilonLower);
  EXPECT_EQ(point.torsionRadius, 0);

  const GraspSet soft = variant("contact: {model: soft_finger, torsion_radius: 0.005}");
  EXPECT_EQ(soft.setVersion, 2);
  EXPECT_NE(soft.inputHash, point.inputHash);
  EXPECT_EQ(soft.torsionRadius, 0.005);
  const auto is = [](const GraspSet& set, std::size_t trial, GraspOutcome outcome) {
    return set.outcome[trial] == static_cast<std::uint8_t>(outcome);
  };
  std::size_t nNew = 0;
  for (std::size_t i = 0; i < soft.trialCount(); ++i) {
    if (is(point, i, GraspOutcome::forceClosed)) {
      EXPECT_TRUE(is(soft, i, GraspOutcome::forceClosed));
      EXPECT_GE(soft.trialEpsilon[i], point.trialEpsilon[i] - 1e-7F);  // its wrenches are among the soft ones
    }
    nNew += !is(point, i, GraspOutcome::forceClosed) && is(soft, i, GraspOutcome::forceClosed);
  }
  EXPECT_GT(nNew, 0U);
  expectRecomputed(soft);
}

// The best by epsilon have a load margin, as many as the job says; it is found again from the record.
TEST_F(Build, LoadMarginsAreOfTheBestGrasps) {
  const Job mug = job(entry("mug", "mug.obj"), "barrett");
  Job few = mug, none = mug;
  few.loadMargin = {5, 8, {}};
  none.loadMargin.grasps = 0;
  const auto report = build(few, "few", 2);
  const GraspSet set = readGraspSet(report[0].summary.path);
  ASSERT_GT(set.graspCount(), 5U);
  const Hand hand = loadHands(few)[0];
  LoadMarginSolver solver({set.centerOfMass, set.torqueScale, set.friction, set.coneEdges});
  for (std::size_t i = 0; i < set.graspCount(); ++i) {
    ASSERT_EQ(std::isnan(set.loadMargin[i]), i >= 5) << i;
    if (i >= 5) continue;
    EXPECT_GT(set.loadMargin[i], 0);
    std::vector<Contact> contacts;
    for (std::size_t c = set.contactBegin[i]; c < set.contactBegin[i + 1]; ++c) {
      const auto vector = [&](const std::vector<float>& v) {
        return Eigen::Vector3d(v[3 * c], v[3 * c + 1], v[3 * c + 2]);
      };
      contacts.push_back({vector(set.contactPosition), vector(set.contactNormal), set.contactLink[c]});
    }
    const double* pose = &set.handPose[7 * i];
    Eigen::Isometry3d X_OH(Eigen::Quaterniond(pose[6], pose[3], pose[4], pose[5]));
    X_OH.translation() = Eigen::Vector3d(pose[0], pose[1], pose[2]);
    const std::size_t nJoints = set.jointNames.size();
    const Eigen::VectorXd q =
        Eigen::Map<const Eigen::VectorXf>(&set.jointPosition[nJoints * i], static_cast<Eigen::Index>(nJoints))
            .cast<double>();
    const LoadMargin margin = evaluateLoad(solver, hand, q, X_OH, contacts, set.centerOfMass, weightDirections(8));
    EXPECT_NEAR(margin.load, set.loadMargin[i], 1e-5 * margin.load);
  }
  EXPECT_EQ(report[0].summary.loadMargins, 5U);
  EXPECT_EQ(build(none, "none", 2)[0].summary.loadMargins, 0U);

  const std::string hash = meshHash(mug.catalog[0].mesh);
  const auto inputs = [&](const Job& some) { return inputHash(some, some.catalog[0], hash, hand); };
  Job other = mug;
  other.loadMargin.taskWrenches.push_back(Eigen::Matrix<double, 6, 1>::Ones());
  EXPECT_NE(inputs(few), inputs(mug));
  EXPECT_NE(inputs(none), inputs(mug));
  EXPECT_NE(inputs(other), inputs(mug));
}

// The best by epsilon are tried under noise, as many as the job says, with one thread as with many; the record is
// enough to find the numbers again.
TEST_F(Build, RobustnessIsOfTheBestGrasps) {
  Job mug = job(entry("mug", "mug.obj"), "barrett");
  const Hand hand = loadHands(mug)[0];
  const std::string hash = meshHash(mug.catalog[0].mesh), without = inputHash(mug, mug.catalog[0], hash, hand);
  mug.robustness = {6, {2e-3, 0.03, 12}};
  EXPECT_NE(inputHash(mug, mug.catalog[0], hash, hand), without);
  const GraspSet set = readGraspSet(build(mug, "one", 1)[0].summary.path);
  EXPECT_EQ(firstDifference(set, readGraspSet(build(mug, "three", 3)[0].summary.path)), "");
  EXPECT_EQ(set.robustnessTrials, 12);
  EXPECT_EQ(set.robustnessPosition, 2e-3);
  ASSERT_GT(set.graspCount(), 6U);
  double sum = 0;
  for (std::size_t i = 0; i < set.graspCount(); ++i) {
    ASSERT_EQ(std::isnan(set.robustness[i]), i >= 6) << i;
    if (i >= 6) continue;
    EXPECT_NEAR(std::remainder(12 * set.robustness[i], 1), 0, 1e-5);
    EXPECT_LE(set.robustnessLower[i], set.robustness[i]);
    EXPECT_GE(set.robustnessUpper[i], set.robustness[i]);
    sum += set.robustness[i];
  }
  EXPECT_GT(sum, 0);
  EXPECT_LT(sum, 6);
}

// A hand whose joints have no effort: the set is built, without margins.
TEST_F(Build, AHandWithoutEffortsHasNoLoadMargins) {
  Job box = job(entry("box", "box.stl"), "barrett");
  std::vector<Hand> hands = loadHands(box);
  for (Joint& joint : hands[0].joints) joint.effort = 0;
  BuildOptions options;
  options.threads = 2;
  options.progress = ProgressMode::none;
  const auto reports = buildJob(box, hands, Database(folder_ / "db"), options, never_);
  ASSERT_EQ(reports[0].state, SetReport::State::built);
  EXPECT_GT(reports[0].summary.grasps, 0U);
  EXPECT_EQ(reports[0].summary.loadMargins, 0U);
}

TEST_F(Build, UnchangedInputsWriteNothingChangedOnesTheNextVersion) {
  const Job first = job(entry("box", "box.stl"));
  EXPECT_EQ(build(first, "db", 2)[0].state, SetReport::State::built);
  EXPECT_EQ(build(first, "db", 2)[0].state, SetReport::State::unchanged);
  EXPECT_EQ(Database(folder_ / "db").newestVersion("box", "jaw"), 1);
  const auto changed = build(job(entry("box", "box.stl"), "jaw", ", preshapes: [open_80]"), "db", 2);
  EXPECT_EQ(changed[0].state, SetReport::State::built);
  EXPECT_EQ(changed[0].summary.setVersion, 2);
  EXPECT_EQ(build(first, "db", 2, true)[0].summary.setVersion, 3);  // --force
}

TEST_F(Build, OneBadObjectDoesNotStopTheOthers) {
  std::ofstream(folder_ / "bad.stl") << "";
  const Job mixed = job("  - {name: bad, mesh: " + (folder_ / "bad.stl").string() + ", unit: m}\n" +
                        entry("box", "box.stl") + "  - {name: gone, mesh: nowhere.obj, unit: m}\n");
  const auto reports = build(mixed, "db", 2);
  ASSERT_EQ(reports.size(), 3U);
  EXPECT_EQ(reports[0].state, SetReport::State::failed);
  EXPECT_THAT(reports[0].error, HasSubstr("bad.stl"));
  EXPECT_THAT(reports[0].command, HasSubstr("--object bad --hand jaw"));
  EXPECT_EQ(reports[1].state, SetReport::State::built);
  EXPECT_EQ(reports[2].state, SetReport::State::failed);
  const Database database(folder_ / "db");
  const auto bad = readFailure(database, "bad", "jaw"), gone = readFailure(database, "gone", "jaw");
  ASSERT_TRUE(bad && gone);
  EXPECT_EQ(bad->error, reports[0].error);
  EXPECT_EQ(bad->command, reports[0].command);
  EXPECT_TRUE(bad->knownBad);
  EXPECT_FALSE(gone->knownBad);  // a file that is not there may be there the next time
  EXPECT_FALSE(readFailure(database, "box", "jaw"));
}

// What failed is left alone until its inputs change or somebody asks for it.
TEST_F(Build, KnownBadInputsAreNotTriedAgain) {
  const fs::path mesh = folder_ / "bad.stl";
  std::ofstream(mesh) << "";
  const std::string catalog =
      "  - {name: bad, mesh: " + mesh.string() + ", unit: m}\n" + entry("box", "box.stl") + entry("can", "can.ply");
  const Job all = job(catalog);
  EXPECT_FALSE(build(all, "db", 2)[0].known);
  const auto again = build(all, "db", 2);
  EXPECT_EQ(again[0].state, SetReport::State::failed);
  EXPECT_TRUE(again[0].known);
  EXPECT_THAT(again[0].error, HasSubstr("bad.stl"));
  EXPECT_THAT(again[0].command, HasSubstr("--retry-failed"));
  EXPECT_EQ(again[1].state, SetReport::State::unchanged);

  BuildOptions options;
  options.progress = ProgressMode::none;
  options.objectGlob = "box";  // a run over a part leaves the others' records
  buildJob(all, loadHands(all), Database(folder_ / "db"), options, never_);
  EXPECT_TRUE(readFailure(Database(folder_ / "db"), "bad", "jaw"));
  options.objectGlob = "*";
  EXPECT_EQ(planJob(all, loadHands(all), Database(folder_ / "db"), options)[0].state, PlannedSet::State::failed);
  options.retryFailed = true;
  EXPECT_EQ(planJob(all, loadHands(all), Database(folder_ / "db"), options)[0].state, PlannedSet::State::missing);
  EXPECT_FALSE(buildJob(all, loadHands(all), Database(folder_ / "db"), options, never_)[0].known);

  const auto other = build(job(catalog, "jaw", "", "seed: 2\n"), "db", 2);  // another parameter, another input
  EXPECT_FALSE(other[0].known);
  fs::copy_file(HANDHOLD_SOURCE_DIR "/meshes/box.stl", mesh, fs::copy_options::overwrite_existing);
  EXPECT_EQ(build(all, "db", 2)[0].state, SetReport::State::built);
  EXPECT_FALSE(readFailure(Database(folder_ / "db"), "bad", "jaw"));
}

// The disk's failure is not the input's: the set is tried again as soon as there is room.
TEST_F(Build, FailuresOfTheMachineAreNotRemembered) {
  const Job one = job(entry("box", "box.stl"));
  fs::create_directories(folder_ / "db" / "box");
  std::ofstream(folder_ / "db" / "box" / "jaw") << "in the way";
  const auto blocked = build(one, "db", 2);
  EXPECT_EQ(blocked[0].state, SetReport::State::failed);
  fs::remove(folder_ / "db" / "box" / "jaw");
  EXPECT_EQ(build(one, "db", 2)[0].state, SetReport::State::built);

  const fs::path limited = folder_ / "limited";  // the record can be written, the set cannot
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{20'000, before.rlim_max};
  ::setrlimit(RLIMIT_FSIZE, &small);
  const auto full = build(one, "limited", 2);
  ::setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(full[0].error, HasSubstr("cannot be written: File too large"));
  const auto record = readFailure(Database(limited), "box", "jaw");
  ASSERT_TRUE(record);
  EXPECT_FALSE(record->knownBad);
  EXPECT_EQ(build(one, "limited", 2)[0].state, SetReport::State::built);
}

// An object's timeout is known to come again until more time is given.
TEST_F(Build, TimeoutsFailTheirSetAlone) {
  const auto withTimeout = [&](const std::string& seconds) {
    const std::string source = HANDHOLD_SOURCE_DIR;
    std::ofstream(folder_ / "slow.yaml") << "catalog:\n"
                                         << entry("box", "box.stl") << "hands: [" << source << "/hands/jaw]\n"
                                         << "sampling: {samples: 3000, rolls: 16}\nsimulation: reference\n"
                                         << (seconds.empty() ? "" : "timeout: " + seconds + "\n");
    return loadJob((folder_ / "slow.yaml").string());
  };
  const auto slow = build(withTimeout("1.5"), "db", 1);
  ASSERT_EQ(slow[0].state, SetReport::State::failed);
  EXPECT_THAT(slow[0].error, HasSubstr("took longer than the job's timeout of 1.5 s"));
  const auto record = readFailure(Database(folder_ / "db"), "box", "jaw");
  ASSERT_TRUE(record);
  EXPECT_EQ(record->timeout, 1.5);
  EXPECT_TRUE(build(withTimeout("1"), "db", 1)[0].known);
  const std::vector<Hand> hands = loadHands(withTimeout("2"));
  EXPECT_EQ(planJob(withTimeout("2"), hands, Database(folder_ / "db"), {})[0].state, PlannedSet::State::missing);
  EXPECT_EQ(planJob(withTimeout(""), hands, Database(folder_ / "db"), {})[0].state, PlannedSet::State::missing);
  EXPECT_EQ(planJob(withTimeout("1.5"), hands, Database(folder_ / "db"), {})[0].state, PlannedSet::State::failed);
}

TEST_F(Build, EverySetIsInOneShard) {
  const Job all = job(entry("box", "box.stl") + entry("can", "can.ply") + entry("tube", "tube.obj"),
                      "jaw, " HANDHOLD_SOURCE_DIR "/hands/hrp2");
  const std::vector<Hand> hands = loadHands(all);
  for (std::size_t shards = 1; shards <= 9; ++shards) {
    std::vector<std::string> sets;
    for (std::size_t shard = 0; shard < shards; ++shard) {
      BuildOptions options;
      options.shard = shard;
      options.shards = shards;
      for (const PlannedSet& set : planJob(all, hands, Database(folder_ / "db"), options)) {
        sets.push_back(set.object + "/" + set.hand);
      }
    }
    EXPECT_THAT(sets, UnorderedElementsAre("box/jaw", "box/hrp2", "can/jaw", "can/hrp2", "tube/jaw", "tube/hrp2"))
        << shards << " shards";
  }
}

// Eight tasks for seven sets: one has nothing to do, and says so by doing nothing.
TEST_F(Build, AnEmptyShardIsDone) {
  const Job one = job(entry("box", "box.stl"));
  BuildOptions options;
  options.progress = ProgressMode::none;
  options.shard = 1;
  options.shards = 2;
  EXPECT_TRUE(buildJob(one, loadHands(one), Database(folder_ / "db"), options, never_).empty());
}

TEST_F(Build, CancelLeavesNoTrace) {
  const Job one = job(entry("box", "box.stl"));
  std::atomic<bool> cancel{true};
  BuildOptions options;
  options.progress = ProgressMode::none;
  const auto reports = buildJob(one, loadHands(one), Database(folder_ / "db"), options, cancel);
  ASSERT_EQ(reports.size(), 1U);
  EXPECT_EQ(reports[0].state, SetReport::State::stopped);
  EXPECT_FALSE(fs::exists(folder_ / "db" / "box"));
}

// The paper's claim: facing the surface normal gives more force-closed grasps than approaching the centre.
TEST_F(Build, CenterOfMassPolicyBuildsASet) {
  const auto reports = build(job(entry("t_bar", "t_bar.ply"), "barrett", ", policy: center_of_mass"), "db", 2);
  ASSERT_EQ(reports[0].state, SetReport::State::built);
  const GraspSet set = readGraspSet(reports[0].summary.path);
  EXPECT_EQ(set.policy, "center_of_mass");
  EXPECT_EQ(set.samples, 12U);
  for (std::size_t i = 0; i < set.graspCount(); ++i) {  // the approach leads through the centre of mass
    const Eigen::Vector3d p(set.targetPoint[3 * i], set.targetPoint[3 * i + 1], set.targetPoint[3 * i + 2]);
    const Eigen::Vector3d d(set.approachDirection[3 * i], set.approachDirection[3 * i + 1],
                            set.approachDirection[3 * i + 2]);
    EXPECT_LT((set.centerOfMass - p).cross(d).norm(), 1e-6);
  }
}

std::vector<KeptGrasp> someGrasps() {
  std::vector<KeptGrasp> grasps;
  for (int i = 0; i < 30; ++i) {
    KeptGrasp grasp;
    grasp.trial = static_cast<std::size_t>(i);
    grasp.epsilon = 1 - 0.01 * i;
    grasp.X_OH =
        Eigen::Isometry3d(Eigen::Translation3d(i < 25 ? 0.001 * i : 1.0 * i, 0, 0));  // a cluster and five far away
    grasps.push_back(grasp);
  }
  return grasps;
}

TEST(KeepGrasps, TopKeepsTheBest) {
  std::vector<KeptGrasp> grasps = someGrasps();
  keepGrasps(grasps, 5, false, 0.1);
  ASSERT_EQ(grasps.size(), 5U);
  EXPECT_EQ(grasps.back().trial, 4U);
}

TEST(KeepGrasps, DiverseKeepsTheBestAndThoseFarApartInOrder) {
  std::vector<KeptGrasp> grasps = someGrasps();
  keepGrasps(grasps, 6, true, 0.1);
  ASSERT_EQ(grasps.size(), 6U);
  EXPECT_EQ(grasps[0].trial, 0U);
  for (std::size_t i = 1; i < 6; ++i) EXPECT_EQ(grasps[i].trial, 24 + i);
}

TEST(KeepGrasps, ZeroKeepsAll) {
  std::vector<KeptGrasp> grasps = someGrasps();
  keepGrasps(grasps, 0, true, 0.1);
  EXPECT_EQ(grasps.size(), 30U);
}

}  // namespace
}  // namespace handhold
