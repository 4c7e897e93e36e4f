#pragma once

#include "core/random.h"
#include "mesh/shapes.h"
#include "scene/scene.h"

#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace handhold::test {

inline Eigen::Vector3d randomVector(const RandomStream& random, double halfSide) {
  return (2 * Eigen::Vector3d(random.uniform(0), random.uniform(1), random.uniform(2)) - Eigen::Vector3d::Ones()) *
         halfSide;
}

inline Eigen::Isometry3d randomPose(const RandomStream& random, double halfSide) {
  const Eigen::Quaterniond turn(random.normal(10), random.normal(11), random.normal(12), random.normal(13));
  return Eigen::Translation3d(randomVector(random, halfSide)) * turn.normalized();
}

/// A bowl: a ball with a smaller one cut out of it, as two closed surfaces, the inner turned inward.
inline TriangleMesh hollowBall(double radius, double inner) {
  return joined(sphere(radius, 3), insideOut(sphere(inner, 2)));
}

/// Some of each kind, within half a metre of the origin.
inline std::vector<Obstacle> randomObstacles(const RandomStream& random) {
  std::vector<Eigen::Vector3d> points;
  for (std::uint64_t i = 0; i < 40; ++i) points.push_back(randomVector(random.child(100 + i), 0.1));
  const std::vector<std::shared_ptr<const ObstacleShape>> shapes = {
      makeBoxShape(Eigen::Vector3d::Constant(0.02) + 0.1 * (randomVector(random.child(1), 1).cwiseAbs())),
      makeCylinderShape(0.02 + 0.05 * random.uniform(2), 0.05 + 0.2 * random.uniform(3)),
      makeSphereShape(0.02 + 0.05 * random.uniform(4)), makeMeshShape(hollowBall(0.08, 0.07)),
      makePointsShape(std::move(points), 0.02)};
  std::vector<Obstacle> obstacles;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    obstacles.push_back({std::to_string(i), shapes[i], randomPose(random.child(200 + i), 0.3)});
  }
  return obstacles;
}

}  // namespace handhold::test
