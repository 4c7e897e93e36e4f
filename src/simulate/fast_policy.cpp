#include "simulate/fast_policy.h"

#include "mesh/ray_scene.h"
#include "simulate/centering.h"
#include "simulate/contacts.h"
#include "simulate/fast_kernels.h"
#include "simulate/reference_policy.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using kernels::kGroup;
using kernels::NearTriangles;
using kernels::PlacedGrid;
using kernels::Points;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kClearance = 2e-6;  // m, a stop is this far on the free side
constexpr double kConverged = 2e-7;  // m
// How far ahead of a guess the exact search sees every pair [m]: a little more than contacts need, so that they need no
// search of their own, and more when nothing is there.
constexpr double kBeyondContacts = 6e-5, kMostWindow = 6e-4;
constexpr double kSameAngle = 1e-5, kSameDistance = 1e-6;  // rad, m: links that touch within it stop a joint together
constexpr double kHiddenWindow = 3e-3;                     // m, a free window that the dilated fields can hide
constexpr float kCaution = 2.5e-4F;                        // m, that an interpolated depth may be too large by
constexpr float kWorthAStep = 1e-4F;                       // m
constexpr std::size_t kMostMuted = 16;                     // planes of slides that a motion keeps
// Before the trial goes to the reference: of an exact search about one place, and of places that a motion passes, as
// many as half a millimetre each takes through the longest slide.
constexpr int kMostRounds = 24, kMostPlaces = 600;

/// The trial goes to the reference.
struct Unsettled {};

/// How fast points move: turn x p + shift.
struct Twist {
  Vector3d turn = Vector3d::Zero(), shift = Vector3d::Zero();

  /// The same seen in the frame that X leads to.
  Twist in(const Isometry3d& X) const {
    const Vector3d turned = X.linear() * turn;
    return {turned, X.linear() * shift - turned.cross(X.translation())};
  }
};

/// Where a motion stops: at s, by a touch or because nothing is met up to there.
struct Touch {
  double s = 0;
  bool touched = false;
};

/// Points on their way to a kernel, each with the parameter to start from.
struct Group {
  Points points;
  alignas(64) float start[kGroup];
  int count = 0;

  /// True when it is full.
  bool push(float x, float y, float z, float from) {
    points.x[count] = x;
    points.y[count] = y;
    points.z[count] = z;
    start[count] = from;
    return ++count == kGroup;
  }
  /// Fills up with its first point, and is empty for the next push.
  void pad() {
    for (int i = count; i < kGroup; ++i) {
      points.x[i] = points.x[0];
      points.y[i] = points.y[0];
      points.z[i] = points.z[0];
      start[i] = start[0];
    }
    count = 0;
  }
};

class FastPolicy final : public GraspPolicy {
 public:
  FastPolicy(std::shared_ptr<const HandFields> fields, const Hand& hand, const ObjectModel& object, PolicyKind kind,
             const ReferenceSettings& settings)
      : fields_(std::move(fields)),
        hand_(hand),
        object_(object),
        kind_(kind),
        settings_(settings),
        shell_(std::make_shared<const ObjectShell>(object)),
        objectScene_(std::make_shared<const RayScene>(object.mesh)),
        objectBox_(boundingBox(object.mesh)),
        reference_(makeUncenteredReference(hand, object, kind, settings)) {
    reserve();
  }

  FastPolicy(const FastPolicy& other)
      : fields_(other.fields_),
        hand_(other.hand_),
        object_(other.object_),
        kind_(other.kind_),
        settings_(other.settings_),
        shell_(other.shell_),
        objectScene_(other.objectScene_),
        objectBox_(other.objectBox_),
        reference_(other.reference_->clone()) {
    reserve();
  }

  std::unique_ptr<GraspPolicy> clone() const override { return std::make_unique<FastPolicy>(*this); }

  void run(const GraspCandidate& candidate, GraspTrial& trial) override {
    try {
      begin(candidate.preshape, trial);
      backOff(candidate, trial);
      closeAndGather(trial);
    } catch (const Unsettled&) {
      reference_->run(candidate, trial);
      trial.byReference = true;
    }
  }

  bool closeAt(const Isometry3d& X_OH, int preshape, GraspTrial& trial) override {
    try {
      begin(preshape, trial);
      trial.X_OH = X_OH;
      trial.backoff = 0;
      const auto& links = fields_->links;
      if (std::any_of(links.begin(), links.end(), [&](int link) { return linkTouches(link, X_OH); })) return false;
      if (isContained(X_OH)) return false;
      closeAndGather(trial);
      return true;
    } catch (const Unsettled&) {
      const bool free = reference_->closeAt(X_OH, preshape, trial);
      trial.byReference = true;
      return free;
    }
  }

  void touchAt(const Isometry3d& X_OH, const Eigen::VectorXd& jointPosition, GraspTrial& trial) override {
    reference_->touchAt(X_OH, jointPosition, trial);
    trial.byReference = true;
  }

  bool approachIsClear(const GraspCandidate& candidate, const GraspTrial& trial) override {
    constexpr double kBeyond = 1e-3;  // m: what ended the back-off is not met again
    preshape_ = &fields_->preshapes[candidate.preshape];
    X_GS_ =
        palmPose(candidate.targetPoint + trial.centering, candidate.approach, candidate.roll).inverse() * fromShell();
    const double start = trial.backoff + kBeyond;
    return shellExit(start, true) <= start;
  }

  bool selfCollides(const GraspCandidate& candidate, const GraspTrial& trial) override {
    forwardKinematics(hand_, trial.jointPosition, X_HL_);
    const auto& pairs = fields_->preshapes[candidate.preshape].apart;
    return std::any_of(pairs.begin(), pairs.end(), [&](const auto& pair) {
      const auto [a, b] = pair;
      return !areApart(a, b) && fields_->models.touch(a, X_HL_[a], b, X_HL_[b]);
    });
  }

  // What closeHand asks for.

  ClosingStop closeJoint(std::size_t step, ClosingPart part, GraspTrial& trial) {
    const Motion& motion = fields_->motions[preshape_->steps[step].motion[static_cast<std::size_t>(part)]];
    const Mover& mover = *motion.mover;
    ClosingStop stop{mover.joint, trial.jointPosition[mover.joint], {}};
    const double from = motion.direction * (stop.position - motion.start);
    const Touch touch = touchOf(motion, from, trial);
    stop.position = motion.start + motion.direction * touch.s;
    if (touch.touched) {
      stop.links = touchedLinks_;
    } else {
      stop.position = mover.direction > 0 ? hand_.joints[mover.joint].upper : hand_.joints[mover.joint].lower;
      if (from >= motion.range) stop.position = trial.jointPosition[mover.joint];
    }
    place(hand_, mover, stop.position, trial.jointPosition);
    updateKinematics(hand_, trial.jointPosition, mover.moved, X_HL_);
    return stop;
  }

  void bringUpCounterpart(std::size_t step, GraspTrial& trial) {
    const Motion& motion = fields_->motions[preshape_->steps[step].counterpart];
    const Touch touch = touchOf(motion, 0, trial);
    if (!touch.touched) return;
    const Vector3d shift = touch.s * (trial.X_OH.linear() * motion.slideAxis);
    trial.centering += shift;
    trial.X_OH.translation() += shift;
  }

  void setPosture(const Eigen::VectorXd& q) { forwardKinematics(hand_, q, X_HL_); }

  bool restTouches(const ClosingStep& step, const GraspTrial& trial) {
    const auto& jaws = step.together.links;
    return std::any_of(fields_->links.begin(), fields_->links.end(), [&](int link) {
      return std::find(jaws.begin(), jaws.end(), link) == jaws.end() && linkTouches(link, trial.X_OH);
    });
  }

 private:
  void reserve() {
    const std::size_t blocks = shell_->pointTree.blocks.size() + kGroup;
    std::size_t most = std::max(blocks, shell_->triangleTree.blocks.size() + kGroup);
    for (const SphereTree& cover : fields_->covers) most = std::max(most, cover.blocks.size() + kGroup);
    blockIds_.resize(most);
    blockFirsts_.resize(blocks);
    nearIds_.resize(shell_->source.size() + kGroup);
    scratchIds_.resize(shell_->source.size() + kGroup);
  }

  void begin(int preshape, GraspTrial& trial) {
    trial.outcome = GraspOutcome::notForceClosed;
    trial.stops.clear();
    trial.contacts.clear();
    trial.centering.setZero();
    trial.collisionQueries = 0;
    trial.byReference = false;
    trial.jointPosition = hand_.preshapes[preshape].jointPosition;
    preshape_ = &fields_->preshapes[preshape];
    X_HL_ = preshape_->X_HL;
    for (Search& search : searches_) {
      search.margin = -1;
      search.isKnown = false;
    }
    ++trial_;
  }

  void closeAndGather(GraspTrial& trial) {
    if (!closeHand(hand_, fields_->steps, *this, trial)) {
      trial.outcome = GraspOutcome::blockedCentering;
      return;
    }
    gatherContacts(trial);
  }

  /// Are two links apart for sure: no sphere of one's cover near the other?
  bool areApart(int a, int b) {
    const LinkGrid &gridA = *fields_->grids[a], &gridB = *fields_->grids[b];
    const double between = (X_HL_[a] * gridA.center - X_HL_[b] * gridB.center).norm();
    if (between > gridA.radius + gridB.radius) return true;
    const PlacedGrid placed = {&gridA, Placement::of(X_HL_[a].inverse() * X_HL_[b])};
    return kernels::nearBlocks(placed, fields_->covers[b], 0, blockIds_.data()) == 0;
  }

  Isometry3d fromShell() const { return Isometry3d(Eigen::Translation3d(shell_->center)); }

  // ---- backing off

  void backOff(const GraspCandidate& candidate, GraspTrial& trial) {
    const Isometry3d X_OG = palmPose(candidate.targetPoint, candidate.approach, candidate.roll);
    X_GS_ = X_OG.inverse() * fromShell();
    const double standoff = hand_.preshapes[candidate.preshape].standoff;
    double t = exit(settings_.startBackoff, kind_ == PolicyKind::centerOfMass);
    if (standoff > 0) t = exit(t + standoff, false);
    trial.backoff = t;
    trial.X_OH =
        palmPose(candidate.targetPoint - t * candidate.approach, candidate.approach, candidate.roll) * preshape_->X_GH;
    if (isContained(trial.X_OH)) throw Unsettled{};  // surfaces say nothing about what lies wholly inside
  }

  /// The hand being free of the object's surface: is a part of it inside the object, or the object inside a link?
  bool isContained(const Isometry3d& X_OH) const {
    for (const Vector3d& p_H : preshape_->partPoints) {
      const Vector3d p = X_OH * p_H;
      if (objectBox_.contains(p) && objectScene_->contains(p)) return true;
    }
    const Isometry3d X_HO = X_OH.inverse();
    return std::any_of(fields_->links.begin(), fields_->links.end(), [&](int link) {
      const LinkGrid& grid = *fields_->grids[link];
      const Isometry3d X_LO = X_HL_[link].inverse() * X_HO;
      return shell_->radius < grid.radius && (X_LO * shell_->center - grid.center).norm() < grid.radius &&
             std::any_of(object_.mesh.vertices.begin(), object_.mesh.vertices.end(),
                         [&](const Vector3d& p) { return grid.upperBound(X_LO * p) < 0; });
    });
  }

  /// The smallest free t >= start, or with `last` the smallest from which on all are free.
  double exit(double start, bool last) {
    const double guess = shellExit(start, last);
    if (!last && guess > start + kHiddenWindow) {
      const double free = earlierExit(start, guess);
      if (free < guess) return free;
    }
    return exactExit(guess, start);
  }

  /// Between `start` and the guess, where dilated fields see no window, there may still be one: goes up through what
  /// the hand covers for sure, and looks at the triangles wherever that ends before the guess does. `guess`: no window.
  double earlierExit(double start, double guess) {
    const std::size_t room = laneX_.size();
    for (int k = 0; k < 2; ++k) {
      innerLow_[k].resize(room);
      innerHigh_[k].resize(room);
    }
    float* const low[2] = {innerLow_[0].data(), innerLow_[1].data()};
    float* const high[2] = {innerHigh_[0].data(), innerHigh_[1].data()};
    kernels::columnIntervals(preshape_->inner, lanes_, laneNode_.data(), laneZ_.data(), low, high);
    double t = start;
    for (int round = 0; round < kMostPlaces; ++round) {
      t = kernels::climb(static_cast<float>(t), lanes_, low, high);
      if (t > guess - kHiddenWindow) return guess;
      if (const float depth = deepestPoint(static_cast<float>(t)); depth > kWorthAStep) {
        t += depth;  // it stays inside for as long
        continue;
      }
      const double above = exactChain(t, leastWindow());
      if (above == t) return t > start ? t + kClearance : t;
      t = above;
    }
    throw Unsettled{};
  }

  /// How deep any of the shell's points lies inside the hand at t, at least; <= 0: none for sure.
  float deepestPoint(float t) {
    float depth = 0;
    const auto flush = [&](int link) {
      Group& group = exitGroups_[link];
      if (group.count == 0) return;
      group.pad();
      const PlacedGrid placed = {fields_->grids[link].get(), preshape_->fromPalm[link]};
      alignas(64) float distance[kGroup];
      kernels::distances({&placed, 1}, group.points, distance);
      for (const float d : distance) depth = std::max(depth, -d - kCaution);
    };
    for (int k = 0; k < 2; ++k) {
      for (std::size_t i = 0; i < lanes_; ++i) {
        if (low_[k][i] > t || high_[k][i] <= t) continue;
        const int link = preshape_->fine.link[k][laneNode_[i]];
        if (exitGroups_[link].push(laneX_[i], laneY_[i], laneZ_[i] + t, 0)) flush(link);
      }
    }
    for (const int link : fields_->links) flush(link);
    return depth;
  }

  /// The end of the run of triangle pairs that t lies in, as far as pairs within `window` tell; t itself when it is
  /// free.
  double exactChain(double t, double window) {
    gatherExitIntervals(t, window);
    double tau = 0;
    for (double before = -1; before != tau;) {
      before = tau;
      for (const auto& [enter, leave] : intervals_) {
        if (enter <= tau + 1e-8 && leave > tau + 1e-8) tau = leave;
      }
    }
    return t + tau;
  }

  void reserveLanes(std::size_t room) {
    if (laneX_.size() >= room) return;
    for (auto* array : {&laneX_, &laneY_, &laneZ_, &low_[0], &low_[1], &high_[0], &high_[1]}) array->resize(room);
    for (auto* array : {&dueX_, &dueY_, &dueZ_}) array->resize(room);
    for (auto* array : {&laneNode_, &laneFirst_, &dueFirst_, &endingLanes_}) array->resize(room);
  }

  /// The same for the shell's points.
  double shellExit(double start, bool last) {
    const Placement placement = Placement::of(X_GS_);
    const std::size_t blocks = kernels::selectColumns(preshape_->coarse, shell_->pointTree, placement,
                                                      static_cast<float>(start), blockIds_.data());
    reserveLanes(kGroup * (blocks + 1));
    const std::size_t count =
        kernels::columnPoints(preshape_->fine, *shell_, {blockIds_.data(), blocks}, placement,
                              static_cast<float>(start), laneX_.data(), laneY_.data(), laneZ_.data(), laneNode_.data());
    float* const low[2] = {low_[0].data(), low_[1].data()};
    float* const high[2] = {high_[0].data(), high_[1].data()};
    kernels::columnIntervals(preshape_->fine, count, laneNode_.data(), laneZ_.data(), low, high);
    lanes_ = count;
    const auto first = static_cast<float>(start);
    float top = first;
    if (last) {
      for (std::size_t i = 0; i < count; ++i) top = std::max(top, high_[0][i]);
    } else {
      top = kernels::climb(first, count, low, high);
    }
    while (top > first) {
      const float floor = std::max(first, top - 6e-3F);
      const float best = highestRoot(count, floor, top);
      if (best > floor) return best;
      top = floor;
    }
    return start;
  }

  /// The largest t in (floor, top] at which a point leaves the hand; `floor` when there is none.
  float highestRoot(std::size_t count, float floor, float top) {
    constexpr float kBand = 1.5e-3F;  // m
    constexpr int kBands = 4;         // that (floor, top] spans
    for (auto& band : exitBands_) band.clear();
    for (int k = 0; k < 2; ++k) {
      const std::size_t ending =
          kernels::lanesEndingIn(floor, top, count, low_[k].data(), high_[k].data(), endingLanes_.data());
      for (std::size_t j = 0; j < ending; ++j) {
        const std::uint32_t i = endingLanes_[j];
        const float high = std::min(high_[k][i], top);
        const int band = std::min(static_cast<int>((top - high) / kBand), kBands - 1);
        exitBands_[band].push_back({i, preshape_->fine.link[k][laneNode_[i]], high});
      }
    }
    float best = floor;
    for (int band = 0; band < kBands && top - static_cast<float>(band) * kBand > best; ++band) {
      for (const ExitLane& lane : exitBands_[band]) {
        if (lane.high <= best) continue;
        const std::uint32_t i = lane.index;
        if (exitGroups_[lane.link].push(laneX_[i], laneY_[i], laneZ_[i], lane.high))
          flushExit(static_cast<int>(lane.link), best);
      }
      for (const int link : fields_->links) flushExit(link, best);
    }
    return best;
  }

  void flushExit(int link, float& best) {
    Group& group = exitGroups_[link];
    if (group.count == 0) return;
    group.pad();
    alignas(64) float left[kGroup];
    kernels::refineExit({fields_->grids[link].get(), preshape_->fromPalm[link]}, group.points, group.start, best, left);
    for (const float t : left) best = std::max(best, t);
  }

  /// From the shell's t to the one of the triangles: pairs near the hand give exact intervals of t.
  double exactExit(double guess, double start) {
    constexpr double kBelow = 2e-5;  // m
    double t = std::max(start, guess - kBelow);
    double window = leastWindow();
    double descend = 3e-5;  // m
    bool ascending = t == start;
    for (int round = 0; round < kMostRounds; ++round) {
      const double tau = exactChain(t, window) - t;
      if (!(tau > 0)) {
        if (ascending) return t > start ? t + kClearance : t;
        t = std::max(start, t - descend);
        window = std::clamp(descend, leastWindow(), kMostWindow);
        descend *= 2;
        ascending = t == start;
        continue;
      }
      if (tau <= window) return t + tau + kClearance;
      t += tau;
      window = std::min(4 * window, kMostWindow);
      ascending = true;
    }
    throw Unsettled{};
  }

  void gatherExitIntervals(double t, double window) {
    intervals_.clear();
    for (const int link : fields_->links) {
      const Isometry3d& X_LG = preshape_->X_LG[link];
      const Isometry3d X_LS = X_LG * Eigen::Translation3d(0, 0, t) * X_GS_;
      Search& search = searches_[link];
      gather(link, X_LS, window, false, search);
      const kernels::Pairs& pairs = search.pairs;
      if (pairs.count == 0) continue;
      setVelocity(X_LG.linear().col(2).cast<float>(), search.near);
      kernels::touchIntervals(*fields_->grids[link], search.near, search.pairs.count, search.pairs);
      for (std::size_t i = 0; i < pairs.count; ++i) {
        if (pairs.enter[i] <= pairs.leave[i] && pairs.leave[i] > 0 && pairs.enter[i] <= 1.1 * window) {
          intervals_.emplace_back(pairs.enter[i], pairs.leave[i]);
        }
      }
    }
  }

  // ---- exact triangles

  /// A link's triangles against those of the object that are near.
  struct Search {
    NearTriangles near;
    kernels::Pairs pairs;
    Isometry3d X_LS = Isometry3d::Identity();
    double margin = -1;    // m, of the pairs; < 0: none of this trial
    std::size_t due = 0;   // the pairs in front that may be the first to touch
    bool isKnown = false;  // what it was for is known
  };

  /// The last touch of a motion. The next preshape often closes a finger from the same place (its spread does not move
  /// it), which then need not be searched again, nor its links' contacts: those depend on the touches alone.
  struct Known {
    std::uint64_t trial = 0;  // in which it was found, as the contacts of all its links must have been
    Isometry3d X_OH = Isometry3d::Identity(), X_HB = Isometry3d::Identity();  // B: the motion's base link
    double from = 0;
    Touch touch;
    std::vector<int> touchedLinks;
  };
  struct KnownContacts {
    std::uint64_t trial = 0;
    std::vector<Contact> contacts;
  };

  /// The pairs of a link at X_LS within `margin`; with `facing` only those that face each other.
  void gather(int link, const Isometry3d& X_LS, double margin, bool facing, Search& search) {
    const LinkGrid& grid = *fields_->grids[link];
    search.X_LS = X_LS;
    search.margin = margin;
    search.isKnown = false;
    search.near.id.clear();
    search.pairs.count = 0;
    if ((X_LS.translation() - grid.center).norm() > grid.radius + shell_->radius + margin) return;
    const PlacedGrid placed = {&grid, Placement::of(X_LS)};
    const auto reach = static_cast<float>(margin);
    const std::size_t blocks = kernels::nearBoxes(placed, *shell_, reach, blockIds_.data());
    if (blocks == 0) return;
    const std::size_t count =
        kernels::nearTriangles(placed, *shell_, {blockIds_.data(), blocks}, reach, scratchIds_.data(), nearIds_.data());
    if (count == 0) return;
    search.near.id.assign(nearIds_.begin(), nearIds_.begin() + static_cast<std::ptrdiff_t>(count));
    kernels::placeTriangles(*shell_, placed.placement, search.near);
    kernels::findPairs(grid, search.near, reach, facing, search.pairs);
  }

  /// Does the last search of a link hold every pair within `margin` of it at X_LS?
  bool covers(int link, const Isometry3d& X_LS, double margin) const {
    const Search& search = searches_[link];
    if (search.margin < margin) return false;
    // How far any point that is near the link now has come since: its way with the link's centre and around it.
    const LinkGrid& grid = *fields_->grids[link];
    const Isometry3d back = search.X_LS * X_LS.inverse();
    const Eigen::Matrix3d turn = back.linear() - Eigen::Matrix3d::Identity();
    const double way = (turn * grid.center + back.translation()).norm();
    return way + turn.norm() / std::sqrt(2) * (grid.radius + margin) <= search.margin - margin;
  }

  double leastWindow() const { return settings_.contactDistance + kBeyondContacts; }

  bool bothClosed(int link) const { return fields_->grids[link]->closed && shell_->closed; }

  // ---- closing

  /// Do the surfaces of the object and of a link, in the present posture, intersect?
  bool linkTouches(int link, const Isometry3d& X_OH) {
    Search& search = searches_[link];
    gather(link, (X_OH * X_HL_[link]).inverse() * fromShell(), 1e-6, false, search);
    setVelocity({0.6F, 0.57F, 0.56F}, search.near);  // any way through will do
    kernels::touchIntervals(*fields_->grids[link], search.near, search.pairs.count, search.pairs);
    for (std::size_t i = 0; i < search.pairs.count; ++i) {
      if (search.pairs.enter[i] <= 0 && search.pairs.leave[i] >= 0) return true;
    }
    return false;
  }

  /// The first s >= from at which the motion touches, or its range; searched only when it is not known.
  Touch touchOf(const Motion& motion, double from, const GraspTrial& trial) {
    if (from < -1e-9) throw Unsettled{};
    for (const auto& [joint, position] : motion.heldJoints) {
      if (std::abs(trial.jointPosition[joint] - position) > 1e-12) throw Unsettled{};
    }
    Known& known = known_[&motion - fields_->motions.data()];
    const Isometry3d& X_HB = X_HL_[motion.baseLink];
    const bool isKnown = known.trial > 0 && known.from == from && known.X_OH.matrix() == trial.X_OH.matrix() &&
                         known.X_HB.matrix() == X_HB.matrix() &&
                         std::all_of(motion.leaves.begin(), motion.leaves.end(), [&](const MotionLeaf& leaf) {
                           return knownContacts_[leaf.link].trial == known.trial;
                         });
    if (!isKnown) {
      X_BS_ = trial.X_OH.inverse() * fromShell();
      if (motion.mover) X_BS_ = motion.X_BP * X_HB.inverse() * X_BS_;
      known.trial = 0;  // until the search ends
      known.touch = searchTouch(motion, from);
      known.trial = trial_;
      known.X_OH = trial.X_OH;
      known.X_HB = X_HB;
      known.from = from;
      known.touchedLinks = touchedLinks_;
      return known.touch;
    }
    touchedLinks_ = known.touchedLinks;
    for (const MotionLeaf& leaf : motion.leaves) searches_[leaf.link].isKnown = true;
    return known.touch;
  }

  Touch searchTouch(const Motion& motion, double from) {
    muted_.clear();
    for (int round = 0; round < kMostPlaces; ++round) {
      if (from >= motion.range) return {motion.range, false};
      const double guess = shellTouch(motion, from);
      // At the limit a shallow touch between the points may still show.
      if (!(guess < motion.range)) return exactTouch(motion, motion.range, from);
      const Touch touch = exactTouch(motion, guess, from);
      if (touch.touched) return touch;
      from = touch.s;  // nothing up to here
      muteSlidingFaces(motion);
    }
    throw Unsettled{};
  }

  /// Where hand and object slide along each other, microns apart, the search would stop at every point that comes by.
  /// Points on the plane of such a slide say nothing more: the triangles will.
  void muteSlidingFaces(const Motion& motion) {
    for (std::size_t k = 0; k < motion.leaves.size(); ++k) {
      const Search& search = searches_[motion.leaves[k].link];
      const LinkGrid& grid = *fields_->grids[motion.leaves[k].link];
      const Eigen::Isometry3f X_BL(X_LB_[k].inverse().cast<float>());
      for (std::size_t i = 0; i < search.pairs.count; ++i) {
        const std::uint32_t a = search.pairs.a[i], b = search.pairs.b[i];
        const float* const ofObject = search.near.record[a].value.data();
        const float* const ofLink = grid.triangle[b].value.data();
        const Eigen::Matrix3f object = Eigen::Map<const Eigen::Matrix3f>(ofObject);
        const Eigen::Matrix3f link = Eigen::Map<const Eigen::Matrix3f>(ofLink);
        const Eigen::Map<const Eigen::Vector3f> velocity(ofObject + 12);
        muteIfSliding(X_BL, Eigen::Map<const Eigen::Vector3f>(ofLink + 9), link.col(0), object, velocity);
        muteIfSliding(X_BL, Eigen::Map<const Eigen::Vector3f>(ofObject + 9), object.col(0), link, velocity);
      }
    }
  }

  /// Mutes the plane of one triangle when the motion runs along it and corners of the other triangle are on it.
  void muteIfSliding(const Eigen::Isometry3f& X_BL, const Eigen::Vector3f& normal, const Eigen::Vector3f& point,
                     const Eigen::Matrix3f& other, const Eigen::Vector3f& velocity) {
    constexpr float kFlush = 1e-5F;  // m
    if (std::abs(normal.dot(velocity)) > 1e-3F * velocity.norm()) return;
    if ((normal.transpose() * (other.colwise() - point)).cwiseAbs().minCoeff() > kFlush) return;
    const Eigen::Hyperplane<float, 3> plane(X_BL.linear() * normal, X_BL * point);
    const bool known =
        std::any_of(muted_.begin(), muted_.end(), [&](const auto& old) { return old.isApprox(plane, 1e-4F); });
    if (!known && muted_.size() < kMostMuted) muted_.push_back(plane);
  }

  bool isMuted(const Eigen::Vector3f& p) const {
    constexpr float kFlush = 2e-5F;  // m
    return std::any_of(muted_.begin(), muted_.end(), [&](const auto& plane) { return plane.absDistance(p) < kFlush; });
  }

  double shellTouch(const Motion& motion, double from) {
    const Placement placement = Placement::of(X_BS_);
    const double unit = motion.range / Motion::kLastUnit;
    const auto fromUnit = static_cast<std::uint32_t>(std::max(0.0, from / unit - 1));
    const std::size_t blocks = kernels::selectBlocks(motion.field->coarse, shell_->pointTree, placement, fromUnit,
                                                     Motion::kNever, blockIds_.data(), blockFirsts_.data());
    if (blocks == 0) return kInfinity;
    grids_.clear();
    posesOf_ = nullptr;
    for (const MotionLeaf& leaf : motion.leaves) grids_.push_back({fields_->grids[leaf.link].get(), {}});
    // Blocks in bands of rising first touch.
    constexpr int kBands = 64;
    constexpr int kShift = 10;
    std::array<std::uint32_t, kBands + 1> begin{};
    for (std::size_t i = 0; i < blocks; ++i) ++begin[(blockFirsts_[i] >> kShift) + 1];
    for (int b = 0; b < kBands; ++b) begin[b + 1] += begin[b];
    ordered_.resize(blocks);
    std::array<std::uint32_t, kBands> next{};
    std::copy_n(begin.begin(), kBands, next.begin());
    for (std::size_t i = 0; i < blocks; ++i) ordered_[next[blockFirsts_[i] >> kShift]++] = blockIds_[i];

    float best = static_cast<float>(motion.range);
    std::uint32_t bestUnit = Motion::kNever, earliest = Motion::kNever;
    bool found = false;
    reserveLanes(kGroup * (blocks + 2));
    kernels::WaitingPoints waiting = {laneX_.data(), laneY_.data(), laneZ_.data(), laneFirst_.data(), 0};
    Group group;
    int groupBand = 0;  // of its first point
    const auto flush = [&] {
      if (group.count == 0) return;
      group.pad();
      // Close to the best the link cannot have passed through a point yet: then it lies inside at the best.
      const bool close = best < static_cast<float>(unit) * static_cast<float>((groupBand + 2) << kShift);
      if (found && close && !anyInside(motion, group.points, best)) return;
      const float s = kernels::refineMotion(motion, grids_, group.points, group.start, static_cast<float>(from), best);
      if (s >= best) return;
      best = s;
      found = true;
      bestUnit = static_cast<std::uint32_t>(std::max(0.0F, best / static_cast<float>(unit))) + 1;
    };
    for (int band = 0; band < kBands && (static_cast<std::uint32_t>(band) << kShift) < bestUnit; ++band) {
      kernels::selectPoints(motion.field->fine, *shell_, {&ordered_[begin[band]], begin[band + 1] - begin[band]},
                            placement, fromUnit, bestUnit, waiting);
      const std::uint32_t end = static_cast<std::uint32_t>(band + 1) << kShift;
      if (begin[band] == begin[band + 1] && earliest >= end) continue;
      kernels::WaitingPoints due = {dueX_.data(), dueY_.data(), dueZ_.data(), dueFirst_.data(), 0};
      earliest = kernels::takeDue(end, bestUnit, waiting, due);
      for (std::size_t i = 0; i < due.count; ++i) {
        if (due.first[i] >= bestUnit) continue;
        if (!muted_.empty() && isMuted({due.x[i], due.y[i], due.z[i]})) continue;
        const float start = std::max(static_cast<float>(from), static_cast<float>(due.first[i] * unit));
        if (group.count == 0) groupBand = band;
        if (group.push(due.x[i], due.y[i], due.z[i], start)) flush();
      }
    }
    flush();
    return found ? best : kInfinity;
  }

  /// Does any of the points lie in what the motion moves, at s?
  bool anyInside(const Motion& motion, const Points& points, float s) {
    if (posesAt_ != s || posesOf_ != &motion) {
      setLeafPoses(motion, s);
      for (std::size_t k = 0; k < motion.leaves.size(); ++k) grids_[k].placement = Placement::of(X_LB_[k]);
      posesAt_ = s;
      posesOf_ = &motion;
    }
    alignas(64) float distance[kGroup];
    kernels::distances(grids_, points, distance);
    return std::any_of(distance, distance + kGroup, [](float d) { return d < 0; });
  }

  /// Poses of the leaves at s (X_LB_) and how fast the object's points move in their frames, per s: turn p + shift.
  void setLeafPoses(const Motion& motion, double s) {
    X_NB_.resize(motion.nodes.size());
    twist_.resize(motion.nodes.size());
    for (std::size_t i = 0; i < motion.nodes.size(); ++i) {
      const MotionNode& node = motion.nodes[i];
      const Isometry3d X = node.parent < 0 ? node.X_NP : node.X_NP * X_NB_[node.parent];
      const double free = node.offset + node.rate * s;
      const double q = std::clamp(free, node.lower, node.upper);
      const double rate = q == free ? node.rate : 0;
      // A point that stands still in the parent moves by -rate times the joint's own motion.
      Isometry3d Z = Isometry3d::Identity();
      Twist own;
      if (node.turns) {
        const double c = std::cos(q), n = std::sin(q);
        Z.linear() << c, n, 0, -n, c, 0, 0, 0, 1;
        own.turn = -rate * Vector3d::UnitZ();
      } else {
        Z.translation().z() = -q;
        own.shift = -rate * Vector3d::UnitZ();
      }
      X_NB_[i] = Z * X;
      if (node.parent >= 0) {
        const Isometry3d X_NP = Z * node.X_NP;
        const Twist moved = twist_[node.parent].in(X_NP);
        own.turn += moved.turn;
        own.shift += moved.shift;
      }
      twist_[i] = own;
    }
    X_LB_.resize(motion.leaves.size());
    leafTwist_.resize(motion.leaves.size());
    for (std::size_t k = 0; k < motion.leaves.size(); ++k) {
      const MotionLeaf& leaf = motion.leaves[k];
      X_LB_[k] = leaf.X_LN * X_NB_[leaf.node];
      leafTwist_[k] = twist_[leaf.node].in(leaf.X_LN);
    }
  }

  /// From the shell's s to the triangles' one. Not touched: nothing touches up to s.
  Touch exactTouch(const Motion& motion, double guess, double from) {
    constexpr double kInfinite = std::numeric_limits<double>::infinity();
    constexpr double kAfterFirst = 5e-5;  // m, beyond the first pair's touch: others may yet come to be first
    posesOf_ = nullptr;
    double s = guess, window = leastWindow();
    double gatheredAt = s;
    bool fresh = true;
    for (int round = 0; round < kMostRounds; ++round) {
      if (fresh) gatheredAt = s;
      setLeafPoses(motion, s);
      double first = kInfinite, speed = 1e-6;  // the fastest that a point near a leaf can move
      leafFirst_.assign(motion.leaves.size(), kInfinite);
      for (std::size_t k = 0; k < motion.leaves.size(); ++k) {
        const int link = motion.leaves[k].link;
        Search& search = searches_[link];
        const LinkGrid& grid = *fields_->grids[link];
        const Twist& twist = leafTwist_[k];
        speed = std::max(
            speed, (twist.turn.cross(grid.center) + twist.shift).norm() + twist.turn.norm() * (grid.radius + window));
        const Isometry3d X_LS = X_LB_[k] * X_BS_;
        if (fresh) {
          gather(link, X_LS, window, bothClosed(link), search);
          search.due = search.pairs.count;
        } else if (search.due > 0) {
          kernels::placeTriangles(*shell_, Placement::of(X_LS), search.near);
        }
        if (search.due == 0) continue;
        setVelocities(twist, search.near);
        kernels::touchIntervals(grid, search.near, search.due, search.pairs);
        for (std::size_t i = 0; i < search.due; ++i) {
          const float enter = search.pairs.enter[i], leave = search.pairs.leave[i];
          // Past: what was left behind on backing off. Faces that meet flush meet for a moment only.
          const bool ahead =
              leave * speed > 0.5 * kClearance || (leave * speed > -kConverged && isApproaching(grid, search, i));
          if (enter <= leave && ahead) leafFirst_[k] = std::min(leafFirst_[k], static_cast<double>(enter));
        }
        first = std::min(first, leafFirst_[k]);
      }
      if (!(first * speed < window)) {
        const double deepest = fresh ? penetration(motion, speed) : 0;
        if (deepest < 0 && s > from) {
          s = std::max(s + deepest, from);
          continue;
        }
        if (s >= motion.range) return {motion.range, false};
        if (window >= kMostWindow) return {std::max(s, from) + 0.9 * window / speed, false};
        window = std::min(4 * window, kMostWindow);
        fresh = true;
        continue;
      }
      // What was gathered says nothing beyond its window.
      const double end = gatheredAt + 0.9 * window / speed;
      const double next = std::max(std::min(s + first, end), from);
      const bool settled = std::abs(next - s) * speed < kConverged;
      fresh = (gatheredAt - next) * speed > 0.75 * window || next == end;
      s = next;
      if (!settled) {
        // Only what touches about first can still be first.
        const auto latest = static_cast<float>(first + 0.25 * std::abs(first) + kAfterFirst / speed);
        for (const MotionLeaf& leaf : motion.leaves) keepDue(latest, searches_[leaf.link]);
        continue;
      }
      const double deepest = penetration(motion, speed);
      if (deepest < 0 && s > from) {
        s = std::max(s + deepest, from);
        fresh = true;
        continue;
      }
      if (s >= motion.range) return {motion.range, false};
      touchedLinks_.clear();
      for (std::size_t k = 0; k < motion.leaves.size(); ++k) {
        if (leafFirst_[k] <= first + (motion.turns ? kSameAngle : kSameDistance))
          touchedLinks_.push_back(motion.leaves[k].link);
      }
      return {std::max(s - kClearance / speed, from), true};
    }
    throw Unsettled{};
  }

  /// Where surfaces cross more than a stop allows, the time (< 0, from the present pose of searches_) when the first of
  /// the crossing pairs met; 0: nowhere. Asks all pairs: those that cross need not face each other.
  double penetration(const Motion& motion, double speed) {
    constexpr double kTouching = 2 * kClearance;
    double first = 0;
    for (const MotionLeaf& leaf : motion.leaves) {
      const Search& search = searches_[leaf.link];
      if (search.near.id.empty()) continue;
      const LinkGrid& grid = *fields_->grids[leaf.link];
      kernels::findPairs(grid, search.near, static_cast<float>(kClearance), false, crossing_);
      kernels::touchIntervals(grid, search.near, crossing_.count, crossing_);
      for (std::size_t i = 0; i < crossing_.count; ++i) {
        const double enter = crossing_.enter[i], leave = crossing_.leave[i];
        if (enter * speed < -kTouching && leave * speed > kTouching) first = std::min(first, enter);
      }
    }
    return first;
  }

  /// Brings the pairs that meet by `latest` to the front.
  static void keepDue(float latest, Search& search) {
    kernels::Pairs& pairs = search.pairs;
    std::size_t due = 0;
    for (std::size_t i = 0; i < search.due; ++i) {
      if (!(pairs.enter[i] <= std::min(latest, pairs.leave[i]))) continue;
      std::swap(pairs.a[i], pairs.a[due]);
      std::swap(pairs.b[i], pairs.b[due]);
      std::swap(pairs.enter[i], pairs.enter[due]);
      std::swap(pairs.leave[i], pairs.leave[due++]);
    }
    search.due = due;
  }

  /// Does the small triangle of a pair move towards the link's?
  static bool isApproaching(const LinkGrid& grid, const Search& search, std::size_t pair) {
    const std::uint32_t a = search.pairs.a[pair], b = search.pairs.b[pair];
    double along = 0;
    for (int k = 0; k < 3; ++k) along += search.near.record[a].value[12 + k] * grid.triangle[b].value[9 + k];
    return along < 0;
  }

  static void setVelocity(const Eigen::Vector3f& v, NearTriangles& near) {
    for (Record& record : near.record) std::copy_n(v.data(), 3, &record.value[12]);
  }

  /// The velocities of the triangles' middles.
  static void setVelocities(const Twist& twist, NearTriangles& near) {
    const Eigen::Vector3f turn = twist.turn.cast<float>(), shift = twist.shift.cast<float>();
    for (Record& record : near.record) {
      auto& p = record.value;
      Eigen::Vector3f middle;
      for (int k = 0; k < 3; ++k) middle[k] = (p[k] + p[3 + k] + p[6 + k]) / 3;
      const Eigen::Vector3f v = turn.cross(middle) + shift;
      for (int k = 0; k < 3; ++k) p[12 + k] = v[k];
    }
  }

  // ---- contacts

  void gatherContacts(GraspTrial& trial) {
    const Isometry3d X_HS = trial.X_OH.inverse() * fromShell();
    const double margin = settings_.contactDistance + 2e-6;
    for (const int link : fields_->links) {
      Search& search = searches_[link];
      auto& [knownSince, contacts] = knownContacts_[link];
      if (search.isKnown) {
        trial.contacts.insert(trial.contacts.end(), contacts.begin(), contacts.end());
        continue;
      }
      knownSince = trial_;
      contacts.clear();
      if (!hand_.links[link].contactAllowed) continue;
      const Isometry3d X_LS = X_HL_[link].inverse() * X_HS;
      if (!covers(link, X_LS, margin)) gather(link, X_LS, margin, shell_->closed, search);
      if (search.pairs.count == 0) continue;
      const LinkGrid& grid = *fields_->grids[link];
      listWholePairs(search);
      kernels::keepClose(grid, *shell_, Placement::of(X_LS), static_cast<float>(settings_.contactDistance),
                         wholePairs_);
      candidates_.clear();
      const Isometry3d X_OL = trial.X_OH * X_HL_[link];
      for (std::size_t i = 0; i < wholePairs_.count; ++i) {
        const std::uint32_t ofObject = wholePairs_.object[i], ofLink = grid.source[wholePairs_.link[i]];
        ContactTriangle triangle{hand_.links[link].mesh.corners(ofLink), X_OL.linear() * grid.normal[ofLink]};
        for (Vector3d& p : triangle.corners) p = X_OL * p;
        addContactCandidates({object_.mesh.corners(ofObject), shell_->sourceNormal[ofObject]}, triangle,
                             wholePairs_.close[i], settings_.contactDistance, !object_.watertight, candidates_);
      }
      selectContacts(candidates_, settings_.contactsPerLink, settings_.contactSpacing, static_cast<std::uint16_t>(link),
                     contactScratch_, contacts);
      trial.contacts.insert(trial.contacts.end(), contacts.begin(), contacts.end());
    }
  }

  /// The triangles of the object's mesh that a search's small ones are part of, each pair once (a hash table finds
  /// those that are there).
  void listWholePairs(const Search& search) {
    const std::size_t most = search.pairs.count;
    const int bits = static_cast<int>(std::bit_width(2 * most));
    pairSlots_.assign(std::size_t{1} << bits, 0);
    auto& [object, link, close, count] = wholePairs_;
    for (auto* array : {&object, &link, &close}) {
      if (array->size() < most + kGroup) array->resize(2 * most + kGroup);
    }
    count = 0;
    for (std::size_t i = 0; i < most; ++i) {
      const std::uint32_t a = shell_->source[search.near.id[search.pairs.a[i]]], b = search.pairs.b[i];
      const std::uint64_t key = static_cast<std::uint64_t>(a) << 32 | b;
      std::size_t slot = key * 0x9e3779b97f4a7c15 >> (64 - bits);
      while (pairSlots_[slot] != 0 && (object[pairSlots_[slot] - 1] != a || link[pairSlots_[slot] - 1] != b)) {
        slot = (slot + 1) & (pairSlots_.size() - 1);
      }
      if (pairSlots_[slot] != 0) continue;
      object[count] = a;
      link[count] = b;
      pairSlots_[slot] = static_cast<std::uint32_t>(++count);
    }
  }

  struct ExitLane {
    std::uint32_t index, link;
    float high;
  };

  std::shared_ptr<const HandFields> fields_;
  const Hand& hand_;
  const ObjectModel& object_;
  PolicyKind kind_;
  ReferenceSettings settings_;
  std::shared_ptr<const ObjectShell> shell_;
  std::shared_ptr<const RayScene> objectScene_;
  Eigen::AlignedBox3d objectBox_;
  std::unique_ptr<GraspPolicy> reference_;

  // of the present trial
  const PreshapeFields* preshape_ = nullptr;
  std::vector<Isometry3d> X_HL_;
  Isometry3d X_GS_, X_BS_;  // S: the shell's frame, O moved to its centre

  // scratch
  std::vector<std::uint32_t> blockIds_, blockFirsts_, ordered_, nearIds_, scratchIds_;
  std::vector<float> laneX_, laneY_, laneZ_, low_[2], high_[2], innerLow_[2], innerHigh_[2];
  std::size_t lanes_ = 0;
  std::vector<float> dueX_, dueY_, dueZ_;
  std::vector<std::uint32_t> laneNode_, laneFirst_, dueFirst_, endingLanes_;
  std::vector<Group> exitGroups_ = std::vector<Group>(hand_.links.size());
  std::array<std::vector<ExitLane>, 4> exitBands_;
  std::vector<std::pair<double, double>> intervals_;
  kernels::Pairs crossing_;
  std::vector<Search> searches_ = std::vector<Search>(hand_.links.size());  // by link
  std::vector<Known> known_ = std::vector<Known>(fields_->motions.size());
  std::vector<KnownContacts> knownContacts_ = std::vector<KnownContacts>(hand_.links.size());
  std::uint64_t trial_ = 0;  // counts
  std::vector<PlacedGrid> grids_;
  std::vector<Isometry3d> X_NB_, X_LB_;
  std::vector<Twist> twist_, leafTwist_;
  std::vector<Eigen::Hyperplane<float, 3>> muted_;
  std::vector<double> leafFirst_;
  std::vector<int> touchedLinks_;
  float posesAt_ = 0;
  const Motion* posesOf_ = nullptr;
  kernels::WholePairs wholePairs_;
  std::vector<std::uint32_t> pairSlots_;  // hash table of the whole pairs: index plus one, 0 is free
  std::vector<ContactCandidate> candidates_;
  ContactScratch contactScratch_;
};

}  // namespace

std::shared_ptr<const HandFields> makeHandFields(const Hand& hand, const std::atomic<bool>* cancel,
                                                 const JobSystem& jobs) {
  return std::make_shared<const HandFields>(hand, jobs, cancel);
}

std::unique_ptr<GraspPolicy> makeFastPolicy(std::shared_ptr<const HandFields> fields, const Hand& hand,
                                            const ObjectModel& object, PolicyKind kind,
                                            const ReferenceSettings& settings) {
  return centerCoupledJaws(hand, std::make_unique<FastPolicy>(std::move(fields), hand, object, kind, settings));
}

}  // namespace handhold
