#pragma once

#include "physics/grasp_physics.h"
#include "store/grasp_set.h"

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

namespace handhold {

/// The simulated friction is this much of the one a set was built with: grasps that the geometry calls closed keep a
/// reserve (docs/physics.md).
inline constexpr double kFrictionRatio = 1.5;

/// A set ready to be simulated.
class SimulatedSet {
 public:
  /// @param links   of the set's hand
  /// @param object  its solid
  SimulatedSet(GraspSet set, const Hand& hand, LinkSolids links, std::shared_ptr<const Solid> object,
               const std::optional<double>& friction);

  const GraspSet& set() const { return set_; }
  const PhysicsModel& model() const { return *model_; }
  /// The same with the object as convex pieces, for checks; to be made by makePieces first.
  const PhysicsModel& pieceModel() const { return *pieceModel_; }
  /// @return  how many pieces
  std::size_t makePieces();
  const SurfaceError& shapeError() const { return shapeError_; }
  const PhysicsSettings& settings() const { return settings_; }
  double mass() const { return mass_; }  // kg, the object's own; 0: not known

  GraspPosture posture(std::size_t row) const;

 private:
  GraspSet set_;
  double mass_;
  SurfaceError shapeError_;
  MassProperties properties_;  // at density 1
  PhysicsSettings settings_;
  LinkSolids links_;
  std::shared_ptr<const Solid> object_;
  std::unique_ptr<PhysicsModel> model_, pieceModel_;
};

/// Reads sets and makes them ready; the solids of a hand are made once, those of an object for all its sets in a row.
class SetLoader {
 public:
  /// @param friction  to simulate; without it kFrictionRatio times the set's own
  explicit SetLoader(std::optional<double> friction = {}) : friction_(friction) {}
  /// @throws InputError  as readGraspSet does
  std::unique_ptr<SimulatedSet> load(const std::filesystem::path& path);

 private:
  std::optional<double> friction_;
  std::map<std::string, LinkSolids> links_;  // by the hand's contentHash
  TriangleMesh objectMesh_;                  // of the last set
  std::shared_ptr<const Solid> object_;
};

/// What of an object's catalog entry in a job's text says its mass [kg]; 0 when nothing does.
double catalogMass(const std::string& jobText, const std::string& object);

}  // namespace handhold
