#pragma once

#include "mesh/mass_properties.h"
#include "physics/mjcf.h"
#include "physics/solid.h"

#include <array>
#include <functional>
#include <memory>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// How a held object is tried.
enum class PhysicsTest : std::uint8_t {
  pull,    // 1 N on an object of 0.1 kg, in six directions
  weight,  // its own mass, its own weight in six directions
  lift,    // its own weight downwards from the beginning, on a table; then the hand rises 0.1 m
};
inline constexpr std::array<std::string_view, 3> kPhysicsTestNames = {"pull", "weight", "lift"};

enum class PhysicsOutcome : std::uint8_t {
  held,      // moved less than 5 cm and turned less than 15 degrees
  moved,     // 5 cm or more
  turned,    // 15 degrees or more
  inside,    // before closing hand and object are more than 1 cm inside each other
  unstable,  // the simulation left the range of numbers
};
inline constexpr std::array<std::string_view, 5> kPhysicsOutcomeNames = {"held", "moved", "turned", "inside",
                                                                         "unstable"};

/// The protocol (docs/physics.md): its numbers in one place.
struct PhysicsSettings {
  WorldSettings world;
  double closeSeconds = 1.0, squeezeSeconds = 0.4, pullSeconds = 2.0, checkSeconds = 0.2;
  double pullMass = 0.1, pullForce = 1.0;       // kg, N
  double squeezeForce = 40;                     // N, sum of normal forces for a load of 1 N or less; grows with it
  double largestMove = 0.05, largestTurn = 15;  // m, degrees
  double startDepth = 0.01;                     // m
  double liftHeight = 0.1, liftSeconds = 0.4;   // m, s
};

/// What became of the object under one load.
struct DirectionResult {
  PhysicsOutcome outcome = PhysicsOutcome::unstable;
  double displacement = 0;  // m, of the centre of mass from where it first was
  double rotation = 0;      // rad, from how it first was
  double fallSeconds = 0;   // of the load; infinite when it was held
  double penetration = 0;   // m, the deepest
};

/// Hand and object after the squeeze, before any load.
struct SettledResult {
  std::vector<Contact> contacts;                           // in O
  bool closed = false;                                     // are these contacts force closed at the simulated friction?
  double displacement = 0, rotation = 0, penetration = 0;  // as above
  double squeeze = 0;                                      // N, sum of normal forces that was asked for
};

struct TestResult {
  PhysicsTest test = PhysicsTest::pull;
  SettledResult settled;
  std::vector<DirectionResult> directions;  // six, as kPullNames; one of a lift
};
/// Axes of O along which a load pulls.
inline constexpr std::array<std::string_view, 6> kPullNames = {"+x", "-x", "+y", "-y", "+z", "-z"};

/// Was the object held in every direction?
bool isHeld(const TestResult& result);

/// Where everything is at one moment: in the frame of the world, which is the hand's root link H, for a lift O.
struct PhysicsFrame {
  double seconds = 0;
  std::string_view phase;  // close, squeeze, pull, lift
  int direction = -1;
  Eigen::Isometry3d X_WO;
  std::vector<Eigen::Isometry3d> X_WL;
};

/// A hand's links as solids: the same for every object.
using LinkSolids = std::vector<std::shared_ptr<const Solid>>;  // null: a link without geometry
LinkSolids linkSolids(const Hand& hand);

/// One hand and one object in MuJoCo. Immutable; safe from many threads.
class PhysicsModel {
 public:
  /// @param object  its solid and its mass properties at density 1
  /// @param ownMass  kg; 0: not known, then only the pull can be simulated
  /// @param pieces   of the object: then MuJoCo collides them with the hulls of the links' pieces, and the solids serve
  ///                 contactsWithin and the table alone
  /// @throws SystemError  MuJoCo cannot load the model, with its reason
  PhysicsModel(const Hand& hand, LinkSolids links, std::shared_ptr<const Solid> object,
               const MassProperties& properties, double ownMass, const PhysicsSettings& settings,
               std::vector<ConvexPiece> pieces = {});
  ~PhysicsModel();
  PhysicsModel(PhysicsModel&&) noexcept;

  bool knowsMass() const;
  const Hand& hand() const;

  /// Contacts of a posture, given the surfaces are at most `distance` apart: as many a link as a settled grasp has.
  std::vector<Contact> contactsWithin(const GraspPosture& posture, double distance) const;
  bool closes(std::span<const Contact> contacts) const;

 private:
  friend class GraspSimulator;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Simulates grasps, one after another. A result depends on the posture and the test alone, to the last bit.
/// @note  One a thread.
class GraspSimulator {
 public:
  using Watch = std::function<void(const PhysicsFrame&)>;

  explicit GraspSimulator(const PhysicsModel& model);
  ~GraspSimulator();
  GraspSimulator(GraspSimulator&&) noexcept;

  /// @param watch  called every 20 ms of simulated time, of the first direction only; may be empty
  TestResult run(const GraspPosture& posture, PhysicsTest test, const Watch& watch = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// MuJoCo's version, as 2.2.2.
std::string mujocoVersion();

}  // namespace handhold
