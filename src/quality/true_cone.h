#pragma once

#include "quality/force_closure.h"

#include <array>
#include <limits>
#include <span>
#include <vector>

namespace handhold {

namespace polar {
enum class InstructionSet : unsigned char;
}

/// upper - lower is at most this times upper, plus kEpsilonTolerance R.
inline constexpr double kBoundsGap = 1e-4;
/// The critical friction is found to this, and where it is small to kFrictionShare of itself.
inline constexpr double kFrictionTolerance = 1e-3;
inline constexpr double kFrictionShare = 4e-3;
/// Below it nothing is asked.
inline constexpr double kLeastFriction = 1e-4;

/// lower <= epsilon <= upper on the true cone, up to kEpsilonTolerance R.
struct EpsilonBounds {
  ForceClosure verdict = ForceClosure::failed;
  double lower = std::numeric_limits<double>::quiet_NaN();  // 0 when not closed, NaN when failed
  double upper = std::numeric_limits<double>::quiet_NaN();
  int facets = 0;  // built on the way
};

/// Not closed at `below`, closed at `friction`.
struct CriticalFriction {
  ForceClosure verdict = ForceClosure::failed;  // at the model's friction
  double below = std::numeric_limits<double>::quiet_NaN();
  double friction = std::numeric_limits<double>::quiet_NaN();  // NaN unless closed
};

/// Epsilon and force closure on the true friction cones, |tangential force| <= mu (normal force), and of soft fingers
/// on the ellipsoids that they become with a moment about the normal: the wrench set is
///
///     K(mu) = conv over contacts i of { c_i + x t_i + y b_i + z r_i : x^2 + y^2 + z^2 <= mu^2 }                  (10)
///
/// with c_i, t_i, b_i the wrenches of the unit normal and of two unit tangents, r_i = (0; e n_i / s), of point contacts
/// zero: frictionConeWrenches with generators without number. Nothing depends on the choice of tangents or on
/// WrenchModel::coneEdges. One a worker: its memory is kept, and no call allocates once the thread has seen sets as
/// large. The same bits on every instruction set. Source: src/quality/README.md, equations (10) to (13).
class TrueCones {
 public:
  explicit TrueCones(const WrenchModel& model);
  /// By a chosen instruction set, which the machine must have.
  TrueCones(const WrenchModel& model, polar::InstructionSet set);

  /// Is the origin strictly inside K(mu)? Both verdicts are proved as those of testForceClosure are.
  ForceClosure testForceClosure(std::span<const Contact> contacts);

  /// Bounds of the radius of the largest ball about the origin in K(mu).
  EpsilonBounds epsilonBounds(std::span<const Contact> contacts);

  /// The smallest friction in (0, mu] at which the origin is strictly inside, by bisection.
  CriticalFriction criticalFriction(std::span<const Contact> contacts);

  /// Eight contacts, coordinate by coordinate; the last block is filled up with contact 0.
  struct alignas(64) Block {
    std::array<std::array<double, 8>, 6> center, t, b;
  };

 private:
  void setContacts(std::span<const Contact> contacts);
  template <class Answer>
  Answer ask(std::span<const Contact> contacts);

  WrenchModel model_;
  polar::InstructionSet set_;
  std::vector<Block> blocks_;
};

}  // namespace handhold
