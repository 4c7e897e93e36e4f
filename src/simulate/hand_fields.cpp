#include "simulate/hand_fields.h"

#include "core/error.h"
#include "simulate/collision_models.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace handhold {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFineStep = 2e-3, kCoarseStep = 3e-3, kWideStep = 12e-3;  // m, of first-touch fields
constexpr double kFineColumn = 1.5e-3, kCoarseColumn = 3e-3;               // m
constexpr int kPoses = 256;                                                // a motion is laid out at so many steps
constexpr int kLongestStride = 24;                                         // of these, while nothing is near
constexpr double kSpeedReserve = 1.25;                                     // speeds change within a stride

/// The poses of a motion's leaves in B at s = range i / kPoses: poses[i][leaf], inverted (B to link).
using PoseTable = std::vector<std::vector<Isometry3d>>;

/// A rotation that turns z to `axis`.
Eigen::Matrix3d turnZTo(const Vector3d& axis) {
  return Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), axis).toRotationMatrix();
}

Isometry3d rotation(const Eigen::Matrix3d& R) {
  Isometry3d X = Isometry3d::Identity();
  X.linear() = R;
  return X;
}

bool isAncestor(const Hand& hand, int ancestor, int link) {
  for (int i = link; i >= 0; i = hand.links[i].parentLink) {
    if (i == ancestor) return true;
  }
  return false;
}

/// The deepest link that does not move and carries all that moves.
int commonBase(const Hand& hand, const std::vector<int>& joints) {
  int base = hand.joints[joints[0]].parentLink;
  const auto carries = [&](int link) {
    return std::all_of(joints.begin(), joints.end(), [&](int j) {
      return isAncestor(hand, link, hand.joints[j].childLink) && hand.joints[j].childLink != link;
    });
  };
  while (!carries(base)) base = hand.links[base].parentLink;
  // A carrier may itself hang on a joint that moves.
  for (int i = base; i > 0; i = hand.links[i].parentLink) {
    if (std::find(joints.begin(), joints.end(), hand.links[i].joint) != joints.end()) base = hand.links[i].parentLink;
  }
  return base;
}

/// The kinematics of one closing motion from the preshape, without fields.
Motion makeMotion(const Hand& hand, const Mover& mover, const Eigen::VectorXd& q, bool overWholeRange) {
  Motion motion;
  motion.mover = mover;
  const Joint& driver = hand.joints[mover.joint];
  motion.turns = driver.type == JointType::revolute;
  motion.direction = mover.direction;
  const double first = mover.direction > 0 ? driver.lower : driver.upper;
  const double last = mover.direction > 0 ? driver.upper : driver.lower;
  motion.start = overWholeRange ? first : q[mover.joint];
  motion.range = std::max(0.0, mover.direction * (last - motion.start));

  std::vector<int> joints = {mover.joint};
  joints.insert(joints.end(), mover.followers.begin(), mover.followers.end());
  std::sort(joints.begin(), joints.end(),
            [&](int a, int b) { return hand.joints[a].childLink < hand.joints[b].childLink; });
  motion.baseLink = commonBase(hand, joints);
  const std::vector<Isometry3d> X_HL = forwardKinematics(hand, q);
  const auto nodeAbove = [&](int link) {  // the last node that moves `link`, -1: none
    for (int i = link; i >= 0; i = hand.links[i].parentLink) {
      const auto at = std::find(joints.begin(), joints.end(), hand.links[i].joint);
      if (hand.links[i].joint >= 0 && at != joints.end()) return static_cast<int>(at - joints.begin());
    }
    return -1;
  };
  // Of a node's frame N and its joint's child link C: x_C = A x_N.
  const auto inNode = [&](int node, int link) {  // X_NL
    if (node < 0) return Isometry3d(X_HL[motion.baseLink].inverse() * X_HL[link]);
    const Joint& joint = hand.joints[joints[node]];
    return Isometry3d(rotation(turnZTo(joint.axis)).inverse() * X_HL[joint.childLink].inverse() * X_HL[link]);
  };
  for (const int j : joints) {
    const Joint& joint = hand.joints[j];
    MotionNode node;
    node.parent = nodeAbove(joint.parentLink);
    const Isometry3d X_NP = inNode(node.parent, joint.parentLink);
    node.X_NP = rotation(turnZTo(joint.axis)).inverse() * joint.X_PJ.inverse() * X_NP.inverse();
    node.fromParent = Placement::of(node.X_NP);
    node.turns = joint.type == JointType::revolute;
    const bool drives = j == mover.joint;
    node.offset = drives ? motion.start : joint.mimicMultiplier * motion.start + joint.mimicOffset;
    node.rate = drives ? motion.direction : joint.mimicMultiplier * motion.direction;
    node.lower = std::min(joint.lower, drives ? motion.start : joint.lower);
    node.upper = std::max(joint.upper, drives ? motion.start : joint.upper);
    motion.nodes.push_back(node);
  }
  motion.X_BP = motion.nodes[0].X_NP;
  const Isometry3d X_PB = motion.X_BP.inverse();
  for (MotionNode& node : motion.nodes) {
    if (node.parent >= 0) continue;
    node.X_NP = &node == &motion.nodes[0] ? Isometry3d::Identity() : Isometry3d(node.X_NP * X_PB);
    node.fromParent = Placement::of(node.X_NP);
  }
  for (const int link : mover.links) {
    const int node = nodeAbove(link);
    const Isometry3d X_LN = inNode(node, link).inverse();
    motion.leaves.push_back({node, link, X_LN, Placement::of(X_LN)});
  }
  // Joints between B and the moved links that this motion takes to stand still.
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    const int j = static_cast<int>(i);
    if (std::find(joints.begin(), joints.end(), j) != joints.end()) continue;
    const int child = hand.joints[i].childLink;
    const bool carriesLeaf =
        std::any_of(mover.links.begin(), mover.links.end(), [&](int l) { return isAncestor(hand, child, l); });
    if (carriesLeaf && !isAncestor(hand, child, motion.baseLink)) motion.heldJoints.emplace_back(j, q[j]);
  }
  return motion;
}

/// The slide that brings up the counterpart of a single jaw: the whole hand along `axis` [in H].
Motion makeSlide(const Hand& hand, const std::vector<int>& links, const Vector3d& axis,
                 const std::vector<Isometry3d>& X_HL) {
  Motion motion;
  motion.turns = false;
  motion.range = kLongestSlide;
  motion.slideAxis = axis;
  const Isometry3d A = rotation(turnZTo(axis));
  MotionNode node;
  node.X_NP = A.inverse();
  node.fromParent = Placement::of(node.X_NP);
  node.turns = false;
  node.rate = 1;
  node.upper = kLongestSlide;
  motion.nodes.push_back(node);
  for (const int link : links) {
    const Isometry3d X_LN = X_HL[link].inverse() * A;
    motion.leaves.push_back({0, link, X_LN, Placement::of(X_LN)});
  }
  for (std::size_t j = 0; j < hand.joints.size(); ++j) {
    const bool carries =
        std::any_of(links.begin(), links.end(), [&](int l) { return isAncestor(hand, hand.joints[j].childLink, l); });
    if (carries) motion.heldJoints.emplace_back(static_cast<int>(j), 0.0);  // positions are filled in by the caller
  }
  return motion;
}

PoseTable layOutPoses(const Hand& hand, const Motion& motion, Eigen::VectorXd q) {
  PoseTable table(kPoses + 1);
  std::vector<Isometry3d> X_HL = forwardKinematics(hand, q);
  for (int i = 0; i <= kPoses; ++i) {
    const double s = motion.range * i / kPoses;
    if (motion.mover) {
      place(hand, *motion.mover, motion.start + motion.direction * s, q);
      forwardKinematics(hand, q, X_HL);
    }
    const Isometry3d X_BH = motion.mover ? Isometry3d(motion.X_BP * X_HL[motion.baseLink].inverse())
                                         : Isometry3d(Eigen::Translation3d(s * motion.slideAxis));
    for (const MotionLeaf& leaf : motion.leaves) table[i].push_back((X_BH * X_HL[leaf.link]).inverse());
  }
  return table;
}

/// The radius of the ball about a node that holds those of `radius` about all points of its cell.
double reachOf(double step, double radius) { return 0.5 * std::sqrt(3.0) * step + radius + 1e-5; }

/// The value of the node whose cell `p` is in; kNever outside the lattice.
std::uint32_t nearestValue(const Lattice<std::uint32_t>& lattice, const Vector3d& p) {
  std::array<int, 3> at{};
  for (int i = 0; i < 3; ++i) {
    const double u = (p[i] - lattice.origin[i]) / lattice.step + 0.5;
    if (!(u >= 0 && u < lattice.size[i])) return Motion::kNever;
    at[i] = static_cast<int>(u);
  }
  return lattice.value[lattice.index(at[0], at[1], at[2])];
}

/// The first step, no earlier than `safe`, at which a ball of `radius` about `p` can be touched, walking the table from
/// its beginning or its end. `safe`: up to there nothing touches.
double firstTouch(const std::vector<const LinkGrid*>& grids, const PoseTable& table, const Vector3d& p, double radius,
                  bool backwards, double safe) {
  for (int i = static_cast<int>(safe); i <= kPoses;) {
    const int at = backwards ? kPoses - i : i;
    const int next = backwards ? std::max(at - 1, 0) : std::min(at + 1, kPoses);
    double stride = kLongestStride;
    for (std::size_t k = 0; k < grids.size(); ++k) {
      const Vector3d here = table[at][k] * p;
      const double gap = grids[k]->lowerBound(here) - radius;
      if (gap <= 0) return safe;
      const double speed = kSpeedReserve * (table[next][k] * p - here).norm() + 1e-6;  // m per step
      stride = std::min(stride, gap / speed);
    }
    safe = std::max(safe, i + stride);
    i = std::max(i + 1, static_cast<int>(safe));
  }
  return kInfinity;
}

/// First touch for balls of `radius` around all points of each cell. A node's walk starts where that of the wider balls
/// of `outer`, when given, ended.
Lattice<std::uint32_t> firstTouchField(const std::vector<const LinkGrid*>& grids, const PoseTable& table, double step,
                                       double radius, const Lattice<std::uint32_t>* outer,
                                       const std::atomic<bool>* cancel) {
  constexpr double kUnit = static_cast<double>(Motion::kLastUnit) / kPoses;
  const double reach = reachOf(step, radius);
  AlignedBox3d box;
  for (const auto& poses : table) {
    for (std::size_t k = 0; k < grids.size(); ++k) {
      const Vector3d c = poses[k].inverse() * grids[k]->center;
      box.extend(Vector3d(c.array() - grids[k]->radius - reach)).extend(Vector3d(c.array() + grids[k]->radius + reach));
    }
  }
  Lattice<std::uint32_t> field;
  field.origin = box.min().cast<float>();
  field.step = static_cast<float>(step);
  for (int i = 0; i < 3; ++i) field.size[i] = static_cast<int>(std::ceil(box.sizes()[i] / step)) + 1;
  field.value.assign(field.index(0, 0, field.size[2]), Motion::kNever);
  for (int z = 0; z < field.size[2]; ++z) {
    for (int y = 0; y < field.size[1]; ++y) {
      throwIfCancelled(cancel);
      for (int x = 0; x < field.size[0]; ++x) {
        const Vector3d p = field.node(x, y, z);
        double fromFirst = 0, fromLast = 0;
        if (outer != nullptr) {
          const std::uint32_t around = nearestValue(*outer, p);
          if (around == Motion::kNever) continue;
          fromFirst = (around & 0xFFFF) / kUnit;
          fromLast = kPoses - (around >> 16) / kUnit;
        }
        const double first = firstTouch(grids, table, p, reach, false, fromFirst);
        if (first == kInfinity) continue;
        const double last = kPoses - firstTouch(grids, table, p, reach, true, fromLast);
        const auto firstUnit =
            static_cast<std::uint32_t>(std::max(0.0, std::floor(std::min<double>(first, kPoses) * kUnit)));
        const auto lastUnit = static_cast<std::uint32_t>(
            std::clamp(std::ceil(last * kUnit), 0.0, static_cast<double>(Motion::kLastUnit)));
        field.value[field.index(x, y, z)] = firstUnit | (std::max(firstUnit, lastUnit) << 16);
      }
    }
  }
  return field;
}

FirstTouch firstTouchFields(const std::vector<const LinkGrid*>& grids, const PoseTable& table,
                            const std::atomic<bool>* cancel) {
  // The ball about a node holds those of the next finer field's nodes in its cell.
  const double aroundCoarse = reachOf(kCoarseStep, ObjectShell::kBlockRadius);
  const Lattice<std::uint32_t> wide = firstTouchField(grids, table, kWideStep, aroundCoarse, nullptr, cancel);
  FirstTouch touch;
  touch.coarse = firstTouchField(grids, table, kCoarseStep, ObjectShell::kBlockRadius, &wide, cancel);
  static_assert(ObjectShell::kBlockRadius > kFineStep);
  touch.fine = firstTouchField(grids, table, kFineStep, 0, &touch.coarse, cancel);
  return touch;
}

/// One vertical line through the hand: the intervals of z in which a ball of `reach` can touch, from the top.
struct Interval {
  double top, bottom;
  int link;
};

struct PlacedLink {
  int link;
  const LinkGrid* grid;
  Isometry3d X_LG;
  Vector3d center;  // of the bounding sphere, in G
};

void walkColumn(const std::vector<PlacedLink>& placed, const Vector3d& start, double lowest, double reach,
                std::vector<Interval>& intervals) {
  constexpr double kInsideStep = 1e-3;  // m
  constexpr double kLeastStep = 1e-4;
  intervals.clear();
  double z = start.z();
  const auto gapOf = [&](std::size_t k) {
    const Vector3d p(start.x(), start.y(), z);
    return placed[k].grid->lowerBound(placed[k].X_LG * p) - reach;
  };
  double freeDownTo = z;
  while (z > lowest) {
    double gap = kInfinity;
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < placed.size(); ++k) {
      const double g = gapOf(k);
      if (g < gap) {
        gap = g;
        nearest = k;
      }
    }
    if (gap > 0) {  // infinite: there is nothing in this column
      freeDownTo = z - gap;
      z -= std::max(gap, kLeastStep);
      continue;
    }
    const double top = std::max(freeDownTo, z);
    while (z > lowest && gapOf(nearest) <= 0) z -= kInsideStep;
    freeDownTo = z;
    if (!intervals.empty() && intervals.back().bottom - top < 2e-3) {
      intervals.back().bottom = z;  // one solid piece, or a gap too thin to matter
    } else {
      intervals.push_back({top, z, placed[nearest].link});
    }
  }
  while (intervals.size() > 2) {  // the thinnest gap closes
    std::size_t thinnest = 0;
    for (std::size_t i = 1; i + 1 < intervals.size(); ++i) {
      if (intervals[i].bottom - intervals[i + 1].top < intervals[thinnest].bottom - intervals[thinnest + 1].top)
        thinnest = i;
    }
    intervals[thinnest].bottom = intervals[thinnest + 1].bottom;
    intervals.erase(intervals.begin() + static_cast<std::ptrdiff_t>(thinnest) + 1);
  }
}

/// An interval as ColumnField holds it, never smaller or, with `inward`, never larger than it is.
std::int32_t packed(double bottom, double top, double unit, bool inward) {
  constexpr double kRounding = 0.02;  // units, of the products in single precision
  const double wider = inward ? -kRounding : kRounding;
  const double low = bottom / unit - wider, high = top / unit + wider;
  const auto first = static_cast<std::int32_t>(inward ? std::ceil(low) : std::floor(low));
  const auto last = static_cast<std::int32_t>(inward ? std::floor(high) : std::ceil(high));
  if (first > last) return ColumnField::kNone;
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(last) << 16 |
                                   (static_cast<std::uint32_t>(first) & 0xFFFF));
}

/// What `packed` made of them; bottom > top: no interval.
std::pair<double, double> unpacked(std::int32_t interval, double unit) {
  return {static_cast<std::int16_t>(interval & 0xFFFF) * unit, (interval >> 16) * unit};
}

/// The intervals of z above each column that lie inside a link for every point of the cell. `outer`: the same columns,
/// with what may be covered.
ColumnField innerColumns(const HandFields& fields, const PreshapeFields& preshape, const ColumnField& outer,
                         const std::atomic<bool>* cancel) {
  constexpr double kWalkStep = 1e-3;  // m
  ColumnField field = outer;
  const auto& lattice = outer.intervals;
  const double radius = std::sqrt(0.5) * lattice.step + 0.5 * kWalkStep;
  const auto isInside = [&](const Vector3d& p) {
    return std::any_of(fields.links.begin(), fields.links.end(), [&](int link) {
      return fields.grids[link]->closed && fields.grids[link]->upperBound(preshape.X_LG[link] * p) + radius <= 0;
    });
  };
  for (int y = 0; y < lattice.size[1]; ++y) {
    throwIfCancelled(cancel);
    for (int x = 0; x < lattice.size[0]; ++x) {
      const std::size_t i = lattice.index(x, y, 0);
      std::vector<std::pair<double, double>> runs;  // bottom, top
      for (int k = 0; k < 2; ++k) {
        const auto [lowest, highest] = unpacked(lattice.value[i][k], outer.unit);
        bool inside = false;
        for (double z = highest; z >= lowest; z -= kWalkStep) {
          const Vector3d node = lattice.node(x, y, 0);
          const bool now = isInside({node.x(), node.y(), z});
          if (now && !inside) runs.emplace_back(z, z);
          if (now) runs.back().first = z;
          inside = now;
        }
      }
      std::sort(runs.begin(), runs.end(),
                [](const auto& a, const auto& b) { return a.second - a.first > b.second - b.first; });
      for (std::size_t k = 0; k < 2; ++k) {
        field.intervals.value[i][k] =
            k < runs.size() ? packed(runs[k].first, runs[k].second, field.unit, true) : ColumnField::kNone;
      }
    }
  }
  return field;
}

bool nearlyEqual(const Isometry3d& a, const Isometry3d& b) {
  return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff() < 1e-9;
}

/// Do two motions move equal shapes in the same way, up to rounding?
bool moveAlike(const HandFields& fields, const Motion& a, const Motion& b) {
  const auto sameNode = [](const MotionNode& m, const MotionNode& n) {
    return m.parent == n.parent && m.turns == n.turns && nearlyEqual(m.X_NP, n.X_NP) && m.offset == n.offset &&
           m.rate == n.rate && m.lower == n.lower && m.upper == n.upper;
  };
  const auto sameLeaf = [&](const MotionLeaf& m, const MotionLeaf& n) {
    return m.node == n.node && fields.grids[m.link] == fields.grids[n.link] && nearlyEqual(m.X_LN, n.X_LN);
  };
  return a.range == b.range && std::equal(a.nodes.begin(), a.nodes.end(), b.nodes.begin(), b.nodes.end(), sameNode) &&
         std::equal(a.leaves.begin(), a.leaves.end(), b.leaves.begin(), b.leaves.end(), sameLeaf);
}

ColumnField columnField(const HandFields& fields, const PreshapeFields& preshape, double step, double blockRadius,
                        const std::atomic<bool>* cancel) {
  constexpr double kMostUnits = 32000;  // of the 32767 that fit
  constexpr double kBeyondBox = 2e-3;   // m, that an interval may end below it
  const double reach = std::sqrt(0.5) * step + blockRadius + 1e-5;
  std::vector<PlacedLink> placed;
  AlignedBox3d box;
  for (const int link : fields.links) {
    const LinkGrid& grid = *fields.grids[link];
    const Vector3d c = preshape.X_LG[link].inverse() * grid.center;
    placed.push_back({link, &grid, preshape.X_LG[link], c});
    box.extend(Vector3d(c.array() - grid.radius - reach)).extend(Vector3d(c.array() + grid.radius + reach));
  }
  ColumnField field;
  const double farthest = std::max(std::abs(box.min().z()), std::abs(box.max().z())) + kBeyondBox;
  field.unit = static_cast<float>(farthest / kMostUnits);
  auto& lattice = field.intervals;
  lattice.origin = box.min().cast<float>();
  lattice.origin.z() = 0;
  lattice.step = static_cast<float>(step);
  lattice.size = {static_cast<int>(std::ceil(box.sizes().x() / step)) + 1,
                  static_cast<int>(std::ceil(box.sizes().y() / step)) + 1, 1};
  const std::size_t count = lattice.index(0, 0, 1);
  lattice.value.assign(count, {ColumnField::kNone, ColumnField::kNone});
  for (auto& links : field.link) links.assign(count, 0);
  std::vector<PlacedLink> around;
  std::vector<Interval> intervals;
  for (int y = 0; y < lattice.size[1]; ++y) {
    throwIfCancelled(cancel);
    for (int x = 0; x < lattice.size[0]; ++x) {
      Vector3d start = lattice.node(x, y, 0);
      around.clear();
      for (const PlacedLink& link : placed) {
        if ((link.center - start).head<2>().norm() <= link.grid->radius + reach) around.push_back(link);
      }
      start.z() = box.max().z();
      walkColumn(around, start, box.min().z(), reach, intervals);
      for (std::size_t k = 0; k < intervals.size(); ++k) {
        const std::size_t i = lattice.index(x, y, 0);
        lattice.value[i][k] = packed(intervals[k].bottom, intervals[k].top, field.unit, false);
        field.link[k][i] = static_cast<std::uint8_t>(intervals[k].link);
      }
    }
  }
  return field;
}

}  // namespace

Placement Placement::of(const Isometry3d& X) {
  Placement p{};
  for (int i = 0; i < 9; ++i) p.rotation[i] = static_cast<float>(X.linear()(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) p.translation[i] = static_cast<float>(X.translation()[i]);
  return p;
}

HandFields::HandFields(const Hand& hand, const JobSystem& jobs, const std::atomic<bool>* cancel)
    : links(solidLinks(hand)), grids(hand.links.size()), covers(hand.links.size()), models(hand) {
  makeGrids(hand, jobs, cancel);
  for (const ClosingJoint& closing : hand.closing) steps.push_back(makeClosingStep(hand, closing));
  std::vector<const Eigen::VectorXd*> posture;  // of each motion: that of the first preshape with it
  for (const Preshape& shape : hand.preshapes) {
    addPreshape(hand, shape);
    posture.resize(motions.size(), &shape.jointPosition);
  }

  // The tables, each of which stands alone; a motion like an earlier one takes over that one's.
  std::vector<std::size_t> like(motions.size());
  std::vector<std::function<void()>> tables;
  for (std::size_t i = 0; i < motions.size(); ++i) {
    Motion& motion = motions[i];
    like[i] = i;
    for (std::size_t k = 0; k < i && like[i] == i; ++k) {
      if (motion.mover && motions[k].mover && moveAlike(*this, motions[k], motion)) like[i] = like[k];
    }
    if (like[i] != i) continue;
    tables.emplace_back([this, &hand, &motion, q = posture[i], cancel] {
      std::vector<const LinkGrid*> moved;
      for (const MotionLeaf& leaf : motion.leaves) moved.push_back(grids[leaf.link].get());
      motion.field = std::make_shared<const FirstTouch>(firstTouchFields(moved, layOutPoses(hand, motion, *q), cancel));
    });
  }
  for (PreshapeFields& preshape : preshapes) {
    tables.emplace_back([this, &preshape, cancel] {
      preshape.fine = columnField(*this, preshape, kFineColumn, 0, cancel);
      preshape.inner = innerColumns(*this, preshape, preshape.fine, cancel);
    });
    tables.emplace_back([this, &preshape, cancel] {
      preshape.coarse = columnField(*this, preshape, kCoarseColumn, ObjectShell::kBlockRadius, cancel);
    });
  }
  jobs.run(tables.size(), 1, [&](int, std::size_t i) { tables[i](); });
  for (std::size_t i = 0; i < motions.size(); ++i) motions[i].field = motions[like[i]].field;
}

void HandFields::makeGrids(const Hand& hand, const JobSystem& jobs, const std::atomic<bool>* cancel) {
  std::vector<int> like(hand.links.size());  // the first link of equal shape
  for (const int link : links) {
    const TriangleMesh& mesh = hand.links[link].mesh;
    like[link] = *std::find_if(links.begin(), links.end(), [&](int other) {
      const TriangleMesh& earlier = hand.links[other].mesh;
      return earlier.triangles == mesh.triangles && earlier.vertices == mesh.vertices;
    });
  }
  jobs.run(links.size(), 1, [&](int, std::size_t i) {
    const int link = links[i];
    throwIfCancelled(cancel);
    covers[link] = coverSurface(hand.links[link].mesh);
    if (like[link] == link) grids[link] = std::make_shared<const LinkGrid>(hand.links[link].mesh, cancel);
  });
  for (const int link : links) grids[link] = grids[like[link]];
}

int HandFields::addMotion(Motion motion, const Eigen::VectorXd& q) {
  for (auto& [joint, position] : motion.heldJoints) position = q[joint];
  for (std::size_t i = 0; i < motions.size(); ++i) {  // the same in another preshape
    const Motion& old = motions[i];
    const bool sameMover =
        old.mover.has_value() == motion.mover.has_value() &&
        (!old.mover || (old.mover->joint == motion.mover->joint && old.mover->followers == motion.mover->followers &&
                        old.mover->links == motion.mover->links));
    if (sameMover && old.start == motion.start && old.direction == motion.direction &&
        old.heldJoints == motion.heldJoints && old.slideAxis == motion.slideAxis) {
      return static_cast<int>(i);
    }
  }
  motions.push_back(std::move(motion));
  return static_cast<int>(motions.size() - 1);
}

void HandFields::addPreshape(const Hand& hand, const Preshape& shape) {
  const Eigen::VectorXd& q = shape.jointPosition;
  PreshapeFields preshape;
  preshape.X_HL = forwardKinematics(hand, q);
  preshape.X_GH = (preshape.X_HL[hand.palmLink] * hand.X_LG).inverse();
  for (const Isometry3d& X_HL : preshape.X_HL) {
    preshape.X_LG.push_back((preshape.X_GH * X_HL).inverse());
    preshape.fromPalm.push_back(Placement::of(preshape.X_LG.back()));
  }
  preshape.partPoints = partPoints(hand, preshape.X_HL);
  preshape.apart = models.apart(pairsThatMove(hand), preshape.X_HL);
  for (const ClosingStep& step : steps) {
    PreshapeFields::Step s;
    const auto addPart = [&](ClosingPart part, bool overWholeRange) {
      s.motion[static_cast<std::size_t>(part)] = addMotion(makeMotion(hand, step.mover(part), q, overWholeRange), q);
    };
    addPart(ClosingPart::together, false);
    if (step.selfCentering && step.fixedLinks.empty()) {
      addPart(ClosingPart::alone, false);
      addPart(ClosingPart::follower, false);
    } else if (step.selfCentering) {
      const Vector3d axis = -(preshape.X_HL[hand.palmLink].linear() * hand.X_LG.linear().col(0));
      s.counterpart = addMotion(makeSlide(hand, step.fixedLinks, axis, preshape.X_HL), q);
    }
    if (step.breakaway.joint >= 0) addPart(ClosingPart::breakaway, true);
    preshape.steps.push_back(s);
  }
  preshapes.push_back(std::move(preshape));
}

}  // namespace handhold
