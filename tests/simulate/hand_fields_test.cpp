// The tables of a hand against its links' meshes: what they rule out is never touched.
#include "simulate/hand_fields.h"

#include "core/random.h"
#include "hand/hand.h"
#include "mesh/ray_scene.h"
#include "support/toy_hands.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

/// A hand with its tables, and its links ready for rays.
struct TabledHand {
  explicit TabledHand(Hand h) : hand(std::move(h)), fields(hand, JobSystem(1), nullptr) {
    for (const Link& link : hand.links) scenes.emplace_back(link.mesh.triangles.empty() ? TriangleMesh() : link.mesh);
  }

  /// Does one of the links hold the point? `X_LP`: by link, from the frame of the point.
  bool isInside(const std::vector<int>& links, const std::vector<Isometry3d>& X_LP, const Vector3d& p) const {
    return std::any_of(links.begin(), links.end(), [&](int link) { return scenes[link].contains(X_LP[link] * p); });
  }

  Hand hand;
  HandFields fields;
  std::vector<RayScene> scenes;  // by link
};

const TabledHand& barrett() {
  static const TabledHand hand(loadHand(HANDHOLD_SOURCE_DIR "/hands/barrett"));
  return hand;
}
const TabledHand& jaw() {
  static const TabledHand hand(testing::makeJaw(false));
  return hand;
}

/// The node of the lattice whose cell (x, y, z) is in, and where in the lattice's box the i-th point is.
template <class T>
std::size_t nodeOf(const Lattice<T>& lattice, const Vector3d& p) {
  std::array<int, 3> at{};
  for (int k = 0; k < 3; ++k) at[k] = static_cast<int>(std::lround((p[k] - lattice.origin[k]) / lattice.step));
  return lattice.index(at[0], at[1], at[2]);
}
template <class T>
Vector3d pointIn(const Lattice<T>& lattice, const RandomStream& stream) {
  Vector3d p;
  for (int k = 0; k < 3; ++k) {
    p[k] = lattice.origin[k] + stream.uniform(static_cast<std::uint64_t>(k)) * (lattice.size[k] - 1) * lattice.step;
  }
  return p;
}

/// The centre of a block of points that p is one of: anywhere in its reach.
Vector3d blockCenter(const Vector3d& p, const RandomStream& stream) {
  const Vector3d way(stream.normal(4), stream.normal(5), stream.normal(6));
  return p + stream.uniform(20) * ObjectShell::kBlockRadius * way.normalized();
}

/// Is z in one of the column's intervals?
bool isCovered(const ColumnField& field, std::size_t node, double z) {
  for (const std::int32_t both : field.intervals.value[node]) {
    const std::int16_t bottom = static_cast<std::int16_t>(both & 0xFFFF), top = static_cast<std::int16_t>(both >> 16);
    if (bottom <= top && bottom * static_cast<double>(field.unit) <= z && z <= top * static_cast<double>(field.unit))
      return true;
  }
  return false;
}

void expectColumnsHold(const TabledHand& tabled) {
  constexpr std::uint64_t kPoints = 4000;
  std::size_t inside = 0, surelyCovered = 0;
  for (std::size_t preshape = 0; preshape < tabled.fields.preshapes.size(); ++preshape) {
    const PreshapeFields& fields = tabled.fields.preshapes[preshape];
    for (std::uint64_t i = 0; i < kPoints; ++i) {
      const RandomStream stream = RandomStream(11).child(preshape).child(i);
      Vector3d p = pointIn(fields.fine.intervals, stream);
      p.z() = -0.05 + 0.3 * stream.uniform(3);
      const std::size_t node = nodeOf(fields.fine.intervals, {p.x(), p.y(), 0});
      const bool isInside = tabled.isInside(tabled.fields.links, fields.X_LG, p);
      inside += isInside ? 1 : 0;
      if (isInside) {
        ASSERT_TRUE(isCovered(fields.fine, node, p.z())) << "preshape " << preshape << ", " << p.transpose();
        const Vector3d center = blockCenter(p, stream);
        const std::size_t of = nodeOf(fields.coarse.intervals, {center.x(), center.y(), 0});
        ASSERT_TRUE(isCovered(fields.coarse, of, center.z())) << "preshape " << preshape << ", " << p.transpose();
      }
      if (isCovered(fields.inner, node, p.z())) {
        ++surelyCovered;
        ASSERT_TRUE(isInside) << "preshape " << preshape << ", " << p.transpose();
      }
    }
  }
  EXPECT_GT(inside, 50U);
  EXPECT_GT(surelyCovered, inside / 10);
}

TEST(HandFields, ColumnsHoldWhatTheHandCovers) { expectColumnsHold(barrett()); }
TEST(HandFields, ColumnsHoldWhatAJawCovers) { expectColumnsHold(jaw()); }

/// The first and the last s at which a motion's links hold the point (in B), of those looked at.
std::optional<std::pair<double, double>> touchedBetween(const TabledHand& tabled, const Motion& motion,
                                                        Eigen::VectorXd q, const Vector3d& p) {
  constexpr int kSteps = 400;
  std::vector<int> links;
  for (const MotionLeaf& leaf : motion.leaves) links.push_back(leaf.link);
  std::optional<std::pair<double, double>> found;
  for (int i = 0; i <= kSteps; ++i) {
    const double s = motion.range * i / kSteps;
    place(tabled.hand, *motion.mover, motion.start + motion.direction * s, q);
    std::vector<Isometry3d> X_LB = forwardKinematics(tabled.hand, q);
    const Isometry3d X_HB = X_LB[motion.baseLink] * motion.X_BP.inverse();
    for (Isometry3d& X : X_LB) X = X.inverse() * X_HB;
    if (!tabled.isInside(links, X_LB, p)) continue;
    found = {found ? found->first : s, s};
  }
  return found;
}

void expectFirstTouchesHold(const TabledHand& tabled) {
  constexpr std::uint64_t kPoints = 600;
  std::size_t touched = 0;
  std::set<const FirstTouch*> seen;
  for (std::size_t k = 0; k < tabled.fields.preshapes.size(); ++k) {
    const Eigen::VectorXd& q = tabled.hand.preshapes[k].jointPosition;
    for (const PreshapeFields::Step& step : tabled.fields.preshapes[k].steps) {
      for (const int index : step.motion) {
        if (index < 0 || !seen.insert(tabled.fields.motions[index].field.get()).second) continue;
        const Motion& motion = tabled.fields.motions[index];
        const double unit = motion.range / Motion::kLastUnit;
        const Lattice<std::uint32_t>&fine = motion.field->fine, &coarse = motion.field->coarse;
        for (std::uint64_t i = 0; i < kPoints; ++i) {
          const RandomStream stream = RandomStream(12).child(static_cast<std::uint64_t>(index)).child(i);
          const Vector3d p = pointIn(fine, stream);
          const auto span = touchedBetween(tabled, motion, q, p);
          if (!span) continue;
          ++touched;
          const std::size_t ofBlock = nodeOf(coarse, blockCenter(p, stream));
          for (const std::uint32_t cell : {fine.value[nodeOf(fine, p)], coarse.value[ofBlock]}) {
            ASSERT_LE((cell & 0xFFFF) * unit, span->first + 1e-9) << "motion " << index << ", " << p.transpose();
            ASSERT_GE((cell >> 16) * unit, span->second - 1e-9) << "motion " << index << ", " << p.transpose();
          }
        }
      }
    }
  }
  EXPECT_GT(touched, 100U);
}

TEST(HandFields, FirstTouchesAreNeverLate) { expectFirstTouchesHold(barrett()); }
TEST(HandFields, FirstTouchesOfAJawAreNeverLate) { expectFirstTouchesHold(jaw()); }

}  // namespace
}  // namespace handhold
