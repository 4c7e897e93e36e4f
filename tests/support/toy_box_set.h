#pragma once

// A box of 50 x 80 x 120 mm with grasps that were thought out, not simulated: the jaw takes its 50 mm from above and
// from both sides, leaning by steps of 15 degrees. For tests of what happens online, which need no build.

#include "hand/hand.h"
#include "mesh/primitives.h"
#include "simulate/grasp_policy.h"
#include "store/database.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>
#include <vector>

namespace handhold::testing {

inline const Eigen::Vector3d kToyBox(0.05, 0.08, 0.12);  // m; it stands on z = 0 of its frame

namespace toy_box {

inline void push(std::vector<float>& values, const Eigen::Vector3d& v) {
  for (int i = 0; i < 3; ++i) values.push_back(static_cast<float>(v[i]));
}

/// A grid of points with outward normals on every face.
inline void addMap(GraspSet& set) {
  const Eigen::Vector3d center(0, 0, kToyBox.z() / 2);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (int i = 0; i < 8; ++i) {
        for (int j = 0; j < 8; ++j) {
          Eigen::Vector3d p;
          p[axis] = side * kToyBox[axis] / 2;
          p[u] = kToyBox[u] * ((i + 0.5) / 8 - 0.5);
          p[v] = kToyBox[v] * ((j + 0.5) / 8 - 0.5);
          push(set.mapPoint, center + p);
          push(set.mapNormal, side * Eigen::Vector3d::Unit(axis));
        }
      }
    }
  }
  set.neighbors = 4;
}

inline void addNeighbors(GraspSet& set, const Eigen::Vector3d& target) {
  std::vector<std::uint32_t> order(set.mapPoint.size() / 3);
  std::iota(order.begin(), order.end(), 0u);
  const auto distance = [&](std::uint32_t i) {
    return (Eigen::Vector3d(set.mapPoint[3 * i], set.mapPoint[3 * i + 1], set.mapPoint[3 * i + 2]) - target).norm();
  };
  std::partial_sort(order.begin(), order.begin() + set.neighbors, order.end(),
                    [&](auto a, auto b) { return std::pair(distance(a), a) < std::pair(distance(b), b); });
  for (int i = 0; i < set.neighbors; ++i) {
    set.mapNeighbor.push_back(order[static_cast<std::size_t>(i)]);
    set.mapWeight.push_back(1.0f / static_cast<float>(set.neighbors));
  }
}

/// One grasp: approach in the plane x = 0, `angle` from straight down; jaws along x, turned around by `half`.
inline void addGrasp(GraspSet& set, const Hand& hand, double angle, bool half, std::size_t row, std::size_t count) {
  const Eigen::Vector3d center(0, 0, kToyBox.z() / 2);
  const Eigen::Vector3d a(0, std::sin(angle), -std::cos(angle));
  const double support = (std::abs(a.y()) * kToyBox.y() + std::abs(a.z()) * kToyBox.z()) / 2;
  Eigen::Isometry3d X_OG = Eigen::Isometry3d::Identity();
  X_OG.linear().col(2) = a;
  X_OG.linear().col(0) = (half ? -1.0 : 1.0) * Eigen::Vector3d::UnitX();
  X_OG.linear().col(1) = X_OG.linear().col(2).cross(X_OG.linear().col(0));
  X_OG.translation() = center - (support + 0.001) * a;
  const Eigen::Isometry3d X_OH = X_OG * hand.X_LG.inverse();
  const Eigen::Quaterniond q(X_OH.linear());
  const Eigen::Vector3d target = center - support * a;

  set.trial.insert(set.trial.end(), {static_cast<std::uint32_t>(row), 0u, 0u});
  push(set.targetPoint, target);
  push(set.approachDirection, a);
  set.roll.push_back(0);
  for (const double value :
       {X_OH.translation().x(), X_OH.translation().y(), X_OH.translation().z(), q.x(), q.y(), q.z(), q.w()}) {
    set.handPose.push_back(value);
  }
  for (int j = 0; j < 2; ++j) {
    set.jointPosition.push_back(static_cast<float>(kToyBox.x() / 2));
    set.preshapeJointPosition.push_back(0.04f);
  }
  set.epsilon.push_back(0.1 - 0.05 * static_cast<double>(row) / static_cast<double>(count));
  set.backoff.push_back(0.001f);
  set.approachClear.push_back(1);
  for (const double side : {-1.0, 1.0}) {
    push(set.contactPosition, center + side * kToyBox.x() / 2 * Eigen::Vector3d::UnitX() - (support - 0.035) * a);
    push(set.contactNormal, -side * Eigen::Vector3d::UnitX());
    set.contactLink.push_back(static_cast<std::uint16_t>((side > 0) != half ? 1 : 2));
  }
  set.contactBegin.push_back(static_cast<std::uint32_t>(set.contactLink.size()));
  addNeighbors(set, target);
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  set.epsilonLower.push_back(unknown);
  set.epsilonUpper.push_back(unknown);
  for (auto* column :
       {&set.criticalFriction, &set.loadMargin, &set.robustness, &set.robustnessLower, &set.robustnessUpper}) {
    column->push_back(static_cast<float>(unknown));
  }
}

}  // namespace toy_box

/// The set, as a build with hands/jaw would write it. @param hand  hands/jaw, loaded
inline GraspSet toyBoxSet(const Hand& hand, const std::string& object = "toy_box") {
  GraspSet set;
  set.object = object;
  set.hand = hand.name;
  set.inputHash = "00112233445566778899aabbccddeeff";
  set.generator = "handhold test";
  set.job = "seed: 1\n";
  set.policy = "surface_normal";
  set.friction = 0.4;
  set.torqueScale = 0.08;
  set.pitch = set.mapPitch = 0.01;
  set.coneEdges = 8;
  set.contactDistance = 1e-4;
  append(set.objectMesh, boxMesh(kToyBox), Eigen::Isometry3d(Eigen::Translation3d(0, 0, kToyBox.z() / 2)));
  roundToFloat(set.objectMesh);
  set.watertight = true;
  set.centerOfMass = {0, 0, kToyBox.z() / 2};
  for (const Joint& joint : hand.joints) set.jointNames.push_back(joint.name);
  for (const Link& link : hand.links) {
    set.linkNames.push_back(link.name);
    set.linkMeshes.push_back(link.mesh);
  }
  for (const Preshape& preshape : hand.preshapes) set.preshapeNames.push_back(preshape.name);
  set.urdf = hand.urdfText;
  set.config = hand.configText;
  toy_box::addMap(set);

  constexpr int kSteps = 13;  // -90 to 90 degrees
  set.samples = 2 * kSteps;
  set.rolls = 1;
  set.preshapes = hand.preshapes.size();
  for (std::size_t i = 0; i < set.samples; ++i) {
    const double angle = (static_cast<double>(i / 2) - (kSteps - 1) / 2) * std::numbers::pi / (kSteps - 1);
    toy_box::addGrasp(set, hand, angle, i % 2 == 1, i, set.samples);
    toy_box::push(set.samplePoint,
                  Eigen::Vector3d(set.targetPoint[3 * i], set.targetPoint[3 * i + 1], set.targetPoint[3 * i + 2]));
    toy_box::push(set.sampleNormal, -Eigen::Vector3d(set.approachDirection[3 * i], set.approachDirection[3 * i + 1],
                                                     set.approachDirection[3 * i + 2]));
  }
  for (const std::string_view name : kOutcomeNames) set.outcomeNames.emplace_back(name);
  set.outcome.assign(set.trialCount(), 1);
  set.trialEpsilon.assign(set.trialCount(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t i = 0; i < set.samples; ++i) {
    set.outcome[i * set.preshapes] = 0;
    set.trialEpsilon[i * set.preshapes] = static_cast<float>(set.epsilon[i]);
  }
  set.host = "test";
  set.created = "2024-01-01T00:00:00Z";
  return set;
}

}  // namespace handhold::testing
