#pragma once

#include "mesh/triangle_mesh.h"

#include <cstddef>
#include <string>

namespace handhold {

/// What cleanMesh removed.
struct CleanCounts {
  std::size_t welded = 0;      // vertices that lay exactly on another
  std::size_t degenerate = 0;  // triangles without area
  std::size_t repeated = 0;    // triangles that were there already
};

/// Throws InputError, beginning with `name`, unless there are triangles, their indices exist and every coordinate is
/// finite.
void requireSound(const TriangleMesh& mesh, const std::string& name);

/// Rounds to 32-bit floats and welds equal positions. Drops triangles without area (where three different vertices lie
/// on a line, the neighbour across the longest edge takes over the middle one, which leaves the surface as it is and a
/// closed mesh closed), exact repetitions (the same triangle the other way round stays: a thin shell) and vertices
/// that no triangle uses. Throws InputError when a coordinate leaves the range of floats or nothing with an area is
/// left.
CleanCounts cleanMesh(TriangleMesh& mesh, const std::string& name);

}  // namespace handhold
