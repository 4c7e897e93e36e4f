#pragma once

#include "hand/hand.h"
#include "mesh/object.h"
#include "quality/contact.h"

#include <array>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Why a trial ended as it did. Stored per trial; the names are part of the file.
enum class GraspOutcome : std::uint8_t {
  forceClosed,       // kept
  notForceClosed,    // contacts cannot resist every wrench
  tooFewContacts,    // no set so small is force closed (WrenchModel::fewestContacts)
  blockedCentering,  // a jaw that centres itself would push the rest of the hand into the object
  selfCollision,     // force closed, but parts of the hand pass through each other
  solveFailed,       // force closure or epsilon could not be computed
  notRun,            // the build was stopped
};
inline constexpr std::array<std::string_view, 7> kOutcomeNames = {
    "force_closed",   "not_force_closed", "too_few_contacts", "blocked_centering",
    "self_collision", "solve_failed",     "not_run"};

enum class PolicyKind { surfaceNormal, centerOfMass };

/// The parameters P = (P_d, P_t, P_r, P_p) of one trial, in the object frame.
struct GraspCandidate {
  Eigen::Vector3d targetPoint;  // P_t [m]
  Eigen::Vector3d approach;     // P_d, unit, towards the object
  double roll = 0;              // P_r [rad] about P_d
  int preshape = 0;             // P_p, index into Hand::preshapes
};

/// Where one step of closing ended.
struct ClosingStop {
  int joint = -1;
  double position = 0;     // rad or m
  std::vector<int> links;  // that stopped it; empty: the joint's limit
};

/// What the policy did. Poses are of the hand's root link H in the object frame O.
struct GraspTrial {
  /// notForceClosed or blockedCentering: what the contacts make of the first, the policy does not know.
  GraspOutcome outcome = GraspOutcome::notRun;
  Eigen::Isometry3d X_OH = Eigen::Isometry3d::Identity();
  double backoff = 0;                                   // m, t of the palm behind P_t, standoff included
  Eigen::Vector3d centering = Eigen::Vector3d::Zero();  // m, how far a self-centring jaw moved the hand, in O
  Eigen::VectorXd jointPosition;                        // (J)
  std::vector<ClosingStop> stops;                       // in the order of closing
  std::vector<Contact> contacts;                        // grouped by link, a few well-spread points each
  int collisionQueries = 0;
  bool byReference = false;  // the fast policy left this trial to the reference
};

/// The palm frame G that faces along `approach` with its origin at `position`: z_G = approach; x_G at roll 0 points as
/// far towards the object's +z as it can, or towards +x when the approach is within 25 degrees of the z axis; the roll
/// turns x_G about the approach direction.
Eigen::Isometry3d palmPose(const Eigen::Vector3d& position, const Eigen::Vector3d& approach, double roll);

/// Runs the policy of Berenson et al. 2007, II-B: palm at P_t facing along P_d, backed off until just free, fingers
/// closed, contacts gathered. One implementation is the reference, others must agree with it.
/// @note Not thread safe: one policy a worker. Deterministic: equal candidates give equal trials.
class GraspPolicy {
 public:
  virtual ~GraspPolicy() = default;
  virtual void run(const GraspCandidate& candidate, GraspTrial& trial) = 0;
  /// The same from a given pose of the hand, without backing off: fingers closed, contacts gathered. False when the
  /// hand in its preshape touches the object there; the trial is then without meaning.
  virtual bool closeAt(const Eigen::Isometry3d& X_OH, int preshape, GraspTrial& trial) = 0;
  /// The same in a given posture, joint positions (J): nothing moves and nothing is asked of the preshape.
  virtual void touchAt(const Eigen::Isometry3d& X_OH, const Eigen::VectorXd& jointPosition, GraspTrial& trial) = 0;
  /// Is the straight approach along P_d from outside to the trial's back-off, in its preshape, free of the object?
  virtual bool approachIsClear(const GraspCandidate& candidate, const GraspTrial& trial) = 0;
  /// Do parts of the hand that are apart in the preshape pass through each other in the trial's posture?
  virtual bool selfCollides(const GraspCandidate& candidate, const GraspTrial& trial) = 0;
  /// Another policy for another worker; models are shared.
  virtual std::unique_ptr<GraspPolicy> clone() const = 0;
};

/// Tolerances of the reference. A window (free or blocked) thinner than its step can be missed.
struct ReferenceSettings {
  double startBackoff = 3e-4;      // t0 [m]
  double linearStep = 2e-3;        // m, of back-off, approach and prismatic joints
  double angularStep = 0.035;      // rad, of revolute joints
  double linearTolerance = 1e-5;   // m, a stop is free and at most this far before touching
  double angularTolerance = 1e-4;  // rad
  double contactDistance = 1e-4;   // m, points of object and link at most this far apart are in contact
  int contactsPerLink = 4;         // at most
  double contactSpacing = 1e-3;    // m, at least, between two contacts of a link
};

/// The reference: exact triangles, FCL collision tests, stepping and bisection. `hand` and `object` must outlive it.
std::unique_ptr<GraspPolicy> makeReferencePolicy(const Hand& hand, const ObjectModel& object, PolicyKind kind,
                                                 const ReferenceSettings& settings = {});

}  // namespace handhold
