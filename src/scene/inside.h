#pragma once

#include "scene/point_tree.h"
#include "scene/scene.h"

#include <memory>

namespace handhold {

/// Tells which points are inside a shape: in closed form where it has one, in a cloud inside one of its balls. A mesh
/// must be watertight, else nothing is inside: its box is divided into cells, those that no triangle touches are known
/// at once, and in the others RayScene::contains decides.
/// @note Immutable; safe from many threads.
class Inside {
 public:
  explicit Inside(std::shared_ptr<const ObstacleShape> shape);
  ~Inside();

  /// @param p_S    in the shape's frame [m]
  /// @param depth  points less deep than that count as outside [m]; meshes do not look at it
  bool operator()(const Eigen::Vector3d& p_S, double depth = 0) const;

 private:
  struct MeshCells;
  std::shared_ptr<const ObstacleShape> shape_;
  std::unique_ptr<PointTree> cloud_;
  std::unique_ptr<MeshCells> cells_;
};

}  // namespace handhold
