// What is asked of FCL, against distances that are known.
#include "plan/collision_world.h"

#include "core/random.h"
#include "plan_world.h"

namespace handhold::testing {
namespace {

class CollisionWorldTest : public PlanWorld {
 protected:
  Robot robot_ = loadRobot((folder_ / "puma").string());
  CollisionWorld world_{robot_};
  std::vector<Eigen::Isometry3d> X_WL_ = forwardKinematics(robot_.body, robot_.home);

  /// The point of the moving links that is farthest in a direction.
  Eigen::Vector3d farthest(const Eigen::Vector3d& direction) const {
    Eigen::Vector3d best = Eigen::Vector3d::Zero();
    double most = -1e9;
    for (std::size_t i = 0; i < X_WL_.size(); ++i) {
      if (!world_.movedLinks(0)[i]) continue;
      for (const Eigen::Vector3d& v : robot_.body.links[i].mesh.vertices) {
        if (direction.dot(X_WL_[i] * v) > most) most = direction.dot(X_WL_[i] * v), best = X_WL_[i] * v;
      }
    }
    return best;
  }
  bool touches(double margin) {
    return world_.robotTouches(0, X_WL_, Eigen::Isometry3d::Identity(), TargetRule::ignore, margin).has_value();
  }
};

TEST_F(CollisionWorldTest, MarginsAreDistances) {
  ASSERT_FALSE(touches(0));
  for (const Eigen::Vector3d& direction :
       {Eigen::Vector3d(Eigen::Vector3d::UnitX()), Eigen::Vector3d(Eigen::Vector3d::UnitZ())}) {
    for (const double gap : {-0.002, 0.001, 0.004, 0.02}) {
      const Eigen::Vector3d at = farthest(direction) + (gap + 0.05) * direction;
      world_.setObstacles({obstacle("block", makeBoxShape({0.1, 0.1, 0.1}), at)});
      EXPECT_EQ(touches(0), gap < 0) << gap;
      EXPECT_EQ(touches(0.003), gap < 0.003) << gap;
      EXPECT_EQ(touches(0.01), gap < 0.01) << gap;
    }
  }
}

TEST_F(CollisionWorldTest, InsideIsTouching) {
  world_.setObstacles({obstacle("room", makeBoxShape({9, 9, 9}), {0, 0, 0})});
  EXPECT_TRUE(touches(0));
  // A crumb inside a link.
  const int link = robot_.arms[0].handLinks[0];
  const Eigen::Vector3d inside = X_WL_[link] * Eigen::Vector3d(0, 0, 0.02);
  world_.setObstacles({obstacle("crumb", makeSphereShape(0.002), inside)});
  EXPECT_TRUE(touches(0));
}

TEST_F(CollisionWorldTest, TheTargetIsAvoidedTouchedOrIgnored) {
  const Hand& hand = robot_.arms[0].hand;
  world_.setTarget(boxMesh({0.05, 0.05, 0.05}), true, "cube");
  const Eigen::Isometry3d X_WO = X_WL_[robot_.arms[0].handLinks[1]];
  const auto ask = [&](TargetRule rule) {
    std::vector<Eigen::Isometry3d> X;
    for (const int link : robot_.arms[0].handLinks) X.push_back(X_WL_[link]);
    return world_.handTouches(0, X, X_WO, rule, 0);
  };
  ASSERT_TRUE(ask(TargetRule::avoid));
  EXPECT_TRUE(ask(TargetRule::avoid)->ofTarget);
  EXPECT_EQ(ask(TargetRule::avoid)->second, "cube");
  EXPECT_FALSE(ask(TargetRule::contact));
  EXPECT_FALSE(ask(TargetRule::ignore));
  EXPECT_EQ(hand.links.size(), 3u);
  // Carried, it may not meet what is not allowed.
  world_.setObstacles({obstacle("shelf", makeBoxShape({0.02, 0.02, 0.02}), X_WO.translation())});
  EXPECT_TRUE(world_.targetTouches(0, X_WL_, X_WO, {false}));
  EXPECT_FALSE(world_.targetTouches(0, X_WL_, X_WO, {true}));
  EXPECT_EQ(world_.obstaclesNearTarget(X_WO, 0), std::vector<bool>{true});
}

TEST_F(CollisionWorldTest, TheArmMeetsItselfInSomePostures) {
  const RandomStream stream(560);
  int touching = 0;
  constexpr int kPostures = 300;
  for (int i = 0; i < kPostures; ++i) {
    Eigen::VectorXd q = robot_.home;
    for (std::size_t k = 0; k < 6; ++k) {
      const Joint& joint = robot_.body.joints[robot_.arms[0].joints[k]];
      q[robot_.arms[0].joints[k]] =
          std::lerp(joint.lower, joint.upper, stream.child(static_cast<std::uint64_t>(i)).uniform(k));
    }
    X_WL_ = forwardKinematics(robot_.body, q);
    const auto touch = world_.robotTouches(0, X_WL_, Eigen::Isometry3d::Identity(), TargetRule::ignore, 0);
    if (!touch) continue;
    ++touching;
    EXPECT_NE(touch->first, touch->second);
  }
  EXPECT_GT(touching, 0);
  EXPECT_LT(touching, kPostures / 2);
}

}  // namespace
}  // namespace handhold::testing
