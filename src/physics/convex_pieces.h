#pragma once

#include "mesh/triangle_mesh.h"

#include <vector>

#include <Eigen/Core>

namespace handhold {

/// The corners of a convex body [m].
using ConvexPiece = std::vector<Eigen::Vector3d>;

/// A decomposition of a surface into convex pieces by HACD (Mamou, Ghorbel 2009), with a concavity of 2 % of its size:
/// an object's shape by another way than a grid of distances, for checks. Takes seconds.
std::vector<ConvexPiece> convexPieces(const TriangleMesh& mesh);

/// The connected pieces of a link, each taken as its convex hull: exact for boxes, cylinders and spheres.
std::vector<ConvexPiece> connectedHulls(const TriangleMesh& mesh);

}  // namespace handhold
