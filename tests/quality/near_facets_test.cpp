#include "quality/near_facets.h"

#include "core/random.h"
#include "quality/references.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using polar::NearFacets;
using polar::NearMemory;
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// So many wrenches about the origin, at lengths from 0.5 to 1.5, each coordinate stretched by its own factor.
WrenchMatrix randomWrenches(int seed, int count) {
  const RandomStream stream(seed);
  WrenchMatrix w(6, count);
  for (int j = 0; j < count; ++j) {
    for (int k = 0; k < 6; ++k) w(k, j) = stream.normal(static_cast<std::uint64_t>(6 * j + k));
    w.col(j) *= (0.5 + stream.child(1).uniform(static_cast<std::uint64_t>(j))) / w.col(j).norm();
    for (int k = 0; k < 6; ++k) w(k, j) *= 1 + 0.3 * k;
  }
  return w;
}

/// The distance of the nearest facet of the hull, grown as the bounds of epsilon are, with or without forgetting.
double grown(const WrenchMatrix& w, bool forgets, NearMemory& memory, int& nBuilt) {
  const ForceClosureResult closure = testForceClosure(w);
  if (closure.verdict != ForceClosure::closed) return 0;
  const double radius = polar::wrenchRadius(w);
  NearFacets<2> polytope(memory, radius);
  polytope.start(polar::basisColumns(w, closure.basis), closure.interiorPoint);
  double upper = HUGE_VAL;
  while (polytope.nVertices() < w.cols() + 7) {
    const std::uint32_t nearest = polytope.nearest();
    if (nearest == polar::kNone) return std::nan("");
    const double distance = memory.distances[nearest];
    const Vector6 n = Eigen::Map<const Vector6>(memory.facets[nearest].normal.data()) / memory.norms[nearest];
    Eigen::Index farthest = 0;
    upper = std::min(upper, (n.transpose() * w).maxCoeff(&farthest));
    if (upper - distance <= 1e-12 * radius) {
      nBuilt += polytope.nBuilt();
      return polytope.planesHold() ? distance : std::nan("");
    }
    if (!polytope.insert(w.col(farthest).data(), forgets ? upper + 1e-12 * radius : 1e6)) return std::nan("");
  }
  return std::nan("");
}

// Whatever was forgotten on the way, the nearest facet is that of the hull.
TEST(NearFacets, EndAtTheNearestFacetOfTheHull) {
  NearMemory memory;
  int nClosed = 0, nNear = 0, nAll = 0;
  for (int seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const WrenchMatrix w = randomWrenches(seed, 14 + 2 * (seed % 20));
    const double epsilon = grown(w, true, memory, nNear);
    if (epsilon == 0) continue;
    ++nClosed;
    EXPECT_NEAR(epsilon, testing::qhullEpsilon(w), 1e-11);
    EXPECT_NEAR(epsilon, grown(w, false, memory, nAll), 1e-11);
  }
  EXPECT_GT(nClosed, 40);
  EXPECT_LT(3 * nNear, 2 * nAll) << "little is gained by forgetting";
}

// The memory of a call is no part of the next one's answer.
TEST(NearFacets, DoNotDependOnWhatCameBefore) {
  NearMemory used, fresh;
  int nBuilt = 0;
  for (int seed = 0; seed < 20; ++seed) grown(randomWrenches(seed, 40), false, used, nBuilt);
  for (int seed = 20; seed < 40; ++seed) {
    const WrenchMatrix w = randomWrenches(seed, 30);
    EXPECT_EQ(grown(w, true, used, nBuilt), grown(w, true, fresh, nBuilt)) << seed;
  }
}

}  // namespace
}  // namespace handhold
