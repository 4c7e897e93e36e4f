#pragma once

#include "mesh/mass_properties.h"
#include "mesh/triangle_mesh.h"

#include <atomic>
#include <string>
#include <vector>

namespace handhold {

/// An object ready for grasping: its surface in the object frame O [m], and what was done to it on loading.
struct ObjectModel {
  TriangleMesh mesh;  // welded, no degenerate triangle, outward where that has a meaning
  bool watertight = false;
  MassProperties mass;
  std::vector<std::string> notes;     // what was repaired or reported, a sentence each
  std::vector<std::string> warnings;  // what a person should look at
};

/// How a mesh file's numbers become metres.
struct MeshUnit {
  double scale = 1.0;      // metres per unit of the file
  bool written = false;    // false: the user named no unit; then a diagonal outside 5 mm .. 2 m is refused
  std::string text = "m";  // as the user wrote it, for messages
};

class YamlValue;
/// The keys unit (m, cm, mm or in) and scale of a job's or scene's entry; at most one is written.
/// @throws InputError  naming file, line and key
MeshUnit readMeshUnit(const YamlValue& entry);

/// Limits for the child process that runs the third-party importer.
struct ImportLimits {
  double seconds = 60;
  std::size_t bytes = std::size_t{4} << 30;
  std::size_t triangles = 4'000'000;
  const std::atomic<bool>* cancel = nullptr;  // when it becomes true the child is ended within a tenth of a second
};

/// Reads a mesh file in a child process (so that a crash or hang of the importer is one failed item), turns it into
/// metres in the file's own frame (scene graph applied, axes and origin untouched), then welds, drops degenerate and
/// repeated triangles, orients and measures it.
/// @throws InputError  `PATH: ...` unreadable, empty, truncated, not finite, index out of range, no area, wrong size
/// @note   Safe from many threads.
ObjectModel loadObject(const std::string& path, const MeshUnit& unit, const ImportLimits& limits = {});

/// The triangles of a hand's or obstacle's mesh file: the same reader and checks, `scale` per axis, nothing oriented
/// or refused for its size.
TriangleMesh loadMesh(const std::string& path, const Eigen::Vector3d& scale, const ImportLimits& limits = {});

/// The second half of loadObject: repair and measure triangles that are already in memory. `name` begins messages.
ObjectModel repairObject(TriangleMesh mesh, const MeshUnit& unit, const std::string& name);

}  // namespace handhold
