// The exact search's kernel against triangles that are moved and tested one place after the other, and the instruction
// sets against each other.
#include "simulate/fast_kernels.h"

#include "core/random.h"
#include "mesh/primitives.h"
#include "simulate/contacts_reference.h"
#include "simulate/triangle_pairs.h"
#include "support/brute_force.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/targets.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
using kernels::kGroup;
using testing::trianglesCross;

/// The instruction sets of fast_kernels.cpp; plain code is what the compiler's own flags give.
constexpr std::int64_t kPlain = HWY_STATIC_TARGET, kNarrow = HWY_AVX2, kWide = HWY_AVX3;

bool hasBoth() { return (hwy::SupportedTargets() & kNarrow) != 0 && (hwy::SupportedTargets() & kWide) != 0; }

/// While it lives, kernels run on these instruction sets alone.
class OnTarget {
 public:
  explicit OnTarget(std::int64_t target) { hwy::SetSupportedTargetsForTest(target); }
  ~OnTarget() { hwy::SetSupportedTargetsForTest(0); }
  OnTarget(const OnTarget&) = delete;
  OnTarget& operator=(const OnTarget&) = delete;
};

/// Triangle `a` moves by tau times `velocity`, `b` stands still.
struct Case {
  Corners a, b;
  Vector3d velocity;
};

struct Interval {
  float enter, leave;
  bool isEmpty() const { return enter > leave; }
};

Vector3d toFloat(const Vector3d& p) { return p.cast<float>().cast<double>(); }
Corners toFloat(Corners t) {
  for (Vector3d& p : t) p = toFloat(p);
  return t;
}

Case makeCase(const Corners& a, const Corners& b, const Vector3d& velocity) {
  return {toFloat(a), toFloat(b), toFloat(velocity)};
}

/// All cases in one call.
std::vector<Interval> touchIntervals(const std::vector<Case>& cases) {
  TriangleMesh link;
  kernels::NearTriangles near;
  const std::size_t full = (cases.size() + kGroup - 1) / kGroup * kGroup;
  near.record.resize(full);
  kernels::Pairs pairs;
  pairs.count = cases.size();
  pairs.a.assign(full, 0);
  pairs.b.assign(full, 0);
  pairs.enter.assign(full, 0);
  pairs.leave.assign(full, 0);
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const auto& [a, b, velocity] = cases[i];
    const auto first = static_cast<std::uint32_t>(link.vertices.size());
    link.vertices.insert(link.vertices.end(), b.begin(), b.end());
    link.triangles.push_back({first, first + 1, first + 2});
    const Vector3d normal = (a[1] - a[0]).cross(a[2] - a[0]).normalized();
    for (int k = 0; k < 3; ++k) {
      for (int corner = 0; corner < 3; ++corner)
        near.record[i].value[3 * corner + k] = static_cast<float>(a[corner][k]);
      near.record[i].value[9 + k] = static_cast<float>(normal[k]);
      near.record[i].value[12 + k] = static_cast<float>(velocity[k]);
    }
    near.id.push_back(static_cast<std::uint32_t>(i));
  }
  const LinkGrid grid(link);
  for (std::uint32_t i = 0; i < cases.size(); ++i) {  // the grid orders its triangles
    pairs.a[i] = grid.source[i];
    pairs.b[i] = i;
  }
  kernels::touchIntervals(grid, near, pairs.count, pairs);
  std::vector<Interval> result(cases.size());
  for (std::size_t i = 0; i < cases.size(); ++i) result[pairs.a[i]] = {pairs.enter[i], pairs.leave[i]};
  return result;
}

Interval touchInterval(const Corners& a, const Corners& b, const Vector3d& velocity) {
  return touchIntervals({makeCase(a, b, velocity)})[0];
}

bool meetAt(const Case& c, double tau) {
  Corners a = c.a;
  for (Vector3d& p : a) p += tau * c.velocity;
  return trianglesCross(a, c.b);
}

constexpr double kFarthest = 0.04, kSampling = 2e-4;  // of tau

/// The interval of tau in double precision: triangles are convex, so it is one. Nothing: none of the samples meets.
std::optional<std::pair<double, double>> sampledInterval(const Case& c) {
  const int steps = static_cast<int>(2 * kFarthest / kSampling);
  const auto at = [&](int i) { return -kFarthest + i * kSampling; };
  const auto bisect = [&](double apart, double meets) {
    for (int i = 0; i < 40; ++i) {
      const double middle = 0.5 * (apart + meets);
      (meetAt(c, middle) ? meets : apart) = middle;
    }
    return meets;
  };
  int first = 0, last = steps;
  while (first <= steps && !meetAt(c, at(first))) ++first;
  if (first > steps) return std::nullopt;
  while (!meetAt(c, at(last))) --last;
  return std::pair(bisect(at(first - 1), at(first)), bisect(at(last + 1), at(last)));
}

Vector3d randomVector(const RandomStream& stream, int at) {
  return 2 * Vector3d(stream.uniform(at), stream.uniform(at + 1), stream.uniform(at + 2)) - Vector3d::Ones();
}

/// Triangles of up to `size` [m] up to 15 mm apart, one moving roughly towards the other at about 1 m per tau.
std::vector<Case> randomCases(int count, double size) {
  std::vector<Case> cases;
  for (int i = 0; i < count; ++i) {
    const RandomStream stream = RandomStream(17).child(i);
    const Vector3d from = 0.015 * randomVector(stream, 0), to = 0.005 * randomVector(stream, 3);
    Corners a, b;
    for (int k = 0; k < 3; ++k) {
      a[k] = from + size * randomVector(stream, 6 + 3 * k);
      b[k] = to + size * randomVector(stream, 15 + 3 * k);
    }
    const Vector3d aim = to + 0.5 * size * randomVector(stream, 24) - from;
    cases.push_back(
        makeCase(a, b, (stream.uniform(27) < 0.5 ? 1 : -1) * aim.normalized() * (0.5 + stream.uniform(28))));
  }
  return cases;
}

TEST(TouchIntervals, AgreeWithSampledMotion) {
  constexpr double kTolerance = 1e-5;
  for (const double size : {0.001, 0.004, 0.01}) {
    const std::vector<Case> cases = randomCases(400, size);
    const std::vector<Interval> intervals = touchIntervals(cases);
    int met = 0, apart = 0;
    for (std::size_t i = 0; i < cases.size(); ++i) {
      SCOPED_TRACE(::testing::Message() << "case " << i << " of triangles of " << size << " m");
      const auto reference = sampledInterval(cases[i]);
      const Interval found = intervals[i];
      if (!reference) {
        // What the samples missed must be shorter than their distance.
        if (found.isEmpty()) ++apart;
        const bool isBeyond = found.enter > kFarthest - kSampling || found.leave < -kFarthest + kSampling;
        EXPECT_TRUE(found.isEmpty() || isBeyond || found.leave - found.enter < 1.01 * kSampling)
            << found.enter << " .. " << found.leave;
        continue;
      }
      const auto [enter, leave] = *reference;
      if (enter <= -kFarthest || leave >= kFarthest || leave - enter < kSampling) continue;
      ++met;
      EXPECT_NEAR(found.enter, enter, kTolerance);
      EXPECT_NEAR(found.leave, leave, kTolerance);
    }
    EXPECT_GT(met, 40);
    EXPECT_GT(apart, 10);
  }
}

const Corners kFloor = {Vector3d(0, 0, 0), Vector3d(0.01, 0, 0), Vector3d(0, 0.008, 0)};
const Vector3d kDown = -Vector3d::UnitZ();
constexpr double kHeight = 0.003, kNear = 2e-7;

Corners shifted(Corners t, const Vector3d& by) {
  for (Vector3d& p : t) p += by;
  return t;
}

TEST(TouchIntervals, AVertexComesDownOnAFace) {
  const Vector3d tip(0.002, 0.003, kHeight);
  const Corners upright = {tip, tip + Vector3d(0.001, 0, 0.002), tip + Vector3d(-0.0005, 0.001, 0.004)};
  const Interval found = touchInterval(upright, kFloor, kDown);
  EXPECT_NEAR(found.enter, kHeight, kNear);
  EXPECT_NEAR(found.leave, kHeight + 0.004, kNear);
}

TEST(TouchIntervals, AFaceComesDownOnAVertex) {
  const Vector3d tip(0.002, 0.003, -kHeight);
  const Corners upright = {tip, tip + Vector3d(0.001, 0, -0.002), tip + Vector3d(-0.0005, 0.001, -0.004)};
  const Interval found = touchInterval(kFloor, upright, kDown);
  EXPECT_NEAR(found.enter, kHeight, kNear);
  EXPECT_NEAR(found.leave, kHeight + 0.004, kNear);
}

// Vertex on vertex: nothing may slip through where triangles end.
TEST(TouchIntervals, AVertexMeetsAVertex) {
  for (int corner = 0; corner < 3; ++corner) {
    const Vector3d tip = kFloor[corner] + Vector3d(0, 0, kHeight);
    const Corners upright = {tip, tip + Vector3d(0.001, 0.0003, 0.002), tip + Vector3d(-0.0005, 0.001, 0.004)};
    const Interval found = touchInterval(upright, kFloor, kDown);
    ASSERT_FALSE(found.isEmpty()) << "corner " << corner;
    EXPECT_NEAR(found.enter, kHeight, kNear);
  }
}

TEST(TouchIntervals, AVertexMeetsAnEdge) {
  for (int corner = 0; corner < 3; ++corner) {
    const Vector3d tip = 0.3 * kFloor[corner] + 0.7 * kFloor[(corner + 1) % 3] + Vector3d(0, 0, kHeight);
    const Corners upright = {tip, tip + Vector3d(0.001, 0.0003, 0.002), tip + Vector3d(-0.0005, 0.001, 0.004)};
    const Interval found = touchInterval(upright, kFloor, kDown);
    ASSERT_FALSE(found.isEmpty()) << "edge " << corner;
    EXPECT_NEAR(found.enter, kHeight, kNear);
  }
}

// Two edges cross at right angles, then at a small one.
TEST(TouchIntervals, AnEdgeMeetsAnEdge) {
  for (const double angle : {1.57, 0.3, 0.02}) {
    const Vector3d middle(0.004, 0, kHeight), along(std::cos(angle), std::sin(angle), 0);
    const Corners ridge = {middle - 0.003 * along, middle + 0.003 * along, middle + Vector3d(0, -0.001, 0.002)};
    const Corners wall = {Vector3d(0, 0, 0), Vector3d(0.008, 0, 0), Vector3d(0.003, 0.001, -0.004)};
    const Interval found = touchInterval(ridge, wall, kDown);
    ASSERT_FALSE(found.isEmpty()) << angle;
    EXPECT_NEAR(found.enter, kHeight, kNear) << angle;
  }
}

// Parallel edges that come down on each other, in part and at full length.
TEST(TouchIntervals, AnEdgeMeetsAParallelEdge) {
  const Corners wall = {Vector3d(0, 0, 0), Vector3d(0.008, 0, 0), Vector3d(0.003, 0.001, -0.004)};
  for (const auto& [from, to] : {std::pair(0.002, 0.005), std::pair(-0.002, 0.005), std::pair(0.0, 0.008),
                                 std::pair(-0.001, 0.009), std::pair(0.003, 0.012)}) {
    const Corners ridge = {Vector3d(from, 0, kHeight), Vector3d(to, 0, kHeight), Vector3d(0.003, -0.0005, 0.007)};
    const Interval found = touchInterval(ridge, wall, kDown);
    ASSERT_FALSE(found.isEmpty()) << from << " .. " << to;
    EXPECT_NEAR(found.enter, kHeight, kNear) << from << " .. " << to;
  }
}

// Parallel faces meet all at once: one within the other, in part, crossed without a corner inside, and equal.
TEST(TouchIntervals, AFaceMeetsAParallelFace) {
  const Vector3d up(0, 0, kHeight);
  const Corners small = {Vector3d(0.001, 0.001, 0), Vector3d(0.001, 0.003, 0), Vector3d(0.003, 0.001, 0)};
  const Corners large = {Vector3d(-0.01, -0.01, 0), Vector3d(-0.01, 0.03, 0), Vector3d(0.03, -0.01, 0)};
  const Corners star = {Vector3d(-0.001, 0.004, 0), Vector3d(0.008, 0.0043, 0), Vector3d(0.003, -0.003, 0)};
  const Corners beside = shifted(kFloor, {0.004, 0.001, 0});
  for (const Corners& face : {small, large, star, beside, kFloor}) {
    for (const Vector3d& velocity : {kDown, Vector3d(0.2, -0.1, -1)}) {
      const Interval found = touchInterval(shifted(face, up - kHeight * (velocity - kDown)), kFloor, velocity);
      ASSERT_FALSE(found.isEmpty());
      EXPECT_NEAR(found.enter, kHeight, kNear);
      EXPECT_NEAR(found.leave, kHeight, kNear);
    }
  }
}

TEST(TouchIntervals, PairsThatPassEachOtherNeverMeet) {
  const Corners high = shifted(kFloor, {0.001, 0.001, kHeight});
  EXPECT_TRUE(touchInterval(high, kFloor, Vector3d::UnitX()).isEmpty());  // slides above
  EXPECT_TRUE(touchInterval(high, kFloor, Vector3d(0.3, -1, 0)).isEmpty());
  EXPECT_TRUE(touchInterval(shifted(kFloor, {0.02, 0, kHeight}), kFloor, kDown).isEmpty());  // beside it
  EXPECT_TRUE(touchInterval(shifted(kFloor, {0.0051, 0.0041, kHeight}), kFloor, kDown).isEmpty());
  const Corners upright = {Vector3d(0, 0.01, 0), Vector3d(0.002, 0.011, 0.004), Vector3d(-0.002, 0.01, -0.003)};
  EXPECT_TRUE(touchInterval(upright, kFloor, Vector3d::UnitX()).isEmpty());
  EXPECT_FALSE(touchInterval(upright, kFloor, -Vector3d::UnitY()).isEmpty());
}

// What meets now and what met before have intervals that say so.
TEST(TouchIntervals, ReachBackInTime) {
  const Vector3d tip(0.002, 0.003, -0.001);
  const Corners through = {tip, tip + Vector3d(0.001, 0, 0.003), tip + Vector3d(-0.0005, 0.001, 0.004)};
  const Interval now = touchInterval(through, kFloor, kDown);
  EXPECT_NEAR(now.enter, -0.001, kNear);
  EXPECT_NEAR(now.leave, 0.003, kNear);
  const Interval before = touchInterval(shifted(through, {0, 0, -0.01}), kFloor, kDown);
  EXPECT_NEAR(before.enter, -0.011, kNear);
  EXPECT_NEAR(before.leave, -0.007, kNear);
}

// Each result depends on its own pair alone: not on how many there are nor on the place among them.
TEST(TouchIntervals, DependOnTheirOwnPairAlone) {
  std::vector<Case> cases = randomCases(37, 0.006);
  const std::vector<Interval> all = touchIntervals(cases);
  for (std::size_t i = 0; i < cases.size(); i += 5) {
    const Interval alone = touchIntervals({cases[i]})[0];
    EXPECT_EQ(alone.enter, all[i].enter);
    EXPECT_EQ(alone.leave, all[i].leave);
  }
  std::reverse(cases.begin(), cases.end());
  const std::vector<Interval> backwards = touchIntervals(cases);
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ(backwards[all.size() - 1 - i].enter, all[i].enter);
    EXPECT_EQ(backwards[all.size() - 1 - i].leave, all[i].leave);
  }
}

/// Random points around two tilted cylinders: their distances.
std::vector<float> someDistances(const LinkGrid& grid) {
  std::vector<kernels::PlacedGrid> placed;
  for (int i = 0; i < 2; ++i) {
    Eigen::Isometry3d X(Eigen::AngleAxisd(0.7 + i, Vector3d(1, 2, 3 - i).normalized()));
    X.translation() = Vector3d(0.004 * i, -0.01, 0.003);
    placed.push_back({&grid, Placement::of(X)});
  }
  std::vector<float> result;
  for (int group = 0; group < 40; ++group) {
    kernels::Points points{};
    for (int i = 0; i < kGroup; ++i) {
      const RandomStream stream = RandomStream(23).child(kGroup * group + i);
      const Vector3f p = (0.04 * randomVector(stream, 0)).cast<float>();
      points.x[i] = p.x(), points.y[i] = p.y(), points.z[i] = p.z();
    }
    alignas(64) float distance[kGroup];
    kernels::distances(placed, points, distance);
    result.insert(result.end(), distance, distance + kGroup);
  }
  return result;
}

/// An object and a link of many triangles each, triangle i of the one against triangle i of the other.
struct Facets {
  TriangleMesh object, link;
  Eigen::Isometry3d X_LO;
};

Facets randomFacets(testing::PairKind kind, int count) {
  const RandomStream stream = RandomStream(29).child(static_cast<std::uint64_t>(kind));
  Facets facets;
  facets.X_LO = Eigen::AngleAxisd(3 * stream.uniform(0), randomVector(stream, 1).normalized());
  facets.X_LO.translation() = 0.2 * randomVector(stream, 4);
  const auto add = [](const Corners& corners, TriangleMesh& mesh) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), corners.begin(), corners.end());
    mesh.triangles.push_back({first, first + 1, first + 2});
  };
  for (int i = 0; i < count; ++i) {
    auto [a, b] = testing::trianglePair(kind, static_cast<std::uint64_t>(i));
    for (Vector3d& p : a) p = facets.X_LO.inverse() * p;
    add(toFloat(a), facets.object);
    add(toFloat(b), facets.link);
  }
  return facets;
}

ObjectShell shellOf(const Facets& facets) {
  ObjectModel model;
  model.mesh = facets.object;
  return ObjectShell(model);
}

/// What keepClose leaves of each pair.
std::vector<FeaturePairs> closeFeatures(const Facets& facets, const ObjectShell& shell) {
  LinkGrid grid(cylinderMesh(0.012, 0.05));  // of which the kernel takes only what is put in here
  grid.radius = 0.2;
  grid.triangle.clear();
  kernels::WholePairs pairs;
  pairs.count = facets.link.triangles.size();
  for (auto* array : {&pairs.object, &pairs.link, &pairs.close}) array->assign(pairs.count + kGroup, 0);
  for (std::size_t i = 0; i < pairs.count; ++i) {
    const Corners corners = facets.link.corners(i);
    auto& value = grid.triangle.emplace_back().value;
    for (int k = 0; k < 9; ++k) value[k] = static_cast<float>(corners[k / 3][k % 3]);
    pairs.object[i] = pairs.link[i] = static_cast<std::uint32_t>(i);
  }
  const Placement placement = Placement::of(facets.X_LO * Eigen::Translation3d(shell.center));
  std::vector<FeaturePairs> close(pairs.count, 0);
  kernels::keepClose(grid, shell, placement, static_cast<float>(testing::kContactDistance), pairs);
  for (std::size_t i = 0; i < pairs.count; ++i) {
    EXPECT_EQ(pairs.object[i], pairs.link[i]);
    EXPECT_NE(pairs.close[i], 0U);
    close[pairs.object[i]] = pairs.close[i];
  }
  return close;
}

// What double precision finds within reach is never ruled out; most of the rest is.
TEST(KeepClose, RulesOutWhatIsFarAlone) {
  constexpr int kCount = 2001;
  for (int kind = 0; kind < static_cast<int>(testing::PairKind::count); ++kind) {
    const Facets facets = randomFacets(static_cast<testing::PairKind>(kind), kCount);
    const ObjectShell shell = shellOf(facets);
    for (const std::int64_t set : {kPlain, kNarrow, kWide}) {
      if ((hwy::SupportedTargets() & set) == 0) continue;
      SCOPED_TRACE(std::string(testing::kPairNames[kind]) + " on " + hwy::TargetName(set));
      const OnTarget target(set);
      const std::vector<FeaturePairs> close = closeFeatures(facets, shell);
      int within = 0, beyond = 0, keptBeyond = 0;
      for (std::size_t i = 0; i < close.size(); ++i) {
        Corners object = facets.object.corners(i);
        for (Vector3d& p : object) p = facets.X_LO * p;
        const auto measured = reference::closestPairs(object, facets.link.corners(i));
        for (std::size_t k = 0; k < measured.size(); ++k) {
          const bool isKept = (close[i] >> k & 1) != 0;
          const double gap = (measured[k].first - measured[k].second).norm();
          if (gap <= testing::kContactDistance) {
            ++within;
            EXPECT_TRUE(isKept) << "pair " << i << " feature " << k << " gap " << gap;
          } else if (gap > 1.5 * testing::kContactDistance) {
            ++beyond;
            keptBeyond += isKept;
          }
        }
      }
      EXPECT_GT(within, kCount / 100);
      EXPECT_LT(keptBeyond, beyond / 200);
    }
  }
}

// Points wait with their first touches and are asked for what is due, band after band, until one that ends the search.
TEST(TakeDue, GivesEachPointOnceInItsBandAndInOrder) {
  constexpr std::uint32_t kBand = 1000, kLast = 0xFFFE;
  const std::int64_t available = hwy::SupportedTargets();
  for (const std::int64_t target : {kPlain, kNarrow, kWide}) {
    if ((available & target) == 0) continue;
    const OnTarget only(target);
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
      SCOPED_TRACE("target " + std::to_string(target) + " seed " + std::to_string(seed));
      const RandomStream stream = RandomStream(31).child(seed);
      const std::size_t count = seed < 40 ? seed : 40 + static_cast<std::size_t>(200 * stream.uniform(0));
      const auto until = static_cast<std::uint32_t>((seed % 3 == 0 ? 1.0 : stream.uniform(1)) * kLast);
      std::vector<std::uint32_t> first;
      for (std::size_t i = 0; i < count; ++i)
        first.push_back(static_cast<std::uint32_t>(stream.uniform(2 + i) * kLast));
      std::vector<float> x, y, z;
      for (std::size_t i = 0; i < count; ++i) {
        x.push_back(static_cast<float>(i));
        y.push_back(static_cast<float>(i) + 0.25F);
        z.push_back(static_cast<float>(i) + 0.5F);
      }
      std::vector<std::uint32_t> wait = first, dueFirst(count + kGroup);
      wait.resize(count + kGroup, 0);  // what lies behind the last point is not one
      for (auto* array : {&x, &y, &z}) array->resize(count + kGroup);
      std::vector<float> dueX(count + kGroup), dueY(count + kGroup), dueZ(count + kGroup);
      kernels::WaitingPoints waiting = {x.data(), y.data(), z.data(), wait.data(), count};
      for (std::uint32_t end = kBand; end - kBand < 0x10000; end += kBand) {
        kernels::WaitingPoints due = {dueX.data(), dueY.data(), dueZ.data(), dueFirst.data(), 0};
        const std::uint32_t earliest = kernels::takeDue(end, until, waiting, due);
        std::vector<std::size_t> wanted;
        std::uint32_t next = until;
        for (std::size_t i = 0; i < count; ++i) {
          if (first[i] >= until) continue;
          if (first[i] >= end) next = std::min(next, first[i]);
          if (first[i] < end && first[i] >= end - kBand) wanted.push_back(i);
        }
        ASSERT_EQ(due.count, wanted.size());
        ASSERT_EQ(earliest, next);
        for (std::size_t k = 0; k < wanted.size(); ++k) {
          const std::size_t i = wanted[k];
          ASSERT_EQ(dueFirst[k], first[i]);
          ASSERT_EQ(Vector3f(dueX[k], dueY[k], dueZ[k]), Vector3f(x[i], y[i], z[i]));
        }
      }
    }
  }
}

TEST(InstructionSets, Avx2AndAvx512GiveEqualBits) {
  if (!hasBoth()) GTEST_SKIP() << "this machine does not have both AVX2 and AVX-512";
  const LinkGrid grid(cylinderMesh(0.012, 0.05));
  const std::vector<Case> cases = randomCases(500, 0.006);
  std::vector<float> distances[2];
  std::vector<Interval> intervals[2];
  const Facets facets = randomFacets(testing::PairKind::sliver, 500);
  const ObjectShell shell = shellOf(facets);
  std::vector<FeaturePairs> close[2];
  for (int i = 0; i < 2; ++i) {
    const OnTarget target(i == 0 ? kNarrow : kWide);
    distances[i] = someDistances(grid);
    intervals[i] = touchIntervals(cases);
    close[i] = closeFeatures(facets, shell);
  }
  EXPECT_EQ(distances[0], distances[1]);
  EXPECT_EQ(close[0], close[1]);
  for (std::size_t i = 0; i < cases.size(); ++i) {
    EXPECT_EQ(intervals[0][i].enter, intervals[1][i].enter) << i;
    EXPECT_EQ(intervals[0][i].leave, intervals[1][i].leave) << i;
  }
}

// Without fused multiply-add last bits differ. Speeds are about 1 m per tau, so tau is a length too.
TEST(InstructionSets, PlainCodeAgreesToAMicrometre) {
  constexpr float kMicrometre = 1e-6F;
  const LinkGrid grid(cylinderMesh(0.012, 0.05));
  const std::vector<Case> cases = randomCases(500, 0.006);
  const std::vector<float> widest = someDistances(grid);
  const std::vector<Interval> found = touchIntervals(cases);
  const OnTarget target(kPlain);
  const std::vector<float> plain = someDistances(grid);
  for (std::size_t i = 0; i < plain.size(); ++i) EXPECT_NEAR(plain[i], widest[i], kMicrometre) << i;
  const std::vector<Interval> plainly = touchIntervals(cases);
  EXPECT_TRUE(!hasBoth() || plain != widest) << "the same code ran twice";
  int compared = 0;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    // Pairs that barely graze each other may meet here and not there.
    if (found[i].leave - found[i].enter < 10 * kMicrometre && plainly[i].leave - plainly[i].enter < 10 * kMicrometre)
      continue;
    ++compared;
    EXPECT_NEAR(plainly[i].enter, found[i].enter, kMicrometre) << i;
    EXPECT_NEAR(plainly[i].leave, found[i].leave, kMicrometre) << i;
  }
  EXPECT_GT(compared, 100);
}

}  // namespace
}  // namespace handhold
