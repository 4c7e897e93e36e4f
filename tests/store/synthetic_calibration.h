#pragma once

#include "store/hold_calibration.h"

namespace handhold {

/// A calibration for sets like this one: log odds 1 + 2 (epsilon - 0.05) / 0.02 - 3 (critical friction - 0.3) / 0.1.
inline HoldCalibration calibrationFor(const GraspSet& set) {
  HoldCalibration calibration;
  calibration.path = "calibration.yaml";
  calibration.hand = set.hand;
  calibration.handHash = handHash(set);
  calibration.friction = set.friction;
  calibration.coneEdges = set.coneEdges;
  calibration.contactDistance = set.contactDistance;
  calibration.simulatedFriction = 1.5 * set.friction;
  calibration.protocol = "version 1\nmujoco 2.2.2\n";
  calibration.seed = 18446744073709551615U;
  calibration.noisePosition = 0.003;
  calibration.noiseRotation = 0.05;
  calibration.noiseTrials = 50;
  calibration.ridge = 1;
  calibration.objects = {{"mug", 50, 49, 50, 7}, {"box", 0, 0, 50, 3}};
  HoldModel constant{"constant", 0.25, {}, {}, {}};
  constant.all = {150, 59, {}, {}, 0.24, 0.67, 0.01};
  constant.all.auc = constant.all.aucInObject = std::numeric_limits<double>::quiet_NaN();
  HoldModel rank{
      std::string(kRankModel), 1, {}, {150, 59, 0.9, 0.8, 0.1, 0.3, 0.02}, {50, 49, 0.7, 0.6, 0.2, 0.4, 0.1}};
  rank.terms = {{HoldFeature::epsilon, 0.05, 0.02, 2}, {HoldFeature::criticalFriction, 0.3, 0.1, -3}};
  calibration.models = {constant, rank};
  return calibration;
}

}  // namespace handhold
