#include "core/error.h"
#include "core/file.h"
#include "hand/hand.h"
#include "hand/urdf_model.h"
#include "hand/urdf_reader.h"
#include "mesh/ray_scene.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include <Eigen/Eigenvalues>
#include <fmt/format.h>
#include <urdf_model/model.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kSweepSteps = 24;         // of a joint, or of all that close, from one end to the other
constexpr double kComesTogether = 0.3;  // of a fingertip's way must lead towards the palm's axis where a joint closes
constexpr double kAboutApproach = 0.9;  // cosine to the approach, from which on a joint turns about it
constexpr double kSymmetric = 0.1;      // of a joint's range, its middle is that near to 0: it spreads fingers sideways
constexpr double kFarEnd = 0.7;         // of a link's length: beyond it is its far end
constexpr double kSnap = 0.85;          // cosine to an axis of the root link, from which on that axis is meant
constexpr double kLeastGain = 1e-3;     // m, by which fingertips come together where that is no accident
constexpr double kHalfClosed = 0.5;     // of the way until the fingertips meet

/// For every link, whether no joint moves it against link `first`, which stands above it.
std::vector<bool> fixedTo(const Mechanism& body, int first) {
  std::vector<bool> fixed(body.links.size(), false);
  fixed[first] = true;
  for (std::size_t i = first + 1; i < fixed.size(); ++i) {
    fixed[i] = body.links[i].joint < 0 && body.links[i].parentLink >= 0 && fixed[body.links[i].parentLink];
  }
  return fixed;
}

/// The moving joints that hang from those links.
std::vector<int> jointsOn(const Mechanism& body, const std::vector<bool>& links) {
  std::vector<int> joints;
  for (std::size_t j = 0; j < body.joints.size(); ++j) {
    if (links[body.joints[j].parentLink]) joints.push_back(static_cast<int>(j));
  }
  return joints;
}

bool isBelow(const Mechanism& body, int link, int above) {
  while (link >= 0 && link != above) link = body.links[link].parentLink;
  return link == above;
}

/// Where the fingers branch off: an arm's single joints are passed over, and links without geometry that only hold the
/// hand.
int guessRoot(const Mechanism& body) {
  int root = 0;
  const auto branchesBelow = [&](int joint) {
    for (std::size_t i = 0; i < body.links.size(); ++i) {
      const int link = static_cast<int>(i);
      if (isBelow(body, link, body.joints[joint].childLink) && jointsOn(body, fixedTo(body, link)).size() > 1)
        return true;
    }
    return false;
  };
  for (std::vector<int> joints = jointsOn(body, fixedTo(body, root)); joints.size() == 1 && branchesBelow(joints[0]);
       joints = jointsOn(body, fixedTo(body, root))) {
    root = body.joints[joints[0]].childLink;
  }
  const bool isOnArm = root > 0;
  const std::vector<bool> fixed = fixedTo(body, root);
  const std::vector<int> fingers = jointsOn(body, fixed);
  const auto holdsAll = [&](int link) {
    return std::all_of(fingers.begin(), fingers.end(),
                       [&](int joint) { return isBelow(body, body.joints[joint].parentLink, link); });
  };
  for (int link = root + 1; link < static_cast<int>(body.links.size()); ++link) {
    if (!fixed[link] || !holdsAll(link)) continue;
    if (isOnArm || body.links[root].mesh.triangles.empty()) root = link;
  }
  return root;
}

/// Links that have a collision shape and nothing to be seen: padding about the hand, not its surface.
std::vector<std::string> paddedLinks(const urdf::ModelInterface& model, const Mechanism& hand) {
  std::vector<std::string> padded;
  std::size_t seen = 0;
  for (const Link& link : hand.links) {
    const auto source = model.getLink(link.name);
    seen += source->visual_array.empty() ? 0 : 1;
    if (link.joint < 0 && link.parentLink >= 0 && source->visual_array.empty() && !source->collision_array.empty())
      padded.push_back(link.name);
  }
  return seen > 0 ? padded : std::vector<std::string>{};
}

/// A direction in which the hand may take things, with all that follows from it. In the root link's frame.
struct Grasping {
  Vector3d approach = Vector3d::UnitZ(), closing = Vector3d::UnitX(), palm = Vector3d::Zero();
  int palmLink = 0;
  bool palmHasSurface = false;
  bool movesBothSides = false;  // of the palm, along the closing axis
  std::vector<int> direction;   // by joint: that closes, 0: none
  VectorXd open, closed;        // (J) where it begins; where the fingertips are nearest to each other
  double begin = 0, end = 0;    // of the joints' ways, 0 to 1: `open`, `closed`
  double gain = 0;              // m, by which the fingertips come nearer to the palm's axis
  double height = 0;            // m, of the fingertips over the palm when they do
};

std::vector<int> closingJoints(const Grasping& grasping) {
  std::vector<int> joints;
  for (std::size_t j = 0; j < grasping.direction.size(); ++j) {
    if (grasping.direction[j] != 0) joints.push_back(static_cast<int>(j));
  }
  return joints;
}

/// Looks for the direction in which the fingertips come together.
class Guesser {
 public:
  explicit Guesser(const Mechanism& hand) : hand_(hand), fixed_(fixedTo(hand, 0)), fingers_(jointsOn(hand, fixed_)) {
    findTips();
    middle_ = VectorXd::Zero(static_cast<Eigen::Index>(hand.joints.size()));
    rest_ = middle_;
    for (const int j : independentJoints(hand)) {
      const Joint& joint = hand.joints[j];
      rest_[j] = std::clamp(0.0, joint.lower, joint.upper);
      middle_[j] = isBounded(joint) ? (joint.lower + joint.upper) / 2 : rest_[j];
    }
    middle_ = followMimics(hand, middle_);
    rest_ = followMimics(hand, rest_);
  }

  /// Along the axis of the root link in front of which the fingertips come nearest to each other; `gain` is 0 when they
  /// do so in front of none, and every bounded joint then closes, to where it can go farthest from 0.
  Grasping best() const {
    Grasping found;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {1.0, -1.0}) {
        Grasping grasping = along(sign * Vector3d::Unit(axis));
        if (grasping.gain > kLeastGain && grasping.gain > found.gain) found = std::move(grasping);
      }
    }
    if (found.gain > 0) return found;
    placePalm(found);
    found.open = found.closed = rest_;
    for (const Joint& joint : hand_.joints) {
      const bool closes = joint.mimicOf < 0 && isBounded(joint);
      found.direction.push_back(!closes ? 0 : joint.upper >= -joint.lower ? 1 : -1);
    }
    return found;
  }

  static bool isBounded(const Joint& joint) { return std::isfinite(joint.lower) && std::isfinite(joint.upper); }

  /// Spreads its fingers to both sides alike, and is left at 0.
  static bool isSymmetric(const Joint& joint) {
    return joint.type == JointType::revolute && isBounded(joint) &&
           std::abs(joint.lower + joint.upper) < kSymmetric * (joint.upper - joint.lower);
  }

 private:
  /// The far end of the last link with geometry of each finger.
  struct Tip {
    int link;
    Vector3d p_L;
  };

  void findTips() {
    for (int i = 0; i < static_cast<int>(hand_.links.size()); ++i) {
      if (fixed_[i] || hand_.links[i].mesh.triangles.empty()) continue;
      bool isLast = true;
      for (int k = i + 1; k < static_cast<int>(hand_.links.size()); ++k) {
        isLast = isLast && (hand_.links[k].mesh.triangles.empty() || !isBelow(hand_, k, i));
      }
      if (isLast) tips_.push_back({i, farEnd(hand_.links[i].mesh)});
    }
  }

  static Vector3d farEnd(const TriangleMesh& mesh) {
    double farthest = 0;
    for (const Vector3d& p : mesh.vertices) farthest = std::max(farthest, p.norm());
    Eigen::AlignedBox3d end;
    for (const Vector3d& p : mesh.vertices) {
      if (p.norm() >= kFarEnd * farthest) end.extend(p);
    }
    return end.center();
  }

  std::vector<Vector3d> tipsAt(const VectorXd& q) const {
    const std::vector<Isometry3d> X = forwardKinematics(hand_, q);
    std::vector<Vector3d> points;
    for (const Tip& tip : tips_) points.push_back(X[tip.link] * tip.p_L);
    return points;
  }

  /// Between the roots of the fingers; a single finger has the palm's far end as its other side.
  Vector3d center(const Vector3d& approach) const {
    const std::vector<Isometry3d> X = forwardKinematics(hand_, middle_);
    Vector3d sum = Vector3d::Zero();
    for (const int j : fingers_)
      sum += X[hand_.joints[j].parentLink] * hand_.joints[j].X_PJ.translation() / static_cast<double>(fingers_.size());
    if (fingers_.size() > 1 || tips_.empty()) return sum;
    Eigen::AlignedBox3d body;
    for (std::size_t i = 0; i < fixed_.size(); ++i) {
      if (!fixed_[i]) continue;
      for (const Vector3d& p : hand_.links[i].mesh.vertices) body.extend(X[i] * p);
    }
    if (body.isEmpty()) return sum;
    const double end = std::max(approach.dot(body.min()), approach.dot(body.max()));
    Vector3d across = Vector3d::Zero();
    std::size_t count = 0;
    for (std::size_t i = 0; i < fixed_.size(); ++i) {
      if (!fixed_[i]) continue;
      for (const Vector3d& p : hand_.links[i].mesh.vertices) {
        if (approach.dot(X[i] * p) < end - 0.2 * std::abs(approach.dot(body.sizes()))) continue;
        across += X[i] * p;
        ++count;
      }
    }
    across /= static_cast<double>(count);
    const Joint& joint = hand_.joints[fingers_[0]];
    Vector3d widest = across;
    for (const double position : {joint.lower, joint.upper}) {
      if (!std::isfinite(position)) continue;
      VectorXd q = middle_;
      q[fingers_[0]] = position;
      const Vector3d tip = tipsAt(followMimics(hand_, q))[0];
      if ((tip - across).norm() > (widest - across).norm()) widest = tip;
    }
    return (widest + across) / 2;
  }

  /// The palm's surface over its centre.
  void placePalm(Grasping& grasping) const {
    constexpr double kFar = 1;       // m, in front of every hand
    constexpr double kAside = 1e-5;  // m, rays may slip through where they aim at vertices
    const std::vector<Isometry3d> X = forwardKinematics(hand_, middle_);
    const Vector3d across = grasping.approach.unitOrthogonal();
    const Vector3d aside = kAside * (across + 0.7 * grasping.approach.cross(across));
    const Vector3d from = center(grasping.approach) + kFar * grasping.approach + aside;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < fixed_.size(); ++i) {
      if (!fixed_[i] || hand_.links[i].mesh.triangles.empty()) continue;
      const Isometry3d X_LH = X[i].inverse();
      const RayHit hit = RayScene(hand_.links[i].mesh).cast(X_LH * from, X_LH.linear() * -grasping.approach);
      if (hit.distance < nearest) nearest = hit.distance, grasping.palmLink = static_cast<int>(i);
    }
    grasping.palmHasSurface = std::isfinite(nearest);
    grasping.palm = from - aside - (grasping.palmHasSurface ? nearest : kFar) * grasping.approach;
  }

  static double fromAxis(const Vector3d& p, const Grasping& grasping) {
    const Vector3d r = p - grasping.palm;
    return (r - r.dot(grasping.approach) * grasping.approach).norm();
  }

  /// The direction in which a joint, the others half way, brings the fingertips that it moves nearer to the palm's
  /// axis; 0 where their way leads elsewhere, and where it turns about that axis.
  int closingDirection(int j, const Grasping& grasping) const {
    const Joint& joint = hand_.joints[j];
    if (!isBounded(joint)) return 0;
    const Vector3d axis = forwardKinematics(hand_, middle_)[joint.childLink].linear() * joint.axis;
    if (joint.type == JointType::revolute && std::abs(axis.dot(grasping.approach)) > kAboutApproach) return 0;
    const std::vector<bool> moves = linksMovedBy(hand_, {j});
    double bestDrop = 0;
    int result = 0;
    for (const int direction : {1, -1}) {
      std::vector<Vector3d> before;
      double way = 0, start = 0, sum = 0;
      for (int s = 0; s <= kSweepSteps; ++s) {
        const double t = static_cast<double>(s) / kSweepSteps;
        VectorXd q = middle_;
        q[j] = direction > 0 ? std::lerp(joint.lower, joint.upper, t) : std::lerp(joint.upper, joint.lower, t);
        const std::vector<Vector3d> tips = tipsAt(followMimics(hand_, q));
        sum = 0;
        for (std::size_t i = 0; i < tips.size(); ++i) {
          if (!moves[tips_[i].link]) continue;
          sum += fromAxis(tips[i], grasping);
          if (s > 0) way += (tips[i] - before[i]).norm();
        }
        before = tips;
        if (s == 0) start = sum;
        if (start - sum > bestDrop && start - sum > kComesTogether * way) bestDrop = start - sum, result = direction;
      }
    }
    return result;
  }

  /// A sideways joint closes nothing where the same finger has another joint that does.
  void dropSidewaysJoints(std::vector<int>& direction) const {
    for (const int finger : fingers_) {
      const auto onFinger = [&](int j) {
        return isBelow(hand_, hand_.joints[j].childLink, hand_.joints[finger].childLink);
      };
      bool closesOtherwise = false;
      for (int j = 0; j < static_cast<int>(direction.size()); ++j)
        closesOtherwise = closesOtherwise || (onFinger(j) && direction[j] != 0 && !isSymmetric(hand_.joints[j]));
      for (int j = 0; j < static_cast<int>(direction.size()) && closesOtherwise; ++j) {
        if (onFinger(j) && isSymmetric(hand_.joints[j])) direction[j] = 0;
      }
    }
  }

  bool isWithinLimits(const VectorXd& q) const {
    for (std::size_t j = 0; j < hand_.joints.size(); ++j) {
      const double position = q[static_cast<Eigen::Index>(j)];
      if (position < hand_.joints[j].lower - 1e-9 || position > hand_.joints[j].upper + 1e-9) return false;
    }
    return true;
  }

 public:
  /// The posture in which all joints that close have gone a share of their ways, the others at rest.
  VectorXd closedBy(double t, const Grasping& grasping) const {
    VectorXd q = rest_;
    for (std::size_t j = 0; j < grasping.direction.size(); ++j) {
      if (grasping.direction[j] == 0) continue;
      const Joint& joint = hand_.joints[j];
      q[static_cast<Eigen::Index>(j)] =
          grasping.direction[j] > 0 ? std::lerp(joint.lower, joint.upper, t) : std::lerp(joint.upper, joint.lower, t);
    }
    return followMimics(hand_, q);
  }

 private:
  Grasping along(const Vector3d& approach) const {
    Grasping grasping;
    grasping.approach = approach;
    placePalm(grasping);
    grasping.direction.assign(hand_.joints.size(), 0);
    for (const int j : independentJoints(hand_)) grasping.direction[j] = closingDirection(j, grasping);
    dropSidewaysJoints(grasping.direction);
    while (grasping.begin < 1 && !isWithinLimits(closedBy(grasping.begin, grasping)))
      grasping.begin += 1.0 / kSweepSteps;  // followers may have narrower limits
    grasping.open = grasping.closed = closedBy(grasping.begin, grasping);
    const std::vector<Vector3d> open = tipsAt(grasping.open);
    double start = 0;
    for (const Vector3d& tip : open) start += fromAxis(tip, grasping) / static_cast<double>(open.size());
    for (int s = 1; s <= kSweepSteps; ++s) {
      const double t = static_cast<double>(s) / kSweepSteps;
      const VectorXd q = closedBy(t, grasping);
      if (t <= grasping.begin || !isWithinLimits(q)) continue;
      double distance = 0, height = 0, inFront = 0;
      for (const Vector3d& tip : tipsAt(q)) {
        const double over = (tip - grasping.palm).dot(approach);
        distance += fromAxis(tip, grasping) / static_cast<double>(open.size());
        height += over / static_cast<double>(open.size());
        inFront += (over > 0 ? 1.0 : 0.0) / static_cast<double>(open.size());
      }
      const double gain = (start - distance) * inFront * inFront;
      if (gain <= grasping.gain) continue;
      grasping.gain = gain;
      grasping.height = height;
      grasping.closed = q;
      grasping.end = t;
    }
    grasping.closing = closingAxis(grasping);
    grasping.movesBothSides = movesBothSides(grasping);
    return grasping;
  }

  /// As jawSides (hand.h) has it of what closes.
  bool movesBothSides(const Grasping& grasping) const {
    const std::vector<Isometry3d> X = forwardKinematics(hand_, grasping.open);
    const std::vector<bool> moves = linksMovedBy(hand_, closingJoints(grasping));
    bool above = false, below = false;
    for (std::size_t i = 0; i < moves.size(); ++i) {
      if (!moves[i] || hand_.links[i].mesh.triangles.empty()) continue;
      const Vector3d middle = X[i] * boundingBox(hand_.links[i].mesh).center();
      ((middle - grasping.palm).dot(grasping.closing) < 0 ? below : above) = true;
    }
    return above && below;
  }

  /// The line along which the fingertips come together, across the approach; of a single finger its way.
  Vector3d closingAxis(const Grasping& grasping) const {
    const std::vector<Vector3d> open = tipsAt(grasping.open), closed = tipsAt(grasping.closed);
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    Vector3d together = Vector3d::Zero();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - grasping.approach * grasping.approach.transpose();
    for (std::size_t i = 0; i < open.size(); ++i) {
      const Vector3d way = across * (closed[i] - open[i]);
      spread += way * way.transpose();
      together += way;
    }
    Vector3d axis = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors().col(2);
    axis = across * axis;
    if (axis.norm() < 0.5) axis = grasping.approach.unitOrthogonal();
    axis.normalize();
    for (int k = 0; k < 3; ++k) {
      if (std::abs(axis[k]) > kSnap) axis = Vector3d::Unit(k);
    }
    if (open.size() == 1) return axis.dot(together) < 0 ? Vector3d(-axis) : axis;
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    return axis[largest] < 0 ? Vector3d(-axis) : axis;
  }

  const Mechanism& hand_;
  std::vector<bool> fixed_;   // by link: part of the palm
  std::vector<int> fingers_;  // the joints on the palm
  std::vector<Tip> tips_;
  VectorXd middle_, rest_;  // (J)
};

std::string text(const Vector3d& v) {
  const Vector3d r = (1e5 * v).array().round() / 1e5;  // no -0
  return fmt::format("[{:.5g}, {:.5g}, {:.5g}]", r.x() + 0.0, r.y() + 0.0, r.z() + 0.0);
}

/// Joints that neither close nor spread to both sides alike, and turn far: the hand's other shapes.
std::vector<int> shapingJoints(const Mechanism& hand, const Grasping& grasping) {
  constexpr double kFar = 1;  // rad
  std::vector<int> joints;
  for (const int j : independentJoints(hand)) {
    const Joint& joint = hand.joints[j];
    if (grasping.direction[j] != 0 || joint.type != JointType::revolute || !Guesser::isBounded(joint)) continue;
    if (!Guesser::isSymmetric(joint) && joint.upper - joint.lower > kFar) joints.push_back(j);
  }
  return joints;
}

std::string preshapeLine(const Mechanism& hand, const std::string& name, const VectorXd& q) {
  std::string joints;
  for (const int j : independentJoints(hand)) {
    joints += fmt::format("{}{}: {:.7g}", joints.empty() ? "" : ", ", yamlName(hand.joints[j].name), q[j] + 0.0);
  }
  return fmt::format("  - {{name: {}, joints: {{{}}}}}\n", name, joints);
}

std::string preshapeLines(const Mechanism& hand, const Guesser& guesser, const Grasping& grasping) {
  const std::vector<int> shaping = shapingJoints(hand, grasping);
  std::string lines;
  for (const double share : {0.0, 0.5, 1.0}) {
    if (share > 0 && shaping.empty()) break;
    for (const bool isHalf : {false, true}) {
      const double t = grasping.begin + (isHalf ? kHalfClosed : 0) * (grasping.end - grasping.begin);
      VectorXd q = grasping.gain > 0 ? guesser.closedBy(t, grasping) : grasping.open;
      for (const int j : shaping) {
        const Joint& joint = hand.joints[j];
        const double other = std::abs(joint.upper) > std::abs(joint.lower) ? joint.upper : joint.lower;
        q[j] = std::lerp(std::clamp(0.0, joint.lower, joint.upper), other, share);
      }
      const std::string shape = shaping.empty() ? "" : fmt::format("shape_{:.0f}_", 100 * share);
      lines += preshapeLine(hand, shape + (isHalf ? "half" : "open"), q);
      if (grasping.gain <= 0) break;
    }
  }
  return lines;
}

std::string closingLines(const Mechanism& hand, const Grasping& grasping) {
  const std::vector<int> closing = closingJoints(grasping);
  std::string lines;
  for (const int j : closing) {
    const std::vector<int> followers = followersOf(hand, j);
    const bool centers =
        closing.size() == 1 && (followers.empty() || isSlidingPair(hand, j) || grasping.movesBothSides);
    std::string with;
    for (const int follower : followers)
      with += (with.empty() ? "   # moves with it: " : ", ") + hand.joints[follower].name;
    lines += fmt::format("  - {{joint: {}, direction: {}{}}}{}\n", yamlName(hand.joints[j].name), grasping.direction[j],
                         centers ? ", self_centering: true" : "", with);
  }
  return lines;
}

std::string palmLines(const Mechanism& hand, const Grasping& grasping) {
  const std::vector<Isometry3d> X = forwardKinematics(hand, grasping.open);
  const Isometry3d X_LH = X[grasping.palmLink].inverse();
  const std::string link = yamlName(hand.links[grasping.palmLink].name);
  std::string lines =
      grasping.gain > 0
          ? fmt::format(
                "# In front of this side the fingertips come together, by {:.0f} mm, {:.0f} mm over the palm.\n",
                1e3 * grasping.gain, 1e3 * grasping.height)
          : "# NOT FOUND: in front of no side do the fingertips come together. Set palm, preshapes and closing by "
            "hand.\n";
  if (!grasping.palmHasSurface) lines += "# NOT FOUND: there is no surface there. Put the position on the palm's.\n";
  lines +=
      fmt::format("palm: {{link: {}, position: {}, approach: {}, closing: {}}}\n", link, text(X_LH * grasping.palm),
                  text(X_LH.linear() * grasping.approach), text(X_LH.linear() * grasping.closing));
  if (grasping.gain > 0) {
    lines += fmt::format("tcp: {{link: {}, position: {}}}\n", link,
                         text(X_LH * (grasping.palm + grasping.height * grasping.approach)));
  }
  return lines;
}

}  // namespace

std::string initialHandConfig(const std::string& urdfPath, const std::string& rootLink, const PackagePaths& packages) {
  Mechanism hand;
  readUrdf(urdfPath, rootLink, {}, packages, hand);
  const std::string root = rootLink.empty() ? hand.links[guessRoot(hand)].name : rootLink;
  const std::vector<std::string> padded = paddedLinks(*parseUrdf(urdfPath, hand.urdfText), hand);
  hand = {};
  readUrdf(urdfPath, root, {}, packages, hand);
  if (hand.joints.empty()) {
    throw InputError(
        fmt::format("{}: has no moving joint below the link {}, want a hand with fingers", urdfPath, root));
  }
  std::vector<std::string> ignored, ignoredNames;
  for (const Link& link : hand.links) {
    if (std::find(padded.begin(), padded.end(), link.name) != padded.end())
      ignored.push_back(link.name), ignoredNames.push_back(yamlName(link.name));
  }
  if (!ignored.empty()) {
    hand = {};
    readUrdf(urdfPath, root, ignored, packages, hand);
  }
  const Guesser guesser(hand);
  const Grasping grasping = guesser.best();
  const std::string file = std::filesystem::path(urdfPath).filename().string();
  return fmt::format(
      "# Guessed from {0}, beside which this file belongs. See what was guessed: handhold hand . --out pictures\n"
      "urdf: {8}\n"
      "root_link: {1}   # {2}\n"
      "{3}{4}"
      "# Open, and half way until the fingertips meet{5}. standoff: METRES would be added to the back-off.\n"
      "preshapes:\n{6}"
      "# What brings the fingertips together, from palm to tip. breakaway: JOINT would let a follower further out go "
      "on\n"
      "# alone when only links before it touch.\n"
      "closing:\n{7}"
      "contact_links: all\n"
      "# Fingertips that transmit a moment about the contact normal, up to friction x torsion_radius x normal force:\n"
      "# contact: {{model: soft_finger, torsion_radius: METRES}}\n",
      file, yamlName(root), rootLink.empty() ? "where the fingers branch off (--root LINK: another)" : "as given",
      ignored.empty() ? ""
                      : fmt::format("ignore_links: [{}]   # seen nowhere: padding\n", fmt::join(ignoredNames, ", ")),
      palmLines(hand, grasping),
      shapingJoints(hand, grasping).empty() ? "" : ", with the joints that do not close at three places",
      preshapeLines(hand, guesser, grasping), closingLines(hand, grasping), yamlName(file));
}

}  // namespace handhold
