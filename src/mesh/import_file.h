#pragma once

#include "mesh/object.h"
#include "mesh/triangle_mesh.h"

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

namespace handhold {

/// The work of the child process `handhold-import`, and what it sends to its parent over a pipe: an ImportHeader, then
/// 3 nVertices doubles, 3 nTriangles uint32, notesBytes of text (a line each). Same machine, native byte order.
struct ImportHeader {
  std::uint64_t magic = 0;
  std::uint64_t nVertices = 0;
  std::uint64_t nTriangles = 0;
  std::uint64_t notesBytes = 0;
};

constexpr std::uint64_t kImportMagic = 0x31306d70'6968'6868ULL;
constexpr std::size_t kMaxNotesBytes = std::size_t{64} << 10;

/// How the child ends. 1 is left out: sanitizers and runtimes use it for their own errors.
enum class ImportExit { good = 0, refused = 2, systemError = 3, outOfMemory = 4 };

/// What a file holds, in its own numbers: scene graph applied, axes and origin untouched, unit not applied.
struct ImportedMesh {
  TriangleMesh mesh;
  std::vector<std::string> notes;
};

/// Reads a mesh file in this process. First the file is checked for what assimp lets pass (truncation, counts,
/// indices).
/// @throws InputError  `PATH: ...`
/// @note   assimp can crash or hang on damaged files, and its log is one per process: call it in a process that may be
///         lost, one call at a time.
ImportedMesh importFile(const std::string& path, std::size_t maxTriangles);

/// importFile, written to `out` in the form above.
void importToStream(const std::string& path, std::size_t maxTriangles, std::ostream& out);

/// Limits memory and processor time of this process, and forbids core files.
void limitThisProcess(const ImportLimits& limits);

}  // namespace handhold
