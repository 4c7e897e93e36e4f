#include "scene/inside.h"

#include "mesh/ray_scene.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace handhold {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr int kCellsAlongLongest = 24;

}  // namespace

/// Cells of the mesh's box. Between two neighbours that no triangle touches there is no surface: they are on one side.
struct Inside::MeshCells {
  enum class State : unsigned char { unknown, touched, inside, outside };

  RayScene rays;
  Eigen::AlignedBox3d box;
  double edge = 0;  // m
  Vector3i count;
  std::vector<State> states;

  explicit MeshCells(const TriangleMesh& mesh) : rays(mesh), box(boundingBox(mesh)) {
    edge = box.sizes().maxCoeff() / kCellsAlongLongest;
    count = (box.sizes() / edge).array().ceil().cast<int>().max(1);
    states.assign(static_cast<std::size_t>(count.prod()), State::unknown);
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) touch(mesh.corners(i));
    forEachCell(Vector3i::Zero(), count - Vector3i::Ones(), [&](const Vector3i& cell) {
      if (states[index(cell)] == State::unknown) flood(cell);
    });
  }

  std::size_t index(const Vector3i& cell) const {
    return (static_cast<std::size_t>(cell.z()) * count.y() + cell.y()) * count.x() + cell.x();
  }
  Vector3i cellOf(const Vector3d& p) const {
    const Vector3i cell = ((p - box.min()) / edge).array().floor().cast<int>();
    return cell.cwiseMin(count - Vector3i::Ones()).cwiseMax(0);
  }

  template <typename Visit>
  static void forEachCell(const Vector3i& low, const Vector3i& high, Visit visit) {
    for (int z = low.z(); z <= high.z(); ++z) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int x = low.x(); x <= high.x(); ++x) visit(Vector3i(x, y, z));
      }
    }
  }

  /// All cells that the triangle's box meets.
  void touch(const std::array<Vector3d, 3>& t) {
    forEachCell(cellOf(t[0].cwiseMin(t[1]).cwiseMin(t[2])), cellOf(t[0].cwiseMax(t[1]).cwiseMax(t[2])),
                [&](const Vector3i& cell) { states[index(cell)] = State::touched; });
  }

  /// Gives a cell and all that it is connected with the side that its centre is on.
  void flood(const Vector3i& seed) {
    const Vector3d centre = box.min() + edge * (seed.cast<double>() + Vector3d::Constant(0.5));
    const State state = rays.contains(centre) ? State::inside : State::outside;
    std::vector<Vector3i> open = {seed};
    states[index(seed)] = state;
    while (!open.empty()) {
      const Vector3i cell = open.back();
      open.pop_back();
      for (int k = 0; k < 6; ++k) {
        Vector3i next = cell;
        next[k / 2] += k % 2 == 0 ? 1 : -1;
        if ((next.array() < 0).any() || (next.array() >= count.array()).any()) continue;
        if (states[index(next)] != State::unknown) continue;
        states[index(next)] = state;
        open.push_back(next);
      }
    }
  }

  bool contains(const Vector3d& p) const {
    if (!box.contains(p)) return false;
    const State state = states[index(cellOf(p))];
    return state == State::touched ? rays.contains(p) : state == State::inside;
  }
};

Inside::Inside(std::shared_ptr<const ObstacleShape> shape) : shape_(std::move(shape)) {
  if (const auto* cloud = std::get_if<ObstacleShape::Points>(&shape_->kind)) {
    cloud_ = std::make_unique<PointTree>(cloud->points);
  } else if (std::holds_alternative<ObstacleShape::Mesh>(shape_->kind) && shape_->watertight) {
    cells_ = std::make_unique<MeshCells>(shape_->mesh);
  }
}

Inside::~Inside() = default;

bool Inside::operator()(const Vector3d& p_S, double depth) const {
  struct Test {
    const Inside& self;
    const Vector3d& p;
    double depth;

    bool operator()(const ObstacleShape::Box& box) const {
      return (p.array().abs() < box.size.array() / 2 - depth).all();
    }
    bool operator()(const ObstacleShape::Cylinder& cylinder) const {
      return std::abs(p.z()) < cylinder.length / 2 - depth && p.head<2>().norm() < cylinder.radius - depth;
    }
    bool operator()(const ObstacleShape::Sphere& sphere) const { return p.norm() < sphere.radius - depth; }
    bool operator()(const ObstacleShape::Points& cloud) const {
      const double limit = cloud.radius - depth;
      return limit > 0 && self.cloud_->distance(p, limit) < limit;
    }
    bool operator()(const ObstacleShape::Mesh&) const { return self.cells_ != nullptr && self.cells_->contains(p); }
  };
  return std::visit(Test{*this, p_S, depth}, shape_->kind);
}

}  // namespace handhold
