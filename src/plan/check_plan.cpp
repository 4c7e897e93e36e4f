#include "plan/check_plan.h"

#include "mesh/ray_scene.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kSlack = 1e-6;        // of limits and positions: rounding
constexpr double kHandLinear = 1e-4;   // m
constexpr double kHandAngular = 1e-3;  // rad
constexpr double kStoodOn = 0.002;     // m, below the target: what it stands on

/// A surface as edges and rays.
struct Surface {
  std::vector<Vector3d> vertices;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  std::vector<Vector3d> pieces;  // a vertex of each connected piece
  RayScene rays;
  Eigen::AlignedBox3d box;
  bool closed;

  Surface(const TriangleMesh& mesh, bool isClosed)
      : vertices(mesh.vertices), pieces(pieceVertices(mesh)), rays(mesh), box(boundingBox(mesh)), closed(isClosed) {
    std::set<std::pair<std::uint32_t, std::uint32_t>> unique;
    for (const auto& t : mesh.triangles) {
      for (int i = 0; i < 3; ++i) unique.insert(std::minmax(t[i], t[(i + 1) % 3]));
    }
    edges.assign(unique.begin(), unique.end());
  }
};

/// Does an edge of `a` pass through `b`, or a vertex of it lie inside `b`? X_BA: pose of a in b.
bool edgesPass(const Surface& a, const Surface& b, const Isometry3d& X_BA) {
  const Eigen::AlignedBox3d grown(b.box.min() - Vector3d::Constant(1e-9), b.box.max() + Vector3d::Constant(1e-9));
  std::vector<Vector3d> p(a.vertices.size());
  for (std::size_t i = 0; i < p.size(); ++i) p[i] = X_BA * a.vertices[i];
  for (const auto& [i, k] : a.edges) {
    const Eigen::AlignedBox3d edgeBox(p[i].cwiseMin(p[k]), p[i].cwiseMax(p[k]));
    if (!edgeBox.intersects(grown)) continue;
    const double length = (p[k] - p[i]).norm();
    if (length > 0 && b.rays.cast(p[i], (p[k] - p[i]) / length).distance <= length) return true;
  }
  // No edge passes through: each piece of a is inside as a whole or not at all.
  return b.closed && std::any_of(a.pieces.begin(), a.pieces.end(), [&](const Vector3d& piece) {
           return grown.contains(X_BA * piece) && b.rays.contains(X_BA * piece);
         });
}

bool meet(const Surface& a, const Isometry3d& X_A, const Surface& b, const Isometry3d& X_B) {
  if (!a.box.transformed(X_A).intersects(b.box.transformed(X_B))) return false;
  const Isometry3d X_BA = X_B.inverse() * X_A;
  return edgesPass(a, b, X_BA) || edgesPass(b, a, X_BA.inverse());
}

class Checker {
 public:
  Checker(const CheckedMotion& motion, const CheckSteps& steps)
      : motion_(motion),
        steps_(steps),
        robot_(*motion.robot),
        arm_(robot_.arms[motion.arm]),
        trajectory_(*motion.trajectory),
        target_(*motion.target, motion.targetWatertight),
        moved_(linksMovedBy(robot_.body, motion.joints)) {
    for (const Link& link : robot_.body.links) {
      links_.push_back(link.mesh.triangles.empty() ? nullptr
                                                   : std::make_unique<Surface>(link.mesh, isWatertight(link.mesh)));
    }
    for (const Obstacle& obstacle : *motion.obstacles) {
      obstacles_.push_back(std::make_unique<Surface>(obstacle.shape->mesh, obstacle.shape->watertight));
    }
    handLink_.assign(links_.size(), -1);
    for (std::size_t i = 0; i < arm_.handLinks.size(); ++i) handLink_[arm_.handLinks[i]] = static_cast<int>(i);
  }

  std::optional<std::string> run() {
    if (auto fault = checkEnds()) return fault;
    if (auto fault = checkLimits()) return fault;
    findPairs(posesAt(trajectory_.points[motion_.holds ? 0 : segment("approach")->end].position));
    Isometry3d X_WO = motion_.X_WO;
    for (const TrajectorySegment& part : trajectory_.segments) {
      if (auto fault = checkSegment(part, X_WO)) return fault;
    }
    if (motion_.X_WO_after && !isAt(*motion_.X_WO_after, X_WO)) return "leaves the target elsewhere than it says";
    return std::nullopt;
  }

 private:
  const TrajectorySegment* segment(std::string_view name) const {
    for (const TrajectorySegment& part : trajectory_.segments) {
      if (part.name == name) return &part;
    }
    return nullptr;
  }

  /// Every joint of the robot: those of the trajectory as they are, those that follow them, the others at rest.
  VectorXd wholePosture(const VectorXd& q) const {
    VectorXd result = motion_.posture;
    std::vector<bool> given(robot_.body.joints.size(), false);
    for (std::size_t i = 0; i < motion_.joints.size(); ++i) {
      result[motion_.joints[i]] = q[static_cast<Eigen::Index>(i)];
      given[motion_.joints[i]] = true;
    }
    for (std::size_t i = 0; i < given.size(); ++i) {
      const Joint& joint = robot_.body.joints[i];
      if (!given[i] && joint.mimicOf >= 0 && given[joint.mimicOf]) {
        result[static_cast<Eigen::Index>(i)] = joint.mimicMultiplier * result[joint.mimicOf] + joint.mimicOffset;
      }
    }
    return result;
  }

  std::vector<Isometry3d> posesAt(const VectorXd& q) const {
    std::vector<Isometry3d> X = forwardKinematics(robot_.body, wholePosture(q));
    for (Isometry3d& x : X) x = motion_.X_WB * x;
    return X;
  }

  static double linearGap(const Isometry3d& a, const Isometry3d& b) {
    return (a.translation() - b.translation()).norm();
  }
  static double angularGap(const Isometry3d& a, const Isometry3d& b) {
    return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
  }
  static bool isAt(const Isometry3d& a, const Isometry3d& b) {
    return linearGap(a, b) <= kHandLinear && angularGap(a, b) <= kHandAngular;
  }

  /// Unknown segments would have no rule, and a held target needs segments that know of it.
  std::optional<std::string> checkNames() const {
    static const std::vector<std::string_view> kBringing = {"transit", "approach", "close", "lift"};
    static const std::vector<std::string_view> kTaking = {"carry", "lower", "open", "drop", "retreat", "return"};
    const auto& names = motion_.holds ? kTaking : kBringing;
    for (const TrajectorySegment& part : trajectory_.segments) {
      if (std::find(names.begin(), names.end(), part.name) == names.end()) {
        return fmt::format("has a segment {}, want one of: {}", part.name, fmt::join(names, ", "));
      }
    }
    for (const char* name : {"transit", "approach", "close"}) {
      if (!motion_.holds && segment(name) == nullptr) return fmt::format("has no segment {}", name);
    }
    return std::nullopt;
  }

  std::optional<std::string> checkEnds() const {
    if (auto fault = checkNames()) return fault;
    const VectorXd& first = trajectory_.points.front().position;
    for (std::size_t i = 0; i < motion_.joints.size(); ++i) {
      const double given = motion_.posture[motion_.joints[i]];
      if (std::abs(first[static_cast<Eigen::Index>(i)] - given) > kSlack) {
        return fmt::format("begins with {} at {}, not at {}", robot_.body.joints[motion_.joints[i]].name,
                           first[static_cast<Eigen::Index>(i)], given);
      }
    }
    if (trajectory_.points.back().velocity.cwiseAbs().maxCoeff() > kSlack) return "does not end at rest";
    const VectorXd& closed = motion_.holds ? first : trajectory_.points[segment("close")->end].position;
    const char* const when = motion_.holds ? "begins" : "ends its closing";
    const Isometry3d X_OH = motion_.X_WO.inverse() * posesAt(closed)[arm_.handLinks[0]];
    if (!isAt(X_OH, motion_.X_OH)) {
      return fmt::format("{} {} m and {} rad from the stored grasp", when, linearGap(X_OH, motion_.X_OH),
                         angularGap(X_OH, motion_.X_OH));
    }
    const VectorXd whole = wholePosture(closed);
    for (std::size_t i = 0; i < arm_.handJoints.size(); ++i) {
      const double found = whole[arm_.handJoints[i]], wanted = motion_.finalPosition[static_cast<Eigen::Index>(i)];
      if (std::abs(found - wanted) > 1e-5) {
        return fmt::format("{} with {} at {}, not at the stored {}", when, arm_.hand.joints[i].name, found, wanted);
      }
    }
    return std::nullopt;
  }

  std::optional<std::string> checkLimits() const {
    VectorXd velocity, acceleration;
    for (std::size_t p = 0; p < trajectory_.points.size(); ++p) {
      const TrajectoryPoint& point = trajectory_.points[p];
      const bool rising = p == 0 || point.time > trajectory_.points[p - 1].time;
      if (!rising) return fmt::format("time does not rise at point {}", p);
      if (p > 0) cubicPeaks(trajectory_.points[p - 1], point, velocity, acceleration);
      for (std::size_t i = 0; i < motion_.joints.size(); ++i) {
        const int index = motion_.joints[i];
        const Joint& joint = robot_.body.joints[index];
        const double q = point.position[static_cast<Eigen::Index>(i)];
        // A stored posture is rounded to 32 bits.
        if (q < joint.lower - kSlack || q > joint.upper + kSlack) {
          return fmt::format("{} at {} leaves {} .. {} at {:.3f} s", joint.name, q, joint.lower, joint.upper,
                             point.time);
        }
        if (p == 0) continue;
        const double v = velocity[static_cast<Eigen::Index>(i)], a = acceleration[static_cast<Eigen::Index>(i)];
        if (v > robot_.maxVelocity[index] * (1 + kSlack) || a > robot_.maxAcceleration[index] * (1 + kSlack)) {
          return fmt::format("{} moves at {} with acceleration {}, allowed are {} and {}, before {:.3f} s", joint.name,
                             v, a, robot_.maxVelocity[index], robot_.maxAcceleration[index], point.time);
        }
      }
    }
    return std::nullopt;
  }

  /// The pairs of links that may not meet.
  void findPairs(const std::vector<Isometry3d>& X) {
    const auto& allowed = robot_.allowedCollisions;
    for (int a = 0; a < static_cast<int>(links_.size()); ++a) {
      for (int b = a + 1; b < static_cast<int>(links_.size()); ++b) {
        if (!links_[a] || !links_[b] || !(moved_[a] || moved_[b])) continue;
        if (std::find(allowed.begin(), allowed.end(), std::pair(a, b)) != allowed.end()) continue;
        const bool inHand = handLink_[a] >= 0 && handLink_[b] >= 0;
        if (inHand && meet(*links_[a], X[a], *links_[b], X[b])) continue;
        pairs_.emplace_back(a, b);
      }
    }
  }

  bool isContactLink(int link) const { return handLink_[link] >= 0 && arm_.hand.links[handLink_[link]].contactAllowed; }

  /// How a segment may stand to the target.
  enum class Rule { avoid, contact, gone };

  std::optional<std::string> checkPosture(const std::vector<Isometry3d>& X, const Isometry3d& X_WO, Rule rule) const {
    const auto& name = [&](std::size_t link) { return robot_.body.links[link].name; };
    for (std::size_t i = 0; i < links_.size(); ++i) {
      if (!links_[i] || !moved_[i]) continue;
      for (std::size_t k = 0; k < obstacles_.size(); ++k) {
        if (meet(*links_[i], X[i], *obstacles_[k], (*motion_.obstacles)[k].X_WS)) {
          return fmt::format("{} meets {}", name(i), (*motion_.obstacles)[k].name);
        }
      }
      if (rule == Rule::gone || (rule == Rule::contact && isContactLink(static_cast<int>(i)))) continue;
      if (meet(*links_[i], X[i], target_, X_WO)) {
        return fmt::format("{} meets the target", name(i));
      }
    }
    for (const auto& [a, b] : pairs_) {
      if (meet(*links_[a], X[a], *links_[b], X[b])) return fmt::format("{} meets {}", name(a), name(b));
    }
    return std::nullopt;
  }

  /// What the target stood on is allowed until it has left it. The links that move are checkPosture's.
  std::optional<std::string> checkCarried(const std::vector<Isometry3d>& X, const Isometry3d& X_WO,
                                          std::vector<bool>& stoodOn) const {
    for (std::size_t i = 0; i < links_.size(); ++i) {
      if (links_[i] && !moved_[i] && meet(target_, X_WO, *links_[i], X[i])) {
        return fmt::format("the target meets {}", robot_.body.links[i].name);
      }
    }
    for (std::size_t k = 0; k < obstacles_.size(); ++k) {
      const bool meets = meet(target_, X_WO, *obstacles_[k], (*motion_.obstacles)[k].X_WS);
      if (meets && !stoodOn[k]) return fmt::format("the target meets {}", (*motion_.obstacles)[k].name);
      if (!meets) stoodOn[k] = false;
    }
    return std::nullopt;
  }

  std::vector<bool> whatItStandsOn(const Isometry3d& X_WO) const {
    std::vector<bool> result;
    for (std::size_t k = 0; k < obstacles_.size(); ++k) {
      const Isometry3d& X_WS = (*motion_.obstacles)[k].X_WS;
      const Isometry3d lower = Eigen::Translation3d(0, 0, -kStoodOn) * X_WO;
      result.push_back(meet(target_, X_WO, *obstacles_[k], X_WS) || meet(target_, lower, *obstacles_[k], X_WS));
    }
    return result;
  }

  Rule ruleOf(const TrajectorySegment& part) const {
    const auto named = [&](std::initializer_list<std::string_view> names) {
      return std::find(names.begin(), names.end(), part.name) != names.end();
    };
    if (named({"transit", "approach", "retreat"})) return Rule::avoid;
    if (part.name != "return") return Rule::contact;
    return segment("drop") != nullptr ? Rule::gone : Rule::avoid;
  }

  /// @param X_WO  the target at the segment's begin; then at its end
  std::optional<std::string> checkSegment(const TrajectorySegment& part, Isometry3d& X_WO) const {
    const bool lowers = part.name == "lower", lifts = part.name == "lift";
    const bool carried = lowers || lifts || part.name == "carry";
    const Isometry3d X_HO = posesAt(trajectory_.points[part.begin].position)[arm_.handLinks[0]].inverse() * X_WO;
    const auto targetAt = [&](const std::vector<Isometry3d>& X) {
      return carried ? X[arm_.handLinks[0]] * X_HO : X_WO;
    };
    const Isometry3d X_WO_end = targetAt(posesAt(trajectory_.points[part.end].position));
    std::vector<bool> stoodOn(obstacles_.size(), false);
    if (lifts || lowers) stoodOn = whatItStandsOn(lifts ? X_WO : X_WO_end);
    const Rule rule = ruleOf(part);
    // A lower is looked at backwards, as a lift.
    for (std::size_t n = 0; n < part.end - part.begin; ++n) {
      const std::size_t i = lowers ? part.end - 1 - n : part.begin + n;
      const TrajectoryPoint &a = trajectory_.points[i], &b = trajectory_.points[i + 1];
      const int count = stepsBetween(a, b);
      for (int s = n == 0 ? 0 : 1; s <= count; ++s) {
        const double t = a.time + (b.time - a.time) * (lowers ? count - s : s) / count;
        const std::vector<Isometry3d> X = posesAt(positionAt(trajectory_, i, t));
        auto fault = checkPosture(X, targetAt(X), rule);
        if (!fault && carried) fault = checkCarried(X, targetAt(X), stoodOn);
        if (fault) return fmt::format("{} at {:.3f} s ({})", *fault, t, part.name);
      }
    }
    X_WO = X_WO_end;
    return std::nullopt;
  }

  /// A cubic between two points moves a joint by no more than its peak speed allows.
  int stepsBetween(const TrajectoryPoint& a, const TrajectoryPoint& b) const {
    VectorXd velocity, acceleration;
    cubicPeaks(a, b, velocity, acceleration);
    double count = 1;
    for (std::size_t i = 0; i < motion_.joints.size(); ++i) {
      const bool linear = robot_.body.joints[motion_.joints[i]].type == JointType::prismatic;
      count = std::max(count, velocity[static_cast<Eigen::Index>(i)] * (b.time - a.time) /
                                  (linear ? steps_.linear : steps_.angular));
    }
    return static_cast<int>(std::ceil(count));
  }

  const CheckedMotion& motion_;
  const CheckSteps& steps_;
  const Robot& robot_;
  const Arm& arm_;
  const Trajectory& trajectory_;
  Surface target_;
  std::vector<bool> moved_;  // by link
  std::vector<std::unique_ptr<Surface>> links_, obstacles_;
  std::vector<int> handLink_;
  std::vector<std::pair<int, int>> pairs_;
};

}  // namespace

std::optional<std::string> findFault(const CheckedMotion& motion, const CheckSteps& steps) {
  return Checker(motion, steps).run();
}

}  // namespace handhold
