#include "robot/closed_form_ik.h"

#include "robot/newton.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kMeet = 1e-4;      // m: axes that pass each other this closely meet; what is missing is polished away
constexpr double kParallel = 1e-4;  // sine of the angle between parallel axes
constexpr double kSkew = 1e-3;      // sine or distance [m] below which a subproblem would have no definite answer
constexpr double kFree = 1e-7;      // lever [m or 1] under which a joint moves nothing
constexpr double kNearlyFree = 1e-3;  // lever under which it may, where nothing else answers
constexpr double kReach = 1e-3;       // [m, m^2 or 1] that a subproblem may miss by: the tolerances decide afterwards
constexpr double kExact = 1e-9;       // [m or 1] of `gap`, residuals [m, rad] and limits [rad]: rounding
constexpr double kNearLimit = 1e-3;   // rad: what polishing may bring back within the limits where the axes are inexact

/// A rotation about a known axis, by its cosine and sine.
struct Turn {
  double c = 1, s = 0;
};

[[gnu::always_inline]] inline Vector3d turned(const Vector3d& h, const Turn& t, const Vector3d& v) {
  return v * t.c + h.cross(v) * t.s + h * (h.dot(v) * (1 - t.c));
}

inline Vector3d turnedBack(const Vector3d& h, const Turn& t, const Vector3d& v) { return turned(h, {t.c, -t.s}, v); }

/// Up to two rotations that solve a subproblem.
struct Turns {
  std::array<Turn, 2> turn;
  int count = 0;
  void add(const Turn& t) { turn[count++] = t; }
  const Turn* begin() const { return turn.data(); }
  const Turn* end() const { return turn.data() + count; }
};

/// Where a joint moves nothing, it takes the angle of the present posture.
struct FreeJoints {
  const double* near;  // (6) in the order of the axes
  double lever;        // kFree or kNearlyFree
  bool met = false;    // a joint had less than kNearlyFree

  /// @param square  of the lever, or of the product of two
  bool isFree(double square) {
    met = met || square < kNearlyFree * kNearlyFree;
    return square < lever * lever;
  }
  Turn at(int axis) const { return {std::cos(near[axis]), std::sin(near[axis])}; }
};

/// Equation (3): h turns x towards d, by least squares.
inline Turn turnOnto(const Vector3d& h, const Vector3d& x, const Vector3d& d, int axis, FreeJoints& free) {
  const double sine = h.dot(x.cross(d)), cosine = x.dot(d) - h.dot(x) * h.dot(d);
  const double size = std::sqrt(sine * sine + cosine * cosine);
  if (free.isFree(size)) return free.at(axis);
  const double scale = 1 / size;
  return {cosine * scale, sine * scale};
}

/// Equation (4): k . Rot(h) x = b; the nearest where nothing reaches b.
Turns turnToHeight(const Vector3d& h, const Vector3d& k, const Vector3d& x, double b, int axis, FreeJoints& free) {
  const double along = k.dot(h) * h.dot(x);
  const double A = k.dot(x) - along, B = k.dot(h.cross(x)), C = b - along;
  const double square = A * A + B * B;
  Turns turns;
  if (free.isFree(square)) {
    if (std::abs(C) < kReach) turns.add(free.at(axis));
    return turns;
  }
  const double rest = square - C * C;
  if (rest <= 0) {
    const double radius = std::sqrt(square);
    if (std::abs(C) > radius + kReach) return turns;
    const double sign = C < 0 ? -1 : 1;
    turns.add({sign * A / radius, sign * B / radius});
    return turns;
  }
  const double root = std::sqrt(rest), scale = 1 / square;
  turns.add({(A * C - B * root) * scale, (B * C + A * root) * scale});
  turns.add({(A * C + B * root) * scale, (B * C - A * root) * scale});
  return turns;
}

/// Equation (5): |Rot(h) x - y|^2 = square.
Turns turnToDistance(const Vector3d& h, const Vector3d& x, const Vector3d& y, double square, int axis,
                     FreeJoints& free) {
  return turnToHeight(h, y, x, (x.squaredNorm() + y.squaredNorm() - square) / 2, axis, free);
}

/// How the first three axes bring a point to another (README.md, equations (6a) to (6d)).
enum class Shape { parallel23, parallel12, meet12, meet23 };

/// Six axes at q = 0, the last three of which meet in `center`.
struct SixAxes {
  std::array<Vector3d, 6> h, p;
  Vector3d center;
  Shape shape = Shape::parallel23;
  Vector3d perpendicular;  // to h[5], unit
  double gap = 0;          // by how much the axes fail to meet [m] or to be parallel [sine]

  double lineDistance(int axis, const Vector3d& point) const { return h[axis].cross(point - p[axis]).norm(); }
  double sine(int i, int j) const { return h[i].cross(h[j]).norm(); }

  /// The middle of the shortest segment between two axes that are not parallel, and its length.
  std::pair<Vector3d, double> crossing(int i, int j) const {
    const Vector3d n = h[i].cross(h[j]), between = p[j] - p[i];
    const double square = n.squaredNorm();
    const Vector3d a = p[i] + h[i] * (between.cross(h[j]).dot(n) / square);
    const Vector3d b = p[j] + h[j] * (between.cross(h[i]).dot(n) / square);
    return {(a + b) / 2, (a - b).norm()};
  }

  /// Finds `center` and `shape`; false when there is no closed form for these axes in this order.
  bool recognise() {
    if (sine(3, 4) < kSkew || sine(4, 5) < kSkew) return false;
    if (!meetAt(3, 4)) return false;
    center = p[3];
    gap = std::max(gap, lineDistance(5, center));
    if (gap > kMeet) return false;
    perpendicular = h[5].unitOrthogonal();
    // Besides the shape, no point that an axis has to move may lie on it.
    const auto moves = [&](int axis, const Vector3d& point) { return lineDistance(axis, point) > kSkew; };
    if (sine(1, 2) < kParallel && sine(0, 1) > kSkew && moves(1, p[2]) && moves(2, center)) {
      shape = Shape::parallel23;
      gap = std::max(gap, sine(1, 2));
    } else if (sine(0, 1) < kParallel && sine(1, 2) > kSkew && moves(0, p[1]) && moves(2, center)) {
      shape = Shape::parallel12;
      gap = std::max(gap, sine(0, 1));
    } else if (sine(0, 1) > kSkew && meetAt(0, 1) && moves(2, p[0]) && moves(2, center)) {
      shape = Shape::meet12;
    } else if (sine(1, 2) > kSkew && meetAt(1, 2) && moves(0, p[1]) && moves(2, center)) {
      shape = Shape::meet23;
    } else {
      return false;
    }
    return true;
  }

  /// When two axes that are not parallel meet, the point becomes the origin of both.
  bool meetAt(int i, int j) {
    const auto [meeting, missed] = crossing(i, j);
    if (missed > kMeet) return false;
    p[i] = p[j] = meeting;
    gap = std::max(gap, missed);
    return true;
  }

  /// Where three turns bring `center`.
  Vector3d placed(const Turn& t1, const Turn& t2, const Turn& t3) const {
    const Vector3d f = p[2] + turned(h[2], t3, center - p[2]);
    const Vector3d e = p[1] + turned(h[1], t2, f - p[1]);
    return p[0] + turned(h[0], t1, e - p[0]);
  }

  /// Calls use(turn 1, turn 2, turn 3) for every way to bring `center` to d, at most four.
  template <typename Use>
  void placeCenter(const Vector3d& d, FreeJoints& free, const Use& use) const {
    const Vector3d& c = center;
    if (shape == Shape::parallel23) {
      for (const Turn& t1 : turnToHeight(h[0], d - p[0], h[1], h[1].dot(c - p[0]), 0, free)) {
        const Vector3d e = p[0] + turnedBack(h[0], t1, d - p[0]);
        for (const Turn& t3 : turnToDistance(h[2], c - p[2], p[1] - p[2], acrossSquare(1, e, c), 2, free)) {
          const Vector3d f = p[2] + turned(h[2], t3, c - p[2]);
          use(t1, turnOnto(h[1], f - p[1], e - p[1], 1, free), t3);
        }
      }
    } else if (shape == Shape::parallel12) {
      for (const Turn& t3 : turnToHeight(h[2], h[0], c - p[2], h[0].dot(d - p[2]), 2, free)) {
        const Vector3d f = p[2] + turned(h[2], t3, c - p[2]);
        for (const Turn& t2 : turnToDistance(h[1], f - p[1], p[0] - p[1], (d - p[0]).squaredNorm(), 1, free)) {
          const Vector3d e = p[1] + turned(h[1], t2, f - p[1]);
          use(turnOnto(h[0], e - p[0], d - p[0], 0, free), t2, t3);
        }
      }
    } else if (shape == Shape::meet12) {
      for (const Turn& t3 : turnToDistance(h[2], c - p[2], p[0] - p[2], (d - p[0]).squaredNorm(), 2, free)) {
        const Vector3d f = p[2] + turned(h[2], t3, c - p[2]) - p[0];
        for (const Turn& t2 : turnToHeight(h[1], h[0], f, h[0].dot(d - p[0]), 1, free)) {
          use(turnOnto(h[0], turned(h[1], t2, f), d - p[0], 0, free), t2, t3);
        }
      }
    } else {
      for (const Turn& t1 : turnToDistance(h[0], p[1] - p[0], d - p[0], (c - p[1]).squaredNorm(), 0, free)) {
        const Vector3d e = p[0] + turnedBack(h[0], t1, d - p[0]) - p[1];
        for (const Turn& t3 : turnToHeight(h[2], h[1], c - p[1], h[1].dot(e), 2, free)) {
          use(t1, turnOnto(h[1], turned(h[2], t3, c - p[1]), e, 1, free), t3);
        }
      }
    }
  }

  /// |e - p|^2 for turnToDistance about parallel axes: the part along the axis is that of c, which they cannot change.
  double acrossSquare(int axis, const Vector3d& e, const Vector3d& c) const {
    const double height = h[axis].dot(c - p[axis]);
    return h[axis].cross(e - p[axis]).squaredNorm() + height * height;
  }
};

/// The last six axes of a chain, in the order in which the last three meet.
std::optional<SixAxes> recogniseAxes(const ArmChain& chain, bool reversed) {
  SixAxes axes;
  Isometry3d X = Isometry3d::Identity();
  for (int i = 0; i < 6; ++i) {
    X = X * chain.steps[i].X;
    // Read from tip to base, every axis turns the other way.
    const int place = reversed ? 5 - i : i;
    axes.h[place] = (reversed ? -1.0 : 1.0) * (X.linear() * chain.steps[i].axis);
    axes.p[place] = X.translation();
  }
  if (!axes.recognise()) return std::nullopt;
  return axes;
}

/// The positions of a joint within its limits that stand for an angle; of very many, or without limits, the nearest.
struct Representatives {
  static constexpr int kMost = 4;
  std::array<double, kMost> q;
  int count = 0;

  Representatives() = default;
  Representatives(double angle, const ArmChain::Step& step, double near, double slack) {
    if (step.upper - step.lower > (kMost - 1) * kTwoPi) {
      q[0] = angle + kTwoPi * std::round((near - angle) / kTwoPi);
      if (q[0] > step.upper) q[0] -= kTwoPi;
      if (q[0] < step.lower) q[0] += kTwoPi;
      count = 1;
      return;
    }
    const double first = angle + kTwoPi * std::ceil((step.lower - slack - angle) / kTwoPi);
    for (double value = first; value <= step.upper + slack; value += kTwoPi) {
      q[count++] = std::clamp(value, step.lower, step.upper);
    }
  }

  double furthestInside(const ArmChain::Step& step) const {
    const auto room = [&](double value) { return std::min(value - step.lower, step.upper - value); };
    return *std::max_element(q.begin(), q.begin() + count, [&](double a, double b) { return room(a) < room(b); });
  }
};

class ClosedForm : public InverseKinematics {
 public:
  ClosedForm(const ArmChain& chain, const IkSettings& settings, const SixAxes& axes, bool reversed)
      : settings_(settings), axes_(axes), reversed_(reversed), limitSlack_(axes.gap < kExact ? kExact : kNearLimit) {
    leading_.steps.assign(chain.steps.begin(), chain.steps.end() - 6);
    six_.steps.assign(chain.steps.end() - 6, chain.steps.end());
    six_.X_tip = chain.X_tip;
    X_zero_ = tipPose(six_, Eigen::VectorXd::Zero(6));
    lever_ = six_.X_tip.translation().norm();
    for (const ArmChain::Step& step : six_.steps) lever_ += step.X.translation().norm();
  }

  bool isClosedForm() const override { return true; }

  void solve(const Isometry3d& X_AT, const Eigen::VectorXd& near,
             std::vector<Eigen::VectorXd>& solutions) const override {
    solutions.clear();
    if (leading_.size() == 0) {
      solveSix(X_AT, near, near, solutions);
    } else {
      solveWithLeading(X_AT, near, solutions);
    }
    sortNearestFirst(near, solutions);
  }

 private:
  struct Branch {
    std::array<Turn, 6> turn;                  // in the order of the axes
    std::array<Representatives, 6> positions;  // in the order of the joints
  };
  /// The question to the six axes, and what is found.
  struct Search {
    Isometry3d X_ST;             // wanted tip in the frame S that the six joints begin at
    Isometry3d G;                // wanted product of the six rotations
    std::array<double, 6> near;  // in the order of the axes
    Eigen::VectorXd nearJoints;  // (6)
    std::array<Branch, 8> branches;
    int count = 0;
  };

  int jointOf(int axis) const { return reversed_ ? 5 - axis : axis; }

  /// Joints in front of the six: those of `near`, then every point of the grid.
  void solveWithLeading(const Isometry3d& X_AT, const Eigen::VectorXd& near,
                        std::vector<Eigen::VectorXd>& solutions) const {
    const Eigen::Index n = leading_.size();
    Eigen::VectorXd q = near.head(n), full = near;
    for (Eigen::Index i = 0; i < n; ++i) q[i] = std::clamp(q[i], leading_.steps[i].lower, leading_.steps[i].upper);
    const Eigen::VectorXd first = q;
    const auto solveAt = [&] {
      full.head(n) = q;
      solveSix(tipPose(leading_, q).inverse() * X_AT, near.tail(6), full, solutions);
    };
    solveAt();
    std::vector<int> place(n, 0);
    for (bool more = true; more;) {
      for (Eigen::Index i = 0; i < n; ++i) q[i] = gridValue(leading_.steps[i], place[i]);
      if ((q - first).lpNorm<Eigen::Infinity>() > kDistinct) solveAt();
      more = false;
      for (Eigen::Index i = 0; i < n && !more; ++i) {
        place[i] = (place[i] + 1) % settings_.leadingSteps;
        more = place[i] != 0;
      }
    }
  }

  double gridValue(const ArmChain::Step& step, int place) const {
    const int steps = settings_.leadingSteps;
    if (!std::isfinite(step.upper - step.lower)) return std::numbers::pi * (2.0 * place / steps - 1);
    return steps == 1 ? (step.lower + step.upper) / 2 : step.lower + (step.upper - step.lower) * place / (steps - 1);
  }

  /// Adds every solution of the six joints behind full.head(n - 6).
  void solveSix(const Isometry3d& X_ST, const Eigen::VectorXd& near, const Eigen::VectorXd& full,
                std::vector<Eigen::VectorXd>& solutions) const {
    Search search;
    search.X_ST = X_ST;
    search.G = X_ST * X_zero_.inverse();
    if (reversed_) search.G = search.G.inverse();
    search.nearJoints = near;
    if (findBranches(near, kFree, search) && search.count == 0) findElsewhere(search);
    for (int i = 0; i < search.count; ++i) expand(search.branches[i], full, solutions);
  }

  /// A joint that moves next to nothing stands where others would have to leave their limits: other places for it.
  void findElsewhere(Search& search) const {
    constexpr int kPlaces = 9;
    findBranches(search.nearJoints, kNearlyFree, search);
    Eigen::VectorXd other(6);
    for (int place = 0; place < kPlaces && search.count == 0; ++place) {
      for (int i = 0; i < 6; ++i) {
        const ArmChain::Step& step = six_.steps[i];
        const double share = static_cast<double>(place) / (kPlaces - 1);
        other[i] = std::isfinite(step.upper - step.lower) ? step.lower + (step.upper - step.lower) * share
                                                          : std::numbers::pi * (2 * share - 1);
      }
      findBranches(other, kNearlyFree, search);
    }
  }

  /// All branches within limits and tolerances, distinct; joints with less than `lever` stand at `near`. True when a
  /// joint had next to none.
  bool findBranches(const Eigen::VectorXd& near, double lever, Search& search) const {
    for (int axis = 0; axis < 6; ++axis) search.near[axis] = near[jointOf(axis)];
    FreeJoints free{search.near.data(), lever};
    const auto& h = axes_.h;
    const Vector3d d = search.G * axes_.center;
    const Vector3d last = search.G.linear() * h[5], across = search.G.linear() * axes_.perpendicular;
    axes_.placeCenter(d, free, [&](const Turn& t1, const Turn& t2, const Turn& t3) {
      Branch branch;
      branch.turn = {t1, t2, t3};
      if (!placeJoints(0, 3, limitSlack_, search, branch)) return;
      const double missed = (axes_.placed(t1, t2, t3) - d).norm();
      const auto back = [&](const Vector3d& v) {
        return turnedBack(h[2], t3, turnedBack(h[1], t2, turnedBack(h[0], t1, v)));
      };
      const Vector3d w = back(last), v = back(across);
      for (const Turn& t5 : turnToHeight(h[4], h[3], h[5], h[3].dot(w), 4, free)) {
        const Vector3d x = turned(h[4], t5, h[5]);
        const Turn t4 = turnOnto(h[3], x, w, 3, free);
        const Vector3d u = turnedBack(h[4], t5, turnedBack(h[3], t4, v));
        const Turn t6 = turnOnto(h[5], axes_.perpendicular, u, 5, free);
        branch.turn[3] = t4;
        branch.turn[4] = t5;
        branch.turn[5] = t6;
        if (!placeJoints(3, 6, limitSlack_, search, branch)) continue;
        const double twist = (turned(h[3], t4, x) - w).norm() + (turned(h[5], t6, axes_.perpendicular) - u).norm();
        keep(missed + twist * (1 + lever_), branch, search);
      }
    });
    return free.met;
  }

  /// Positions of the joints of some axes; false when one has none within its limits.
  bool placeJoints(int begin, int end, double slack, const Search& search, Branch& branch) const {
    for (int axis = begin; axis < end; ++axis) {
      const int joint = jointOf(axis);
      const double angle = std::atan2(branch.turn[axis].s, branch.turn[axis].c);
      branch.positions[joint] = Representatives(angle, six_.steps[joint], search.nearJoints[joint], slack);
      if (branch.positions[joint].count == 0) return false;
    }
    return true;
  }

  /// Adds a branch that, polished where it must be, reaches the pose, and is another than those before it.
  /// @param residual  no less than the distance [m] and the angle [rad] that the tip is off
  void keep(double residual, Branch& branch, Search& search) const {
    if ((limitSlack_ > kExact || residual > kExact) && !polish(search, branch)) return;
    for (int i = 0; i < search.count; ++i) {
      double difference = 0;
      for (int axis = 0; axis < 6; ++axis) {
        const Turn &a = search.branches[i].turn[axis], &b = branch.turn[axis];
        difference = std::max({difference, std::abs(a.c - b.c), std::abs(a.s - b.s)});
      }
      if (difference < kDistinct) return;
    }
    if (search.count < static_cast<int>(search.branches.size())) search.branches[search.count++] = branch;
  }

  /// Newton's method where a subproblem was solved by least squares, or the axes meet only nearly.
  bool polish(const Search& search, Branch& branch) const {
    constexpr int kSteps = 10;
    Eigen::VectorXd q(6);
    for (int i = 0; i < 6; ++i) q[i] = branch.positions[i].furthestInside(six_.steps[i]);
    if (!convergeTip(six_, search.X_ST, settings_, kSteps, q)) return false;
    for (int axis = 0; axis < 6; ++axis) {
      const int joint = jointOf(axis);
      branch.turn[axis] = {std::cos(q[joint]), std::sin(q[joint])};
    }
    return placeJoints(0, 6, kExact, search, branch);
  }

  /// Every combination of positions that stand for the branch's angles.
  void expand(const Branch& branch, const Eigen::VectorXd& full, std::vector<Eigen::VectorXd>& solutions) const {
    const Eigen::Index n = leading_.size();
    std::array<int, 6> place{};
    for (bool more = true; more;) {
      Eigen::VectorXd& q = solutions.emplace_back(full);
      for (int i = 0; i < 6; ++i) q[n + i] = branch.positions[i].q[place[i]];
      more = false;
      for (int i = 0; i < 6 && !more; ++i) {
        place[i] = (place[i] + 1) % branch.positions[i].count;
        more = place[i] != 0;
      }
    }
  }

  IkSettings settings_;
  ArmChain leading_, six_;
  Isometry3d X_zero_;  // of the six at q = 0
  SixAxes axes_;
  bool reversed_;
  double limitSlack_;  // rad
  double lever_;       // m: the tip is no further from where the three axes meet
};

}  // namespace

std::unique_ptr<InverseKinematics> makeClosedFormInverseKinematics(const ArmChain& chain, const IkSettings& settings) {
  if (chain.size() < 6) return nullptr;
  ArmChain six = chain;
  six.steps.assign(chain.steps.end() - 6, chain.steps.end());
  const bool revolute = std::all_of(six.steps.begin(), six.steps.end(),
                                    [](const ArmChain::Step& step) { return step.type == JointType::revolute; });
  if (!revolute) return nullptr;
  for (const bool reversed : {false, true}) {
    if (const auto axes = recogniseAxes(six, reversed)) {
      return std::make_unique<ClosedForm>(chain, settings, *axes, reversed);
    }
  }
  return nullptr;
}

}  // namespace handhold
