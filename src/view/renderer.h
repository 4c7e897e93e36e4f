#pragma once

#include "mesh/triangle_mesh.h"

#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A picture: (height, width, 3) bytes, row-major, red green blue, sRGB, the top row first.
struct Image {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
};

/// A mesh in a picture. Colours are linear (not sRGB), 0 to 1.
struct ScenePart {
  TriangleMesh mesh;                                      // in its own frame
  Eigen::Isometry3d X_W = Eigen::Isometry3d::Identity();  // pose of that frame in the picture's world W
  Eigen::Vector3d colour = Eigen::Vector3d::Constant(0.5);
  bool isMark = false;  // marks shine through what hides them, and cast no shadow
};

/// The box around all parts, in W.
Eigen::AlignedBox3d boundingBox(const std::vector<ScenePart>& parts);

/// A pinhole camera: looks along -z of its frame C, +x right, +y up.
struct Camera {
  Eigen::Isometry3d X_WC = Eigen::Isometry3d::Identity();
  double tanHalfWidth = 0.25, tanHalfHeight = 0.25;  // of the field of view

  /// Unit direction in W through the image position (u, v), both from 0 to 1, u rightwards, v downwards.
  Eigen::Vector3d ray(double u, double v) const;
};

/// How a picture is taken.
struct RenderSettings {
  int width = 960, height = 720;
  int samplesPerSide = 3;    // rays of a pixel: 3 x 3
  int ambientRays = 6;       // for each of these rays
  int lightRays = 4;         // for each of these rays
  bool groundShadow = true;  // a soft shadow on a level floor below everything (W's -z is down)
};

/// The camera that sees all vertices of all parts as large as the frame allows with a margin.
///
/// A vertex (x, y, z) in a camera frame that is turned already and at (ex, ey, ez) is inside the frame's right and left
/// side when
///
///     |x - ex| <= tx (ez - z)   <=>   x + tx z <= ex + tx ez  and  -x + tx z <= -ex + tx ez (1)
///
/// so with R = max(x + tx z), L = max(-x + tx z) the nearest camera is ez = (R + L) / (2 tx), ex = (R - L) / 2; the
/// same for y, and the larger ez of the two.
///
/// @param toEye   direction from the scene to the camera, in W, not along z (W's +z is up in the picture)
/// @param aspect  width / height
Camera frameScene(const std::vector<ScenePart>& parts, const Eigen::Vector3d& toEye, double aspect);

/// Ray-cast picture: a key light from above the camera's left with a soft shadow, ambient light from the hemisphere
/// shadowed by what is near, a light background.
/// @note   Uses all cores; deterministic, equal for every number of threads.
Image render(const std::vector<ScenePart>& parts, const Camera& camera, const RenderSettings& settings = {});

/// Pictures side by side on white, row by row, `columns` in a row; each in the middle of a cell of the largest size.
Image composeGrid(const std::vector<Image>& images, int columns);

/// The number of columns that makes a grid of `count` pictures about as wide as a page: 1, 2, 3, 2 x 2, 3 x 2, ...
int gridColumns(std::size_t count);

}  // namespace handhold
