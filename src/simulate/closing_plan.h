#pragma once

#include "hand/hand.h"

#include <utility>
#include <vector>

namespace handhold {

/// A joint that moves, alone or with its followers, and the links that move with it.
struct Mover {
  int joint = -1;
  int direction = 1;
  std::vector<int> followers;
  std::vector<int> links;  // with geometry
};

/// One entry of the hand's closing rule, made ready.
struct ClosingStep {
  Mover together;   // the joint with its followers
  Mover alone;      // selfCentering of two jaws: the joint without them
  Mover follower;   // selfCentering of two jaws: the other jaw
  Mover breakaway;  // joint -1: none
  bool selfCentering = false;
  std::vector<int> fixedLinks;  // selfCentering without a follower: the counterpart that is brought up first
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

}  // namespace handhold
