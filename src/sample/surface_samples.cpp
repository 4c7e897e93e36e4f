#include "sample/surface_samples.h"

#include "core/error.h"
#include "core/random.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kMaxRays = 2e7;
constexpr double kJitter = 0.05;                  // of the pitch: moves rays off vertices without changing the density
constexpr std::size_t kRaysWithoutHit = 100'000;  // towards the centre of mass, then the search ends
constexpr double kCountSlack = 1.02;              // a grid with at most 2 % more hits than wanted is good enough
constexpr std::uint64_t kGridKey = 71;            // any fixed number: the grid does not depend on the job's seed

/// One of the six grids: rays along -+ `axis`, rows along `v`, columns along `u`.
struct Grid {
  int axis, u, v;
  double sign;  // -1: the low side of the box, rays run towards +axis
  int columns, rows;
};

std::vector<Grid> makeGrids(const Eigen::AlignedBox3d& box, double pitch, const std::string& name) {
  const Vector3d extent = box.sizes();
  std::vector<Grid> grids;
  double rays = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    // A side without extent (a flat object seen from its edge) still gets one row.
    const double columns = std::max(1.0, std::ceil(extent[u] / pitch));
    const double rows = std::max(1.0, std::ceil(extent[v] / pitch));
    rays += 2 * columns * rows;
    if (rays > kMaxRays) {
      throw InputError(
          fmt::format("{}: pitch {:.3g} m needs more than {:.0g} rays, want a coarser pitch or fewer samples", name,
                      pitch, kMaxRays));
    }
    for (const double sign : {-1.0, 1.0}) {
      grids.push_back({axis, u, v, sign, static_cast<int>(columns), static_cast<int>(rows)});
    }
  }
  return grids;
}

/// Takes the hit if it is one: closed surfaces are seen from outside only, open ones from both sides.
void addHit(const ObjectModel& object, const RayScene& scene, const Vector3d& origin, const Vector3d& direction,
            const Vector3d* approach, SurfaceSamples& samples) {
  const RayHit hit = scene.cast(origin, direction);
  if (hit.missed()) return;
  Vector3d normal = object.mesh.normal(hit.triangle);
  if (normal.dot(direction) > 0) {
    if (object.watertight) {
      ++samples.backfaces;
      return;
    }
    normal = -normal;
  }
  samples.point.push_back((origin + hit.distance * direction).cast<float>());
  samples.normal.push_back(normal.cast<float>());
  samples.approach.push_back((approach != nullptr ? *approach : Vector3d(-normal)).cast<float>());
  samples.triangle.push_back(hit.triangle);
}

void castGrid(const ObjectModel& object, const RayScene& scene, const Eigen::AlignedBox3d& box, const Grid& grid,
              double pitch, std::uint64_t side, SurfaceSamples& samples) {
  const RandomStream stream = RandomStream(kGridKey).child(side);
  const double margin = 0.01 * box.diagonal().norm();
  const Vector3d center = box.center();
  // Not off the edge of a plate that is thinner than the jitter.
  const double jitterU = kJitter * std::min(1.0, box.sizes()[grid.u] / pitch);
  const double jitterV = kJitter * std::min(1.0, box.sizes()[grid.v] / pitch);
  Vector3d direction = Vector3d::Zero();
  direction[grid.axis] = -grid.sign;
  for (int row = 0; row < grid.rows; ++row) {
    const RandomStream rowStream = stream.child(row);
    for (int column = 0; column < grid.columns; ++column) {
      const double du = jitterU * (2 * rowStream.uniform(2 * column) - 1);
      const double dv = jitterV * (2 * rowStream.uniform(2 * column + 1) - 1);
      Vector3d origin;
      origin[grid.axis] = grid.sign < 0 ? box.min()[grid.axis] - margin : box.max()[grid.axis] + margin;
      origin[grid.u] = center[grid.u] + (column + 0.5 + du - 0.5 * grid.columns) * pitch;
      origin[grid.v] = center[grid.v] + (row + 0.5 + dv - 0.5 * grid.rows) * pitch;
      addHit(object, scene, origin, direction, nullptr, samples);
    }
  }
}

/// Keeps `count` of the samples, evenly spread over their order.
void thinOut(SurfaceSamples& samples, std::size_t count) {
  const std::size_t all = samples.size();
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t from = i * all / count;
    samples.point[i] = samples.point[from];
    samples.normal[i] = samples.normal[from];
    samples.approach[i] = samples.approach[from];
    samples.triangle[i] = samples.triangle[from];
  }
  samples.point.resize(count);
  samples.normal.resize(count);
  samples.approach.resize(count);
  samples.triangle.resize(count);
}

SurfaceSamples castAllGrids(const ObjectModel& object, const RayScene& scene, double pitch, const std::string& name) {
  const Eigen::AlignedBox3d box = boundingBox(object.mesh);
  SurfaceSamples samples;
  samples.pitch = pitch;
  std::uint64_t side = 0;
  for (const Grid& grid : makeGrids(box, pitch, name)) castGrid(object, scene, box, grid, pitch, side++, samples);
  return samples;
}

}  // namespace

SurfaceSamples sampleSurface(const ObjectModel& object, const RayScene& scene, double pitch, const std::string& name) {
  SurfaceSamples samples = castAllGrids(object, scene, pitch, name);
  if (samples.size() == 0) {
    throw InputError(fmt::format("{}: no ray of pitch {:.3g} m hits the object, want a finer pitch", name, pitch));
  }
  return samples;
}

SurfaceSamples sampleSurfaceCount(const ObjectModel& object, const RayScene& scene, std::size_t count,
                                  const std::string& name) {
  const Vector3d extent = boundingBox(object.mesh).sizes();
  const double sides = 2 * (extent.x() * extent.y() + extent.y() * extent.z() + extent.z() * extent.x());
  // With this pitch there are about `count` rays, so hardly more hits; then finer until there are enough.
  double coarse = std::sqrt(std::max(sides, 1e-12) / static_cast<double>(count));
  SurfaceSamples enough = castAllGrids(object, scene, coarse, name);
  double fine = coarse;
  while (enough.size() < count) {
    coarse = fine;
    fine /= 1.5;
    enough = castAllGrids(object, scene, fine, name);
  }
  for (int step = 0; step < 20 && static_cast<double>(enough.size()) > kCountSlack * static_cast<double>(count);
       ++step) {
    const double middle = std::sqrt(coarse * fine);
    SurfaceSamples trial = castAllGrids(object, scene, middle, name);
    if (trial.size() >= count) {
      fine = middle;
      enough = std::move(trial);
    } else {
      coarse = middle;
    }
  }
  thinOut(enough, count);
  return enough;
}

SurfaceSamples sampleSphere(const ObjectModel& object, const RayScene& scene, std::size_t count,
                            const std::string& name) {
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (std::size_t lattice = count; static_cast<double>(lattice) < kMaxRays;) {
    SurfaceSamples samples;
    for (std::size_t i = 0; i < lattice; ++i) {
      const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(lattice);
      const double r = std::sqrt(1 - z * z), angle = golden * static_cast<double>(i);
      const Vector3d outward(r * std::cos(angle), r * std::sin(angle), z);
      const Vector3d approach = -outward;
      addHit(object, scene, object.mass.centerOfMass + 1.5 * object.mass.radius * outward, approach, &approach,
             samples);
    }
    if (samples.size() >= count) {
      thinOut(samples, count);
      return samples;
    }
    if (samples.size() == 0 && lattice >= kRaysWithoutHit) break;
    const double hitShare = std::max(1e-3, static_cast<double>(samples.size()) / static_cast<double>(lattice));
    // At least half as many again, or a rarely hit object would be tried with the same lattice for ever.
    lattice =
        std::max(static_cast<std::size_t>(static_cast<double>(count) / hitShare * 1.1), lattice + lattice / 2) + 1;
  }
  throw InputError(
      fmt::format("{}: hardly any ray towards the centre of mass hits the object, want policy: surface_normal", name));
}

void findNeighbors(DistanceMapPoints& map, const std::vector<Eigen::Vector3f>& target,
                   const std::vector<Eigen::Vector3f>& targetNormal, int k) {
  constexpr float kSameSide = 0.5F;           // cosine of 60 degrees
  constexpr float kSmallestDistance = 1e-6F;  // m, a target that is a map point
  const std::size_t points = map.samples.size();
  map.neighborCount = static_cast<int>(std::min<std::size_t>(k, points));
  std::vector<std::pair<bool, float>> cost(points);  // every point of the same side comes before any other
  std::vector<std::uint32_t> order(points);
  for (std::size_t i = 0; i < target.size(); ++i) {
    for (std::size_t j = 0; j < points; ++j) {
      const bool otherSide = map.samples.normal[j].dot(targetNormal[i]) < kSameSide;
      cost[j] = {otherSide, (map.samples.point[j] - target[i]).squaredNorm()};
    }
    std::iota(order.begin(), order.end(), 0U);
    std::partial_sort(order.begin(), order.begin() + map.neighborCount, order.end(),
                      [&](auto a, auto b) { return cost[a] != cost[b] ? cost[a] < cost[b] : a < b; });
    float sum = 0;
    for (int n = 0; n < map.neighborCount; ++n) {
      const float distance = (map.samples.point[order[n]] - target[i]).norm();
      map.neighbor.push_back(order[n]);
      map.weight.push_back(1 / std::max(distance, kSmallestDistance));
      sum += map.weight.back();
    }
    for (int n = 0; n < map.neighborCount; ++n) map.weight[map.weight.size() - 1 - n] /= sum;
  }
}

}  // namespace handhold
