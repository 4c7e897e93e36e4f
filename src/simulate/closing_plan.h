#pragma once

#include "hand/hand.h"
#include "simulate/grasp_policy.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace handhold {

/// A joint that moves, alone or with its followers, and the links that move with it.
struct Mover {
  int joint = -1;
  int direction = 1;
  std::vector<int> followers;
  std::vector<int> links;  // with geometry
  std::vector<int> moved;  // all links that move, ascending
};

/// What of a closing step moves.
enum class ClosingPart : std::uint8_t { together, alone, follower, breakaway };

/// One entry of the hand's closing rule, made ready.
struct ClosingStep {
  Mover together;               // the joint with its followers
  Mover alone;                  // selfCentering of two jaws: the joint without them
  Mover follower;               // selfCentering of two jaws: the other jaw
  Mover breakaway;              // joint -1: none
  bool selfCentering = false;   // but by coupled jaws: centering.h
  std::vector<int> fixedLinks;  // selfCentering without a follower: the counterpart that is brought up first

  const Mover& mover(ClosingPart part) const {
    return part == ClosingPart::together   ? together
           : part == ClosingPart::alone    ? alone
           : part == ClosingPart::follower ? follower
                                           : breakaway;
  }
};

/// How far a hand slides to bring up the counterpart of a single jaw [m].
inline constexpr double kLongestSlide = 0.3;

/// The links that have geometry, ascending.
std::vector<int> solidLinks(const Hand& hand);

/// The pairs of links with geometry, lower index first, that closing can move against each other.
std::vector<std::pair<int, int>> pairsThatMove(const Hand& hand);

ClosingStep makeClosingStep(const Hand& hand, const ClosingJoint& closing);

/// After two jaws of a self-centring step closed one by one to q[alone] and q[follower]: couples them again (in `q`),
/// and says how the hand has to move for them to stay where they are.
/// @return m, in the root link's frame H
Eigen::Vector3d centerJaws(const Hand& hand, const ClosingStep& step, Eigen::VectorXd& q);

/// Puts a mover's joint at `position`, its followers along, each within its own limits.
void place(const Hand& hand, const Mover& mover, double position, Eigen::VectorXd& q);

/// Both jaws close until each touches; then the hand moves by half the difference so that they are coupled again, with
/// the jaws where they were on the object. A jaw that finds nothing: both close coupled, as the URDF says. `closer` as
/// in closeHand. False: the rest of the hand would be pushed into the object.
template <class Closer>
bool closeCentering(const Hand& hand, const std::vector<ClosingStep>& steps, std::size_t i, Closer& closer,
                    GraspTrial& trial) {
  Eigen::VectorXd& q = trial.jointPosition;
  const Eigen::VectorXd before = q;
  const ClosingStop first = closer.closeJoint(i, ClosingPart::alone, trial);
  const ClosingStop second = closer.closeJoint(i, ClosingPart::follower, trial);
  if (first.links.empty() || second.links.empty()) {
    q = before;
    closer.setPosture(q);
    trial.stops.push_back(closer.closeJoint(i, ClosingPart::together, trial));
    return true;
  }
  trial.stops.push_back(first);
  trial.stops.push_back(second);
  const Eigen::Vector3d shift = trial.X_OH.linear() * centerJaws(hand, steps[i], q);
  trial.centering += shift;
  trial.X_OH.translation() += shift;
  closer.setPosture(q);
  return !closer.restTouches(steps[i], trial);
}

/// Closes every finger in the hand's order from trial.X_OH and trial.jointPosition. What depends on the policy:
///
///     ClosingStop closer.closeJoint(step, part, trial)   moves a joint until what it moves touches, or to its limit
///     void closer.bringUpCounterpart(step, trial)        slides the hand until the counterpart of a single jaw touches
///     bool closer.restTouches(step, trial)               does a link that the step does not move touch?
///     void closer.setPosture(q)                          told when q changed otherwise than by closeJoint
///
/// False: a self-centring jaw is blocked.
template <class Closer>
bool closeHand(const Hand& hand, const std::vector<ClosingStep>& steps, Closer& closer, GraspTrial& trial) {
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const ClosingStep& step = steps[i];
    if (step.selfCentering && step.fixedLinks.empty()) {
      if (!closeCentering(hand, steps, i, closer, trial)) return false;
      continue;
    }
    if (step.selfCentering) closer.bringUpCounterpart(i, trial);
    trial.stops.push_back(closer.closeJoint(i, ClosingPart::together, trial));
    if (step.breakaway.joint < 0) continue;
    // The clutch opens when the proximal link is stopped; a finger stopped by its distal link stays coupled.
    const auto& outer = step.breakaway.links;
    const std::vector<int>& stopped = trial.stops.back().links;
    const bool opens = std::any_of(stopped.begin(), stopped.end(), [&](int link) {
      return std::find(outer.begin(), outer.end(), link) == outer.end();
    });
    if (opens) trial.stops.push_back(closer.closeJoint(i, ClosingPart::breakaway, trial));
  }
  return true;
}

}  // namespace handhold
