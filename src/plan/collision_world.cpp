#include "plan/collision_world.h"

#include "mesh/ray_scene.h"

#include <algorithm>
#include <map>
#include <utility>

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/narrowphase/collision.h>
#include <fcl/narrowphase/distance.h>

namespace handhold {
namespace {

using Bvh = fcl::BVHModel<fcl::OBBRSS<double>>;

constexpr double kHandToTarget = 0.001;  // m

/// A surface ready for questions.
struct Body {
  Bvh bvh;
  Eigen::Vector3d center;      // of its box, in its frame
  Eigen::Vector3d halfExtent;  // m
  std::vector<Eigen::Vector3d> piecePoints;
  std::unique_ptr<RayScene> inside;  // null: containment has no meaning

  Body(const TriangleMesh& mesh, std::vector<Eigen::Vector3d> points, bool watertight)
      : piecePoints(std::move(points)) {
    std::vector<fcl::Triangle> triangles;
    triangles.reserve(mesh.triangles.size());
    for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    bvh.beginModel(static_cast<int>(triangles.size()), static_cast<int>(mesh.vertices.size()));
    bvh.addSubModel(mesh.vertices, triangles);
    bvh.endModel();
    const Eigen::AlignedBox3d box = boundingBox(mesh);
    center = box.center();
    halfExtent = box.sizes() / 2;
    if (watertight) inside = std::make_unique<RayScene>(mesh);
  }

  bool contains(const Eigen::Vector3d& p) const {
    return inside != nullptr && ((p - center).cwiseAbs() - halfExtent).maxCoeff() <= 0 && inside->contains(p);
  }
};

/// A body with its pose and the box around it in the world.
struct Placed {
  const Body* body = nullptr;
  Eigen::Isometry3d X;
  Eigen::Vector3d center, halfExtent;  // in the world

  Placed() = default;
  Placed(const Body* b, const Eigen::Isometry3d& pose) : body(b), X(pose) {
    center = X * b->center;
    halfExtent = X.linear().cwiseAbs() * b->halfExtent;
  }
};

bool boxesApart(const Placed& a, const Placed& b, double margin) {
  return ((a.center - b.center).cwiseAbs() - a.halfExtent - b.halfExtent).maxCoeff() > margin;
}

bool surfacesNear(const Placed& a, const Placed& b, double margin) {
  if (margin <= 0) {
    static const fcl::CollisionRequest<double> request(1, false);
    fcl::CollisionResult<double> result;
    return fcl::collide(&a.body->bvh, a.X, &b.body->bvh, b.X, request, result) > 0;
  }
  // FCL prunes by the least distance found so far: beginning at the margin, it looks at nothing farther away.
  static const fcl::DistanceRequest<double> request(false);
  fcl::DistanceResult<double> result(margin);
  fcl::distance(&a.body->bvh, a.X, &b.body->bvh, b.X, request, result);
  return result.min_distance < margin;
}

/// Is a piece of `a` inside `b`?
bool isInside(const Placed& a, const Placed& b) {
  if (b.body->inside == nullptr) return false;
  const Eigen::Isometry3d X_BA = b.X.inverse() * a.X;
  return std::any_of(a.body->piecePoints.begin(), a.body->piecePoints.end(),
                     [&](const Eigen::Vector3d& p) { return b.body->contains(X_BA * p); });
}

bool near(const Placed& a, const Placed& b, double margin) {
  return !boxesApart(a, b, margin) && (surfacesNear(a, b, margin) || isInside(a, b) || isInside(b, a));
}

/// The hand may come nearer to what it is going to grasp: between open fingers there is no room for more.
double targetMargin(bool isOfHand, double margin) { return isOfHand ? std::min(margin, kHandToTarget) : margin; }

std::vector<bool> linksMovedByArm(const Robot& robot, const Arm& arm) {
  std::vector<int> joints = arm.joints;
  joints.insert(joints.end(), arm.handJoints.begin(), arm.handJoints.end());
  return linksMovedBy(robot.body, joints);
}

}  // namespace

struct CollisionWorld::Impl {
  struct ArmPairs {
    std::vector<bool> moved;                   // by link of the robot
    std::vector<std::pair<int, int>> inHand;   // of links of the hand, that are apart in its preshapes
    std::vector<std::pair<int, int>> inRobot;  // of links of the robot
    std::vector<int> handLinkOf;               // by link of the robot: of the hand, -1 for the others
  };

  const Robot& robot;
  std::vector<std::unique_ptr<Body>> links;  // null without geometry
  std::vector<ArmPairs> arms;
  std::map<const ObstacleShape*, std::pair<std::shared_ptr<const ObstacleShape>, std::unique_ptr<Body>>> shapes;
  std::vector<Placed> obstacles;
  std::vector<std::string> obstacleNames;
  std::unique_ptr<Body> target;
  std::string targetName;

  explicit Impl(const Robot& r) : robot(r) {
    for (const Link& link : r.body.links) {
      links.push_back(link.mesh.triangles.empty()
                          ? nullptr
                          : std::make_unique<Body>(link.mesh, link.piecePoints, isWatertight(link.mesh)));
    }
    for (const Arm& arm : r.arms) arms.push_back(makePairs(arm));
  }

  bool linksNear(int a, const Eigen::Isometry3d& X_A, int b, const Eigen::Isometry3d& X_B, double margin) const {
    return links[a] && links[b] && near({links[a].get(), X_A}, {links[b].get(), X_B}, margin);
  }

  bool mayTouch(int a, int b) const {
    const auto& allowed = robot.allowedCollisions;
    return std::find(allowed.begin(), allowed.end(), std::pair(std::min(a, b), std::max(a, b))) != allowed.end();
  }

  /// Pairs within the hand that are apart whenever its fingers stand in a preshape.
  std::vector<std::pair<int, int>> pairsInHand(const Arm& arm) const {
    std::vector<std::pair<int, int>> pairs;
    const int count = static_cast<int>(arm.handLinks.size());
    std::vector<std::vector<Eigen::Isometry3d>> postures;
    for (const Preshape& preshape : arm.hand.preshapes) {
      postures.push_back(forwardKinematics(arm.hand, preshape.jointPosition));
    }
    for (int a = 0; a < count; ++a) {
      for (int b = a + 1; b < count; ++b) {
        if (!links[arm.handLinks[a]] || !links[arm.handLinks[b]]) continue;
        if (mayTouch(arm.handLinks[a], arm.handLinks[b])) continue;
        const bool apart = std::none_of(postures.begin(), postures.end(), [&](const auto& X_HL) {
          return linksNear(arm.handLinks[a], X_HL[a], arm.handLinks[b], X_HL[b], 0);
        });
        if (apart) pairs.emplace_back(a, b);
      }
    }
    return pairs;
  }

  ArmPairs makePairs(const Arm& arm) const {
    ArmPairs pairs;
    pairs.moved = linksMovedByArm(robot, arm);
    pairs.inHand = pairsInHand(arm);
    pairs.handLinkOf.assign(links.size(), -1);
    for (std::size_t i = 0; i < arm.handLinks.size(); ++i) pairs.handLinkOf[arm.handLinks[i]] = static_cast<int>(i);
    for (const auto& [a, b] : pairs.inHand) pairs.inRobot.emplace_back(arm.handLinks[a], arm.handLinks[b]);
    for (int a = 0; a < static_cast<int>(links.size()); ++a) {
      for (int b = a + 1; b < static_cast<int>(links.size()); ++b) {
        if (!links[a] || !links[b] || !(pairs.moved[a] || pairs.moved[b])) continue;
        if (pairs.handLinkOf[a] >= 0 && pairs.handLinkOf[b] >= 0) continue;
        if (mayTouch(a, b)) continue;
        pairs.inRobot.emplace_back(a, b);
      }
    }
    return pairs;
  }

  const std::string& linkName(int link) const { return robot.body.links[link].name; }

  /// One link against obstacles and target.
  std::optional<Touch> linkTouches(int link, const Placed& placed, const Placed* goal, bool mayTouchTarget,
                                   double margin, double targetMargin) const {
    for (std::size_t i = 0; i < obstacles.size(); ++i) {
      if (near(placed, obstacles[i], margin)) return Touch{linkName(link), obstacleNames[i], false};
    }
    if (goal != nullptr && !mayTouchTarget && near(placed, *goal, targetMargin)) {
      return Touch{linkName(link), targetName, true};
    }
    return std::nullopt;
  }
};

CollisionWorld::CollisionWorld(const Robot& robot) : impl_(new Impl(robot)) {}
CollisionWorld::~CollisionWorld() = default;
CollisionWorld::CollisionWorld(CollisionWorld&&) noexcept = default;
CollisionWorld& CollisionWorld::operator=(CollisionWorld&&) noexcept = default;

void CollisionWorld::setObstacles(const std::vector<Obstacle>& obstacles) {
  decltype(impl_->shapes) shapes;
  impl_->obstacles.clear();
  impl_->obstacleNames.clear();
  for (const Obstacle& obstacle : obstacles) {
    const ObstacleShape* const shape = obstacle.shape.get();
    auto& entry = shapes[shape];
    if (entry.second == nullptr) {
      const auto known = impl_->shapes.find(shape);
      entry.first = obstacle.shape;
      entry.second = known != impl_->shapes.end() && known->second.second != nullptr
                         ? std::move(known->second.second)
                         : std::make_unique<Body>(shape->mesh, shape->piecePoints, shape->watertight);
    }
    impl_->obstacles.emplace_back(entry.second.get(), obstacle.X_WS);
    impl_->obstacleNames.push_back(obstacle.name);
  }
  impl_->shapes = std::move(shapes);
}

void CollisionWorld::setTarget(const TriangleMesh& mesh, bool watertight, const std::string& name) {
  impl_->target = std::make_unique<Body>(mesh, pieceVertices(mesh), watertight);
  impl_->targetName = name;
}

std::optional<Touch> CollisionWorld::handTouches(int arm, const std::vector<Eigen::Isometry3d>& X_WL,
                                                 const Eigen::Isometry3d& X_WO, TargetRule rule, double margin) const {
  ++checks_;
  const Arm& description = impl_->robot.arms[arm];
  const Placed target = impl_->target ? Placed(impl_->target.get(), X_WO) : Placed();
  const Placed* const goal = impl_->target && rule != TargetRule::ignore ? &target : nullptr;
  for (std::size_t i = 0; i < description.handLinks.size(); ++i) {
    const int link = description.handLinks[i];
    if (!impl_->links[link]) continue;
    const bool mayTouch = rule == TargetRule::contact && description.hand.links[i].contactAllowed;
    if (auto touch = impl_->linkTouches(link, {impl_->links[link].get(), X_WL[i]}, goal, mayTouch, margin,
                                        targetMargin(true, margin)))
      return touch;
  }
  for (const auto& [a, b] : impl_->arms[arm].inHand) {
    const int first = description.handLinks[a], second = description.handLinks[b];
    if (impl_->linksNear(first, X_WL[a], second, X_WL[b], 0)) {
      return Touch{impl_->linkName(first), impl_->linkName(second), false};
    }
  }
  return std::nullopt;
}

bool CollisionWorld::handMeetsTarget(int arm, const std::vector<Eigen::Isometry3d>& X_OL) const {
  ++checks_;
  const Placed target(impl_->target.get(), Eigen::Isometry3d::Identity());
  const std::vector<int>& links = impl_->robot.arms[arm].handLinks;
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (impl_->links[links[i]] && near({impl_->links[links[i]].get(), X_OL[i]}, target, 0)) return true;
  }
  return false;
}

std::optional<Touch> CollisionWorld::robotTouches(int arm, const std::vector<Eigen::Isometry3d>& X_WL,
                                                  const Eigen::Isometry3d& X_WO, TargetRule rule, double margin) const {
  ++checks_;
  const Impl::ArmPairs& pairs = impl_->arms[arm];
  const Placed target = impl_->target ? Placed(impl_->target.get(), X_WO) : Placed();
  const Placed* const goal = impl_->target && rule != TargetRule::ignore ? &target : nullptr;
  for (std::size_t i = 0; i < impl_->links.size(); ++i) {
    if (!impl_->links[i] || !pairs.moved[i]) continue;
    const int handLink = pairs.handLinkOf[i];
    const bool mayTouch =
        rule == TargetRule::contact && handLink >= 0 && impl_->robot.arms[arm].hand.links[handLink].contactAllowed;
    if (auto touch = impl_->linkTouches(static_cast<int>(i), {impl_->links[i].get(), X_WL[i]}, goal, mayTouch, margin,
                                        targetMargin(handLink >= 0, margin)))
      return touch;
  }
  for (const auto& [a, b] : pairs.inRobot) {
    if (impl_->linksNear(a, X_WL[a], b, X_WL[b], 0)) return Touch{impl_->linkName(a), impl_->linkName(b), false};
  }
  return std::nullopt;
}

std::optional<Touch> CollisionWorld::targetTouches(int arm, const std::vector<Eigen::Isometry3d>& X_WL,
                                                   const Eigen::Isometry3d& X_WO, const std::vector<bool>& allowed,
                                                   double margin) const {
  ++checks_;
  const Placed target(impl_->target.get(), X_WO);
  for (std::size_t i = 0; i < impl_->obstacles.size(); ++i) {
    if (!allowed[i] && near(target, impl_->obstacles[i], margin)) {
      return Touch{impl_->targetName, impl_->obstacleNames[i], false};
    }
  }
  const Impl::ArmPairs& pairs = impl_->arms[arm];
  for (std::size_t i = 0; i < impl_->links.size(); ++i) {
    if (!impl_->links[i]) continue;
    const int handLink = pairs.handLinkOf[i];
    if (handLink >= 0 && impl_->robot.arms[arm].hand.links[handLink].contactAllowed) continue;
    if (near(target, {impl_->links[i].get(), X_WL[i]}, handLink >= 0 ? 0 : margin)) {
      return Touch{impl_->targetName, impl_->linkName(static_cast<int>(i)), true};
    }
  }
  return std::nullopt;
}

bool CollisionWorld::handsTouch(int arm, const std::vector<Eigen::Isometry3d>& X_L, int otherArm,
                                const std::vector<Eigen::Isometry3d>& X_otherL) const {
  ++checks_;
  const std::vector<int>&first = impl_->robot.arms[arm].handLinks, &second = impl_->robot.arms[otherArm].handLinks;
  for (std::size_t a = 0; a < first.size(); ++a) {
    for (std::size_t b = 0; b < second.size(); ++b) {
      if (impl_->linksNear(first[a], X_L[a], second[b], X_otherL[b], 0)) return true;
    }
  }
  return false;
}

std::vector<bool> CollisionWorld::obstaclesNearTarget(const Eigen::Isometry3d& X_WO, double margin) const {
  std::vector<bool> result;
  const Placed target(impl_->target.get(), X_WO);
  for (const Placed& obstacle : impl_->obstacles) result.push_back(near(target, obstacle, margin));
  return result;
}

const std::vector<bool>& CollisionWorld::movedLinks(int arm) const { return impl_->arms[arm].moved; }

}  // namespace handhold
