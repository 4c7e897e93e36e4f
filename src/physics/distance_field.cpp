#include "physics/distance_field.h"

#include "mesh/mass_properties.h"
#include "mesh/ray_scene.h"
#include "scene/surface_distance.h"

#include <limits>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kRoom = 2;  // spacings around the mesh

/// The closed pieces of which a mesh is the union; the whole mesh where it is none: an inner wall is a piece turned
/// inside out, and an open piece has no inside of its own.
std::vector<TriangleMesh> solidPieces(const TriangleMesh& mesh) {
  std::vector<TriangleMesh> pieces = splitPieces(mesh);
  const bool areSolid = std::all_of(pieces.begin(), pieces.end(), [](const TriangleMesh& piece) {
    return isWatertight(piece) && massProperties(piece, true).volume > 0;
  });
  return areSolid ? pieces : std::vector<TriangleMesh>{mesh};
}

}  // namespace

DistanceField::DistanceField(const TriangleMesh& mesh, double spacing) : spacing_(spacing) {
  const Eigen::AlignedBox3d box = boundingBox(mesh);
  Vector3d cells;
  for (;; spacing_ *= 1.1) {
    cells = (box.sizes() / spacing_).array().ceil() + 2 * kRoom;
    if ((cells.array() + 1).prod() <= kMostFieldNodes) break;
  }
  inverseSpacing_ = 1 / spacing_;
  count_ = cells.cast<int>() + Eigen::Vector3i::Ones();
  low_ = box.center() - spacing_ / 2 * cells;
  high_ = box.center() + spacing_ / 2 * cells;
  values_.assign(static_cast<std::size_t>(count_.cast<double>().prod()), std::numeric_limits<float>::infinity());
  for (const TriangleMesh& piece : solidPieces(mesh)) addPiece(piece);
}

/// Row by row: beyond the band a distance D is known to hold, less the way, for the nodes after it. The sign can only
/// change where the surface is less than a spacing away.
void DistanceField::addPiece(const TriangleMesh& piece) {
  const SurfaceDistance surface(piece);
  const RayScene rays(piece);
  std::uint32_t nearest = 0;
  std::size_t i = 0;
  for (int z = 0; z < count_.z(); ++z) {
    for (int y = 0; y < count_.y(); ++y) {
      double known = 0, sign = 1, last = 0;  // at the node before: a bound, its sign, the exact one
      for (int x = 0; x < count_.x(); ++x, ++i) {
        known -= spacing_;
        if (x == 0 || known < kFieldBand) {
          const Vector3d p = low_ + spacing_ * Vector3d(x, y, z);
          known = surface.from(nearest, p);
          if (x == 0 || std::min(last, known) < spacing_) sign = rays.contains(p) ? -1 : 1;
        }
        last = known;
        values_[i] = std::min(values_[i], static_cast<float>(sign * known));
      }
    }
  }
}

}  // namespace handhold
