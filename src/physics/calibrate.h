#pragma once

#include "physics/labelled_grasps.h"
#include "physics/prediction_measures.h"
#include "store/hold_calibration.h"

#include <string>
#include <vector>

namespace handhold {

/// The drawn grasps of one object with one hand.
struct LabelledObject {
  std::string name;
  std::vector<LabelledGrasp> grasps;
};

inline constexpr std::string_view kSettledModel = "settled";

/// The models that are compared, by name: those that know what the next knows less of it.
///
///     constant   nothing: the share that held
///     epsilon    epsilon
///     rank       epsilon and critical friction: what every stored grasp has
///     full       those, load margin and robustness: all that is known before a simulation
///     settled    those, and whether the contacts after the simulated squeeze are force closed
struct CalibratedHand {
  std::vector<HoldModel> models;
  /// (models, grasps), object after object: what a model that was fitted to the other objects said of each grasp.
  std::vector<std::vector<Prediction>> predictions;
};

/// Fits every model to all grasps, on features of mean 0 and standard deviation 1, and measures it by leaving out one
/// object after the other.
/// @param objects  of which canBeCalibrated
/// Source: docs/physics.md; Hosmer, Lemeshow 2000; measures: prediction_measures.h
CalibratedHand calibrateHand(const std::vector<LabelledObject>& objects);

/// Nothing, or in words why no model would mean anything: without each of the objects at least five grasps must have
/// held, and five not.
std::string whyNotCalibrated(const std::vector<LabelledObject>& objects);

/// A calibration without objects and models, of the kind of this set.
HoldCalibration calibrationOf(const SimulatedSet& set, std::uint64_t seed);

/// How many of an object's grasps held.
HoldCalibration::Object countObject(const LabelledObject& object);

/// Adds objects and models.
void addResults(const std::vector<LabelledObject>& objects, const CalibratedHand& calibrated,
                HoldCalibration& calibration);

}  // namespace handhold
