#pragma once

#include "mesh/triangle_mesh.h"

#include <Eigen/Core>

namespace handhold {

/// Chord error of a hand's tessellated primitive: points of the true surface lie at most this far outside the triangles
/// [m].
inline constexpr double kChordError = 4e-5;

/// A box of full extents `size` [m], centred on the origin.
TriangleMesh boxMesh(const Eigen::Vector3d& size);
/// A cylinder about z, centred on the origin, vertices on the true surface [m].
TriangleMesh cylinderMesh(double radius, double length, double chordError = kChordError);
/// A sphere about the origin, vertices on the true surface [m].
TriangleMesh sphereMesh(double radius, double chordError = kChordError);

}  // namespace handhold
