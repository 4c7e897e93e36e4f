#include "simulate/centering.h"
#include "simulate/closing_plan.h"
#include "simulate/collision_models.h"
#include "simulate/contacts.h"
#include "simulate/grasp_policy.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace handhold {

using Eigen::Isometry3d;
using Eigen::Vector3d;

namespace {

/// What depends on the preshape alone.
struct PreparedPreshape {
  std::vector<Isometry3d> X_HL;
  Isometry3d X_GH;
  std::vector<std::pair<int, int>> apart;  // link pairs that are apart here and must stay so
};

class ReferencePolicy final : public GraspPolicy {
 public:
  ReferencePolicy(const Hand& hand, const ObjectModel& object, PolicyKind kind, const ReferenceSettings& settings)
      : hand_(hand), object_(object), kind_(kind), settings_(settings) {
    models_ = std::make_shared<const CollisionModels>(hand, object);
    solidLinks_ = solidLinks(hand);
    for (const ClosingJoint& closing : hand.closing) steps_.push_back(makeClosingStep(hand, closing));
    for (const Preshape& preshape : hand.preshapes) preshapes_.push_back(preparePreshape(preshape));
  }

  std::unique_ptr<GraspPolicy> clone() const override { return std::make_unique<ReferencePolicy>(*this); }

  void run(const GraspCandidate& candidate, GraspTrial& trial) override {
    queries_ = 0;
    trial = GraspTrial{};
    backOff(candidate, trial);
    closeAndGather(candidate.preshape, trial);
  }

  bool closeAt(const Isometry3d& X_OH, int preshape, GraspTrial& trial) override {
    queries_ = 0;
    trial = GraspTrial{};
    trial.X_OH = X_OH;
    likelyLink_ = solidLinks_[0];
    if (handTouches(X_OH, preshape)) return false;
    closeAndGather(preshape, trial);
    return true;
  }

  void touchAt(const Isometry3d& X_OH, const Eigen::VectorXd& jointPosition, GraspTrial& trial) override {
    queries_ = 0;
    trial = GraspTrial{};
    trial.X_OH = X_OH;
    trial.jointPosition = jointPosition;
    trial.outcome = GraspOutcome::notForceClosed;
    gatherContacts(trial);
  }

  bool approachIsClear(const GraspCandidate& candidate, const GraspTrial& trial) override {
    centering_ = trial.centering;  // the hand comes in where it will close
    const double outside = outsideDistance(candidate);
    const bool moved = !centering_.isZero();
    bool clear = true;
    for (double t = trial.backoff + (moved ? 0 : settings_.linearStep); clear && t < outside;
         t += settings_.linearStep) {
      clear = !handTouchesAt(candidate, t);
    }
    centering_.setZero();
    return clear;
  }

  bool selfCollides(const GraspCandidate& candidate, const GraspTrial& trial) override {
    const std::vector<Isometry3d> X_HL = forwardKinematics(hand_, trial.jointPosition);
    const auto& pairs = preshapes_[candidate.preshape].apart;
    return std::any_of(pairs.begin(), pairs.end(), [&](const auto& pair) {
      return models_->links().touch(pair.first, X_HL[pair.first], pair.second, X_HL[pair.second]);
    });
  }

  // What closeHand asks for.

  /// Moves one joint in its direction until a link that it moves touches, or to its limit.
  ClosingStop closeJoint(std::size_t step, ClosingPart part, GraspTrial& trial) {
    const Mover& mover = steps_[step].mover(part);
    const Isometry3d& X_OH = trial.X_OH;
    Eigen::VectorXd& q = trial.jointPosition;
    const Joint& joint = hand_.joints[mover.joint];
    const bool turns = joint.type == JointType::revolute;
    const double stride = turns ? settings_.angularStep : settings_.linearStep;
    const double limit = mover.direction > 0 ? joint.upper : joint.lower;
    ClosingStop stop{mover.joint, q[mover.joint], {}};
    const auto posesAt = [&](double position) {
      place(hand_, mover, position, q);
      return forwardKinematics(hand_, q);
    };
    const auto touches = [&](double position) {
      const std::vector<Isometry3d> X_HL = posesAt(position);
      return std::any_of(mover.links.begin(), mover.links.end(),
                         [&](int link) { return linkTouches(link, X_OH * X_HL[link]); });
    };
    while (mover.direction * (limit - stop.position) > 0) {
      double next = stop.position + mover.direction * stride;
      if (mover.direction * (limit - next) < 0) next = limit;
      if (touches(next)) {
        const double tolerance = turns ? settings_.angularTolerance : settings_.linearTolerance;
        stop.position = bisect(next, stop.position, tolerance, touches);
        const std::vector<Isometry3d> X_HL = posesAt(stop.position + mover.direction * tolerance);
        for (const int link : mover.links) {
          if (linkTouches(link, X_OH * X_HL[link])) stop.links.push_back(link);
        }
        break;
      }
      stop.position = next;
    }
    place(hand_, mover, stop.position, q);
    return stop;
  }

  /// One jaw against a fixed counterpart: the hand slides along its closing axis, palm where it is, until the
  /// counterpart (any link that this joint does not move) touches. Where it finds nothing the hand stays.
  void bringUpCounterpart(std::size_t step, GraspTrial& trial) {
    const std::vector<int>& fixed = steps_[step].fixedLinks;
    const std::vector<Isometry3d> X_HL = forwardKinematics(hand_, trial.jointPosition);
    const Vector3d axis = -(trial.X_OH.linear() * (X_HL[hand_.palmLink].linear() * hand_.X_LG.linear().col(0)));
    const auto touches = [&](double slide) {
      const Isometry3d X_OH = Eigen::Translation3d(slide * axis) * trial.X_OH;
      return std::any_of(fixed.begin(), fixed.end(), [&](int link) { return linkTouches(link, X_OH * X_HL[link]); });
    };
    double slide = 0;
    do slide += settings_.linearStep;
    while (slide < kLongestSlide && !touches(slide));
    if (slide >= kLongestSlide) return;
    slide = bisect(slide, slide - settings_.linearStep, settings_.linearTolerance, touches);
    trial.centering += slide * axis;
    trial.X_OH.translation() += slide * axis;
  }

  void setPosture(const Eigen::VectorXd&) {}

  /// After centring: does a link that is not a jaw of this step touch?
  bool restTouches(const ClosingStep& step, const GraspTrial& trial) {
    const std::vector<Isometry3d> X_HL = forwardKinematics(hand_, trial.jointPosition);
    return std::any_of(solidLinks_.begin(), solidLinks_.end(), [&](int link) {
      const auto& jaws = step.together.links;
      return std::find(jaws.begin(), jaws.end(), link) == jaws.end() && linkTouches(link, trial.X_OH * X_HL[link]);
    });
  }

 private:
  void closeAndGather(int preshape, GraspTrial& trial) {
    trial.jointPosition = hand_.preshapes[preshape].jointPosition;
    trial.outcome =
        closeHand(hand_, steps_, *this, trial) ? GraspOutcome::notForceClosed : GraspOutcome::blockedCentering;
    if (trial.outcome == GraspOutcome::notForceClosed) gatherContacts(trial);
    trial.collisionQueries = queries_;
  }

  PreparedPreshape preparePreshape(const Preshape& preshape) const {
    PreparedPreshape prepared;
    prepared.X_HL = forwardKinematics(hand_, preshape.jointPosition);
    prepared.X_GH = (prepared.X_HL[hand_.palmLink] * hand_.X_LG).inverse();
    prepared.apart = models_->links().apart(pairsThatMove(hand_), prepared.X_HL);
    return prepared;
  }

  /// Surface test of one link; counts the query.
  bool linkTouches(int link, const Isometry3d& X_OL) {
    ++queries_;
    return models_->surfacesTouch(link, X_OL);
  }

  Isometry3d handPoseAt(const GraspCandidate& candidate, double t) const {
    return palmPose(candidate.targetPoint - t * candidate.approach + centering_, candidate.approach, candidate.roll) *
           preshapes_[candidate.preshape].X_GH;
  }

  /// The hand in its preshape at X_OH: surfaces first, the link that touched last before the others, then
  /// containment.
  bool handTouches(const Isometry3d& X_OH, int preshape) {
    const auto& X_HL = preshapes_[preshape].X_HL;
    if (linkTouches(likelyLink_, X_OH * X_HL[likelyLink_])) return true;
    for (const int link : solidLinks_) {
      if (link != likelyLink_ && linkTouches(link, X_OH * X_HL[link])) {
        likelyLink_ = link;
        return true;
      }
    }
    return std::any_of(solidLinks_.begin(), solidLinks_.end(),
                       [&](int link) { return models_->isContained(link, X_OH * X_HL[link]); });
  }

  bool handTouchesAt(const GraspCandidate& candidate, double t) {
    return handTouches(handPoseAt(candidate, t), candidate.preshape);
  }

  /// A back-off from which on the hand is past the object: every point of the hand behind every point of the object.
  double outsideDistance(const GraspCandidate& candidate) const {
    const Isometry3d X_OH = handPoseAt(candidate, 0);
    const auto& X_HL = preshapes_[candidate.preshape].X_HL;
    double foremost = -std::numeric_limits<double>::infinity();
    for (const int link : solidLinks_) {
      const Isometry3d X_OL = X_OH * X_HL[link];
      for (const Vector3d& p : hand_.links[link].mesh.vertices) {
        foremost = std::max(foremost, candidate.approach.dot(X_OL * p));
      }
    }
    double hindmost = std::numeric_limits<double>::infinity();
    for (const Vector3d& p : object_.mesh.vertices) hindmost = std::min(hindmost, candidate.approach.dot(p));
    return foremost - hindmost + settings_.linearStep;
  }

  /// The end of a bisection between a touching and a free value: the free side, within `tolerance`.
  template <class Touches>
  static double bisect(double touching, double free, double tolerance, const Touches& touches) {
    while (std::abs(free - touching) > tolerance) {
      const double middle = 0.5 * (free + touching);
      (touches(middle) ? touching : free) = middle;
    }
    return free;
  }

  /// The smallest t >= `start` at which the hand is free.
  double firstFree(const GraspCandidate& candidate, double start) {
    const auto touches = [&](double t) { return handTouchesAt(candidate, t); };
    if (!touches(start)) return start;
    double t = start;
    do t += settings_.linearStep;
    while (touches(t));
    return bisect(t - settings_.linearStep, t, settings_.linearTolerance, touches);
  }

  /// Where the hand, coming from outside, is stopped: by a touch, or at t0.
  double lastFree(const GraspCandidate& candidate) {
    const auto touches = [&](double t) { return handTouchesAt(candidate, t); };
    double t = std::max(outsideDistance(candidate), settings_.startBackoff);
    while (t > settings_.startBackoff) {
      const double next = std::max(t - settings_.linearStep, settings_.startBackoff);
      if (touches(next)) return bisect(next, t, settings_.linearTolerance, touches);
      t = next;
    }
    return t;
  }

  void backOff(const GraspCandidate& candidate, GraspTrial& trial) {
    likelyLink_ = solidLinks_[0];
    const double standoff = hand_.preshapes[candidate.preshape].standoff;
    trial.backoff =
        kind_ == PolicyKind::surfaceNormal ? firstFree(candidate, settings_.startBackoff) : lastFree(candidate);
    if (standoff > 0) trial.backoff = firstFree(candidate, trial.backoff + standoff);
    trial.X_OH = handPoseAt(candidate, trial.backoff);
  }

  void gatherContacts(GraspTrial& trial) {
    const std::vector<Isometry3d> X_HL = forwardKinematics(hand_, trial.jointPosition);
    for (const int link : solidLinks_) {
      if (!hand_.links[link].contactAllowed) continue;
      const Isometry3d X_OL = trial.X_OH * X_HL[link];
      models_->trianglesNear(link, X_OL, settings_.contactDistance, nearTriangles_);
      if (nearTriangles_.empty()) continue;
      collectCandidates(hand_.links[link].mesh, X_OL);
      selectContacts(candidates_, settings_.contactsPerLink, settings_.contactSpacing, static_cast<std::uint16_t>(link),
                     contactScratch_, trial.contacts);
    }
  }

  static Eigen::AlignedBox3d boxOf(const Corners& corners, double margin) {
    Eigen::AlignedBox3d box(corners[0]);
    box.extend(corners[1]).extend(corners[2]);
    return {box.min().array() - margin, box.max().array() + margin};
  }

  /// All pairs of a near object triangle and a link triangle whose boxes meet.
  void collectCandidates(const TriangleMesh& link, const Isometry3d& X_OL) {
    candidates_.clear();
    Eigen::AlignedBox3d nearBox;
    for (const std::uint32_t i : nearTriangles_)
      nearBox.extend(boxOf(object_.mesh.corners(i), settings_.contactDistance));
    for (std::size_t j = 0; j < link.triangles.size(); ++j) {
      Corners linkCorners = link.corners(j);
      for (Vector3d& corner : linkCorners) corner = X_OL * corner;
      const Eigen::AlignedBox3d linkBox = boxOf(linkCorners, settings_.contactDistance);
      if (!linkBox.intersects(nearBox)) continue;
      const ContactTriangle linkTriangle = contactTriangle(linkCorners);
      for (const std::uint32_t i : nearTriangles_) {
        const Corners objectCorners = object_.mesh.corners(i);
        if (!linkBox.intersects(boxOf(objectCorners, 0))) continue;
        addContactCandidates(contactTriangle(objectCorners), linkTriangle, settings_.contactDistance,
                             !object_.watertight, candidates_);
      }
    }
  }

  const Hand& hand_;
  const ObjectModel& object_;
  PolicyKind kind_;
  ReferenceSettings settings_;
  std::shared_ptr<const CollisionModels> models_;
  std::vector<int> solidLinks_;
  std::vector<ClosingStep> steps_;
  std::vector<PreparedPreshape> preshapes_;

  // scratch of one worker
  int queries_ = 0;
  int likelyLink_ = 0;
  Vector3d centering_ = Vector3d::Zero();  // m, in O: moves the approach of a jaw that centres itself
  std::vector<std::uint32_t> nearTriangles_;
  std::vector<ContactCandidate> candidates_;
  ContactScratch contactScratch_;
};

}  // namespace

std::unique_ptr<GraspPolicy> makeUncenteredReference(const Hand& hand, const ObjectModel& object, PolicyKind kind,
                                                     const ReferenceSettings& settings) {
  return std::make_unique<ReferencePolicy>(hand, object, kind, settings);
}

std::unique_ptr<GraspPolicy> makeReferencePolicy(const Hand& hand, const ObjectModel& object, PolicyKind kind,
                                                 const ReferenceSettings& settings) {
  return centerCoupledJaws(hand, makeUncenteredReference(hand, object, kind, settings));
}

}  // namespace handhold
