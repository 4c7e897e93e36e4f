// The paper's score against its formula, and the order of the reach score.
#include "rank/score.h"

#include "core/error.h"
#include "rank/reach.h"
#include "robot/inverse_kinematics.h"
#include "scene/distance_map.h"
#include "store/synthetic_calibration.h"
#include "support/toy_box_set.h"

#include <numbers>

#include <gtest/gtest.h>

namespace handhold::testing {
namespace {

class Score : public ::testing::Test {
 protected:
  static std::string source() { return HANDHOLD_SOURCE_DIR; }
  Hand jaw_ = loadHand(source() + "/hands/jaw");
  GraspTable table_ = makeGraspTable(toyBoxSet(jaw_), "toy", jaw_);
  ScoreCoefficients coefficients_{.c1 = 1.5, .c2 = 0.7, .c3 = 2.5, .far = 0.4};
};

TEST_F(Score, IsThePapersProduct) {
  std::vector<float> D(table_.mapPoint.size() / 3);
  for (std::size_t i = 0; i < D.size(); ++i) D[i] = 0.001f * static_cast<float>(i);
  const Eigen::Isometry3d X_WO = Eigen::Translation3d(0.5, 0.2, 0.1) * Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY());
  const Eigen::Vector3d p_WS(0, 0, 0.6);
  std::vector<GraspScore> scores;
  scorePaper(table_, 0, X_WO, p_WS, D, coefficients_, scores);
  ASSERT_EQ(scores.size(), table_.grasps.size());
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const StoredGrasp& grasp = table_.grasps[i];
    const Eigen::Vector3d v = X_WO * table_.centerOfMass - p_WS, a = X_WO.linear() * grasp.approach;
    double ge = 0;
    for (int k = 0; k < table_.neighbors; ++k) {
      const std::size_t at = i * static_cast<std::size_t>(table_.neighbors) + static_cast<std::size_t>(k);
      ge += table_.mapWeight[at] * D[table_.mapNeighbor[at]];
    }
    EXPECT_NEAR(scores[i].gq, grasp.epsilon / table_.grasps[0].epsilon, 1e-6);
    EXPECT_NEAR(scores[i].gb, std::cos(std::acos(a.dot(v) / v.norm())), 1e-6);
    EXPECT_NEAR(scores[i].ge, ge / 0.4, 1e-6);
    EXPECT_NEAR(scores[i].score,
                std::exp(1.5 * scores[i].gq) * std::exp(0.7 * scores[i].gb) * std::exp(2.5 * scores[i].ge), 1e-6);
  }
  sortScores(scores);
  for (std::size_t i = 1; i < scores.size(); ++i) EXPECT_GE(scores[i - 1].score, scores[i].score);
}

TEST_F(Score, AWallCostsTheGraspsThatComeFromIt) {
  SceneRays rays;
  rays.update({{"wall", makeBoxShape({1, 0.02, 1}), Eigen::Isometry3d(Eigen::Translation3d(0, -0.15, 0))}});
  std::vector<float> D;
  DistanceMap().compute(rays, table_.mapPoint, table_.mapNormal, Eigen::Isometry3d::Identity(), D);
  std::vector<GraspScore> scores;
  scorePaper(table_, 0, Eigen::Isometry3d::Identity(), {0, 0, 1}, D, {}, scores);
  // Approach along +y comes from y < 0: first and last pairs of the set are -90 and 90 degrees from straight down.
  EXPECT_LT(table_.grasps[0].approach.y(), -0.99);
  EXPECT_GT(table_.grasps[24].approach.y(), 0.99);
  EXPECT_LT(scores[24].ge, 0.3);
  EXPECT_GT(scores[0].ge, 0.9);
}

TEST_F(Score, SidewaysIsAwayFromWhatRests) {
  // A hand with one finger at rest: the jaw with its second finger called a palm.
  GraspSet set = toyBoxSet(jaw_);
  for (const StoredGrasp& grasp : table_.grasps) EXPECT_TRUE(grasp.sideways.isZero());  // both fingers close
  for (std::uint16_t& link : set.contactLink) {
    if (link == 2) link = 0;  // of the housing
  }
  const GraspTable table = makeGraspTable(set, "toy", jaw_);
  for (std::size_t i = 0; i < table.grasps.size(); ++i) {
    // Finger 2 stands at -x of the palm frame: the hand comes in a little that way.
    const Eigen::Vector3d x = (table.grasps[i].X_OH * jaw_.X_LG).linear().col(0);
    EXPECT_TRUE(table.grasps[i].sideways.isApprox(-x, 1e-6)) << table.grasps[i].sideways.transpose();
  }
}

TEST_F(Score, ReachPutsWhatCannotBeDoneLast) {
  const Robot robot = loadRobot(source() + "/robots/panda");
  const ArmChain chain = makeChain(robot, 0);
  const auto ik = makeInverseKinematics(chain);
  const ReachScorer scorer(robot, 0);
  const Eigen::Isometry3d X_WO(Eigen::Translation3d(0.5, 0, 0.1));
  const ReachArm arm{Eigen::Isometry3d::Identity(), forwardKinematics(robot.body, robot.home)[robot.arms[0].baseLink],
                     ik.get(), robot.home};
  const auto floor = std::make_shared<SignedDistance>(makeBoxShape({0.4, 0.4, 0.1}));
  std::vector<GraspScore> scores;
  const std::vector<bool> free(table_.grasps.size(), true);
  scorer.score(table_, free, arm, X_WO, {{floor, Eigen::Isometry3d(Eigen::Translation3d(0.5, 0, 0.09))}}, scores);
  ASSERT_EQ(scores.size(), table_.grasps.size());
  sortScores(scores);
  // From above is clear of what the box stands in up to 40 mm; from the side the hand is in it.
  EXPECT_EQ(scores.front().gb, 1.0f);
  EXPECT_GT(scores.front().ge, 0.9f);
  EXPECT_LT(table_.grasps[scores.front().grasp].approach.z(), -0.5);
  EXPECT_EQ(scores.back().ge, 0.0f);
  // Where nothing can be reached, nothing is called reached.
  scores.clear();
  scorer.score(table_, free, arm, Eigen::Isometry3d(Eigen::Translation3d(3, 0, 0.1)), {}, scores);
  for (const GraspScore& score : scores) EXPECT_EQ(score.gb, 0.0f);
  // Nor where the hand would meet the target on its way.
  scores.clear();
  scorer.score(table_, std::vector<bool>(table_.grasps.size(), false), arm, X_WO, {}, scores);
  for (const GraspScore& score : scores) EXPECT_LT(score.score, 0.01);
}

// Where clearance and position are equal, the calibrated probability decides, in both scores.
TEST_F(Score, ACalibrationTakesThePlaceOfEpsilon) {
  GraspSet set = toyBoxSet(jaw_);
  for (std::size_t i = 0; i < set.graspCount(); ++i) {  // against the order of epsilon
    set.criticalFriction[i] = 0.4F - 0.01F * static_cast<float>(i);
  }
  const HoldCalibration calibration = calibrationFor(set);
  const std::vector<double> probabilities = holdProbabilities(calibration, set, "toy");
  const GraspTable table = makeGraspTable(set, "toy", jaw_, &calibration);
  const std::vector<float> D(table.mapPoint.size() / 3, 0.1F);
  std::vector<GraspScore> scores;
  scorePaper(table, 0, Eigen::Isometry3d::Identity(), {0, 0, 1}, D, {.c1 = 1, .c2 = 0, .c3 = 1}, scores);
  ASSERT_EQ(scores.size(), probabilities.size());
  for (std::size_t i = 0; i < scores.size(); ++i) {
    EXPECT_EQ(scores[i].gq, static_cast<float>(probabilities[i]));
    EXPECT_EQ(table.grasps[i].epsilon, set.epsilon[i]);
  }
  sortScores(scores);
  EXPECT_NE(scores.front().grasp, 0u);  // the best by epsilon
  for (std::size_t i = 1; i < scores.size(); ++i) {
    EXPECT_GE(probabilities[scores[i - 1].grasp], probabilities[scores[i].grasp]);
  }

  const Robot robot = loadRobot(source() + "/robots/panda");
  const auto ik = makeInverseKinematics(makeChain(robot, 0));
  const ReachArm arm{Eigen::Isometry3d::Identity(), forwardKinematics(robot.body, robot.home)[robot.arms[0].baseLink],
                     ik.get(), robot.home};
  scores.clear();
  ReachScorer(robot, 0).score(table, std::vector<bool>(table.grasps.size(), false), arm, Eigen::Isometry3d::Identity(),
                              {}, scores);
  for (std::size_t i = 0; i < scores.size(); ++i) EXPECT_EQ(scores[i].gq, static_cast<float>(probabilities[i]));
}

TEST_F(Score, ACalibrationOfOtherSetsIsRefused) {
  GraspSet set = toyBoxSet(jaw_);
  const HoldCalibration calibration = calibrationFor(set);
  set.friction = 0.3;
  EXPECT_THROW(makeGraspTable(set, "v0001.h5", jaw_, &calibration), InputError);
}

TEST_F(Score, AnotherHandIsRefused) {
  Hand other = jaw_;
  other.joints[0].name = "thumb";
  try {
    makeGraspTable(toyBoxSet(jaw_), "v0001.h5", other);
    FAIL();
  } catch (const std::exception& error) {
    EXPECT_STREQ(error.what(),
                 "v0001.h5: was built with a hand whose joints are finger_1, finger_2, want those of the robot's hand "
                 "jaw: thumb, finger_2");
  }
}

}  // namespace
}  // namespace handhold::testing
