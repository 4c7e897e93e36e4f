#pragma once

#include "physics/distance_field.h"

#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Points spread over a surface, in a tree of balls.
class SurfacePoints {
 public:
  struct Point {
    Eigen::Vector3d position, normal;  // normal: unit, outward
  };
  /// A ball around the points [begin, end); its children are the next node and `second`, a leaf has none (0).
  struct Ball {
    Eigen::Vector3d center;
    double radius;
    std::uint32_t begin, end, second;
  };

  SurfacePoints() = default;
  /// Corners, edges and faces of the mesh, about `pitch` [m] apart; points more than 0.2 mm inside `field` are left
  /// out: they are where two pieces overlap.
  SurfacePoints(const TriangleMesh& mesh, const DistanceField& field, double pitch);

  const std::vector<Point>& points() const { return points_; }
  const std::vector<Ball>& balls() const { return balls_; }

 private:
  void addBall(std::uint32_t begin, std::uint32_t end);

  std::vector<Point> points_;
  std::vector<Ball> balls_;
};

/// A body that collides: its inside as a field, its surface as points. Immutable; safe from many threads.
struct Solid {
  DistanceField field;
  SurfacePoints points;
  Eigen::AlignedBox3d box;  // of the mesh

  Solid(const TriangleMesh& mesh, double spacing, double pitch)
      : field(mesh, spacing), points(mesh, field, pitch), box(boundingBox(mesh)) {}
};

/// How far the field's surface is from the mesh [m], at the points of it.
struct SurfaceError {
  double p95 = 0, largest = 0;
};
SurfaceError surfaceError(const Solid& solid);

/// The solid of an object: 1 mm cells, 0.5 mm where a tenth of its walls are thinner than 2 mm.
Solid objectSolid(const TriangleMesh& mesh);
/// The solid of a link of a hand.
Solid linkSolid(const TriangleMesh& mesh);

/// A point where two solids touch or nearly do, in the frame of the first.
struct Touch {
  Eigen::Vector3d position;  // half way between the surfaces [m]
  Eigen::Vector3d normal;    // unit, from the first solid to the second
  double distance = 0;       // m, < 0: depth
};

/// Finds where two solids touch as they move. It remembers which of their points were close, and looks at those alone
/// until the solids have moved far enough for others to matter: what it finds does not depend on what it remembers.
/// @note  One a pair of solids and thread.
class TouchFinder {
 public:
  /// Every point of one surface less than `margin` from the other solid, both ways round: points of `b` in the field
  /// of `a`, with its gradient as the normal, and points of `a` in the field of `b`, with the opposite of its gradient
  /// (with a's own normal where that turns by more than 60 degrees: the inside of a sharp edge).
  /// @param X_AB     pose of b in the frame of a
  /// @param touches  emptied first; keeps its memory
  void find(const Solid& a, const Solid& b, const Eigen::Isometry3d& X_AB, double margin, std::vector<Touch>& touches);

 private:
  /// A point when it was collected: how far from the other solid [m].
  struct Close {
    SurfacePoints::Point point;
    double distance;
  };
  static double collect(const SurfacePoints& points, const DistanceField& field, const Eigen::Isometry3d& X_FP,
                        double reach, std::vector<Close>& close);

  Eigen::Isometry3d X_AB_ = Eigen::Isometry3d::Identity();  // when the points were collected
  double allowedMotion_ = -1;                               // m, of any point of b since
  std::vector<Close> closeOfA_, closeOfB_;
};

/// At most `count` of them, the first ones: the deepest, then again and again the one that stands out most from those
/// chosen, by place, direction and depth.
void keepSpread(std::vector<Touch>& touches, std::size_t count);

}  // namespace handhold
