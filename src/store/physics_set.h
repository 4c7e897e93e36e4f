#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace handhold {

/// Grasps of one set simulated: everything in one physics-v<NNNN>.h5 (db/FORMAT.md). Arrays are row-major.
struct PhysicsSet {
  // provenance
  std::string object, hand, inputHash;  // of the set
  int setVersion = 0;
  std::string settings;                // everything that changes a result, a line each; equal texts: equal results
  std::string generator;               // program and MuJoCo's version
  double friction = 0;                 // simulated
  double mass = 0;                     // kg, the object's own; 0: not known
  double shapeP95 = 0, shapeMost = 0;  // m, error of the object's shape against its mesh

  std::vector<std::string> outcomeNames;    // of outcome
  std::vector<std::string> testNames;       // (T) pull, weight, lift: those that were simulated
  std::vector<std::string> directionNames;  // (D) `pull +x`: test and direction of the load in the object frame

  std::vector<std::uint32_t> grasp;  // (m) rows of the set's /grasps, ascending

  // after the squeeze (m,T)
  std::vector<std::uint8_t> settledClosed;     // force closed at the simulated friction
  std::vector<std::uint16_t> settledContacts;  // how many
  std::vector<float> settledDisplacement, settledRotation, settledPenetration;  // m, rad, m
  std::vector<float> squeeze;                                                   // N

  // under load (m,D)
  std::vector<std::uint8_t> outcome;                                    // index into outcomeNames; 0 is held
  std::vector<float> displacement, rotation, fallSeconds, penetration;  // m, rad, s (infinite: held), m

  std::size_t graspCount() const { return grasp.size(); }
};

/// Of every array of results visit(PATH, MEMBER, SYMBOLS): `m` grasps by `T` tests or `D` directions.
template <class Visit>
void forEachPhysicsArray(const Visit& visit) {
  visit("/grasp", &PhysicsSet::grasp, "m");
  visit("/settled/closed", &PhysicsSet::settledClosed, "mT");
  visit("/settled/contacts", &PhysicsSet::settledContacts, "mT");
  visit("/settled/displacement", &PhysicsSet::settledDisplacement, "mT");
  visit("/settled/rotation", &PhysicsSet::settledRotation, "mT");
  visit("/settled/penetration", &PhysicsSet::settledPenetration, "mT");
  visit("/settled/squeeze", &PhysicsSet::squeeze, "mT");
  visit("/load/outcome", &PhysicsSet::outcome, "mD");
  visit("/load/displacement", &PhysicsSet::displacement, "mD");
  visit("/load/rotation", &PhysicsSet::rotation, "mD");
  visit("/load/fall_seconds", &PhysicsSet::fallSeconds, "mD");
  visit("/load/penetration", &PhysicsSet::penetration, "mD");
}

/// `physics-v<NNNN>.h5` beside the set.
std::filesystem::path physicsPath(const std::filesystem::path& set);

/// Writes it whole, in place of a former one. @throws SystemError, InputError  the arrays contradict each other
void writePhysics(const std::filesystem::path& path, const PhysicsSet& physics);

/// The checksum is checked before HDF5 opens the file, then every shape and index.
/// @throws InputError  `PATH: ...` no physics results, damaged, contradicting themselves
PhysicsSet readPhysics(const std::filesystem::path& path);

/// The same of the results beside a set of that version and `inputHash`, with so many grasps.
/// @throws InputError  also when they belong to another set
PhysicsSet readPhysicsOf(const std::filesystem::path& setPath, const std::string& inputHash, int setVersion,
                         std::size_t grasps);

/// Of each grasp of a set (n) the share of the directions of `pull` in which it was held; NaN where it was not
/// simulated.
std::vector<double> shareHeld(const PhysicsSet& physics, std::size_t grasps);

/// Grasps held in every direction of a test.
std::size_t countHeld(const PhysicsSet& physics, std::string_view test);

}  // namespace handhold
