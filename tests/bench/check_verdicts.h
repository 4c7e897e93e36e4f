#pragma once

#include "quality/force_closure.h"

#include <filesystem>
#include <vector>

// Is testForceClosure right? Its proofs are verified from the columns in 80-bit numbers, and CLP is asked as well.
namespace handhold::bench {

/// Beyond this, times R, a plane that should hold all wrenches is no proof.
inline constexpr double kProofMargin = 1.0001 * kSeparationTolerance;

/// CLP keeps its constraints to 1e-7: a balance whose least weight is nearer to 0 than this it cannot decide.
inline constexpr double kClpMargin = 1e-6;

struct VerdictCounts {
  long sets = 0;
  long closed = 0, notClosed = 0, failed = 0;
  long wrongClosed = 0;     // the simplex of the proof does not hold the origin strictly, or a corner is no mixture
  long wrongNotClosed = 0;  // a wrench lies beyond the plane of the proof by more than kProofMargin R
  long clpUndecided = 0;    // CLP's margin is below kClpMargin, or it gave up
  long clpDisagrees = 0;    // of the others
  double leastInradius = HUGE_VAL;  // of the simplices about the origin, over R
};

/// Random sets of 2 to 16 contacts and a random friction: of every four one is plain, one like a grasp's, and two have
/// their friction at the border of force closure, off by 1e-2 to 1e-12 of itself.
VerdictCounts checkRandomVerdicts(int nSets);

/// Up to `nGrasps` stored grasps of all sets of a database: all contacts, and again without those of one link.
struct StoredVerdicts {
  VerdictCounts whole, withoutOneLink;
};
StoredVerdicts checkStoredVerdicts(const std::filesystem::path& database, int nGrasps);

/// Edges of the cones that bounds and critical friction are held against: inscribed in the true one, and circumscribed
/// about it, which is the inscribed one of a friction larger by 1 / cos(pi / kManyEdges).
inline constexpr int kManyEdges = 64;

struct BoundCounts {
  long sets = 0;     // whose bounds are known
  long unknown = 0;  // others
  long outOfBracket =
      0;  // lower below the inscribed epsilon, or upper above the circumscribed one, by more than their gap
  long frictions = 0;     // critical ones above kLeastFriction
  long notConfirmed = 0;  // not closed on the inscribed cone 1 % above, or closed on the circumscribed one 1 % below
};

/// The stored bounds and critical frictions of up to `nGrasps` grasps of all sets with contacts that are points.
BoundCounts checkStoredBounds(const std::filesystem::path& database, int nGrasps);

}  // namespace handhold::bench
