#pragma once

#include "quality/contact.h"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// Wrenches (force; torque / s), one a column, in the object frame about the centre of mass: (6, n).
using WrenchMatrix = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// A WrenchMatrix, some of its columns in a row, or columns that lie elsewhere one after another.
using WrenchView = Eigen::Ref<const WrenchMatrix, 0, Eigen::OuterStride<6>>;

/// How contacts become wrenches. A point contact transmits a force f, |f_t| <= mu f_n. A soft finger transmits a moment
/// tau about the normal beside it,  |f_t|^2 / mu^2 + tau^2 / (mu e)^2 <= f_n^2  (Howe, Cutkosky 1996).
struct WrenchModel {
  Eigen::Vector3d centerOfMass = Eigen::Vector3d::Zero();  // c [m]
  double torqueScale = 1;                                  // s [m], largest distance of the surface from c
  double friction = 0.4;                                   // mu of Coulomb's law
  int coneEdges = 8;                                       // m >= 3 edges of a linearised cone
  double torsionRadius = 0;                                // e [m] of soft fingers; 0: point contacts

  /// With fewer no set of contacts is force closed: three points, two soft fingers (Nguyen 1987).
  std::size_t fewestContacts() const { return torsionRadius > 0 ? 2 : 3; }
};

/// The generators of all friction cones, contact by contact:
///
///     f_ij = n_i + mu (cos(2 pi j / m) t_i + sin(2 pi j / m) b_i),    w_ij = (f_ij; (p_i - c) x f_ij / s)       (1)
///
/// Each generator has normal component 1 (L1 model). t_i, b_i follow from n_i alone (Duff et al. 2017, "Building an
/// Orthonormal Basis, Revisited"). Soft fingers have 3 m + 2 generators each, points of the ellipsoid of (10): the m
/// edges, m at 45 degrees on either side of them, and the two moments mu e alone.
/// @return (6, nContacts m), column m i + j, or (6, nContacts (3 m + 2)); NaN where a contact has NaN
/// @note   Const; safe from many threads. Allocates the result only.
WrenchMatrix frictionConeWrenches(std::span<const Contact> contacts, const WrenchModel& model);

/// The same for one set of contacts after another, in memory that is kept: no call allocates once one has seen as many
/// contacts. One a worker.
class FrictionCones {
 public:
  explicit FrictionCones(const WrenchModel& model);
  /// frictionConeWrenches(contacts, model), valid until the next call.
  Eigen::Map<const WrenchMatrix> wrenches(std::span<const Contact> contacts);

 private:
  WrenchModel model_;
  std::vector<Eigen::Vector3d> generators_;  // along t, b, and e n / s
  std::vector<double> columns_;
};

/// Distances in wrench space are relative to the longest column, R = max |w|.
/// notClosed is proved by a plane that leaves no column more than this, times R, beyond it. Wrenches of a flat set
/// (two opposed points) are off their subspace by rounding, 1e-15; no set of wrenches is known better than 1e-10.
inline constexpr double kSeparationTolerance = 1e-10;

/// closed needs every weight of the balance 0 = (w0 + B lambda) / (1 + sum lambda) to be above this.
inline constexpr double kBalanceTolerance = 1e-10;

/// The true radius lies within this, times R, of what epsilonMetric returns.
inline constexpr double kEpsilonTolerance = 1e-10;

enum class ForceClosure : unsigned char { closed, notClosed, failed };

/// The verdict and its proof.
struct ForceClosureResult {
  ForceClosure verdict = ForceClosure::failed;
  /// closed: six columns B and an interior positive mixture w0 of all columns with  B lambda = -w0, lambda > 0.
  std::array<int, 6> basis{};
  Eigen::Matrix<double, 6, 1> interiorPoint = Eigen::Matrix<double, 6, 1>::Zero();  // w0
  /// notClosed: a unit direction with  direction . w <= kSeparationTolerance R  for every column w.
  Eigen::Matrix<double, 6, 1> separatingDirection = Eigen::Matrix<double, 6, 1>::Zero();
};

/// Is the origin strictly inside the convex hull of the columns?
///
/// The linear program  max t: W lambda = 0, sum lambda = 1, lambda >= t  has a positive optimum and rank W = 6 exactly
/// when a strictly positive mixture w0 of all columns can be balanced:  W_B lambda_B = -w0, lambda_B > 0. Phase 1 of
/// the revised simplex method with six rows decides it; its multipliers separate the origin when it cannot.
///
/// Both verdicts are checked against the columns before they are returned. A set whose epsilon lies in
/// (0, kSeparationTolerance R] may be called notClosed. A column that is not finite, or a balance that rounding spoils,
/// is `failed`, never notClosed.
/// @note Const; safe from many threads: scratch is thread_local and keeps its memory, so that no call allocates once
///       the thread has seen a set of this size. The same bits on every instruction set.
/// Source: src/quality/README.md, equations (2) to (5).
ForceClosureResult testForceClosure(const WrenchView& wrenches);

/// Epsilon (Ferrari, Canny 1992): radius of the largest ball about the origin inside the convex hull of the columns, by
/// a guided double description that starts from the simplex in `closure`.
/// @param wrenches  the columns that `closure` was made from, fewer than 65535
/// @param closure   of testForceClosure, verdict closed
/// @return the radius, within kEpsilonTolerance R; NaN when rounding stopped the expansion (never a guess)
/// @note Safe from many threads: scratch is thread_local and keeps its memory, so that no call allocates once the
///       thread has seen a set of this size. The same bits on every instruction set.
/// Source: src/quality/README.md, equations (6) to (9).
double epsilonMetric(const WrenchView& wrenches, const ForceClosureResult& closure);

}  // namespace handhold
