#pragma once

#include "hand/hand.h"
#include "mesh/triangle_mesh.h"

#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace handhold {

/// A JSON text that the scripts of a page find by its name.
struct PageData {
  std::string name, json;
};

/// A page of HTML that needs nothing else: style, scripts, three.js with its licence and the data are in it, nothing
/// is loaded from anywhere.
/// @param title  shown by the browser, plain text
/// @param data   the page shows what it finds: `sets` (report_sets.h) or `plan` (report_plan.h)
std::string assemblePage(const std::string& title, const std::vector<PageData>& data);

/// Bytes in base 64 (RFC 4648, with padding).
std::string base64(const void* bytes, std::size_t size);

/// Numbers as the pages read them: the type, a colon, the little-endian bytes in base 64.
template <class T>
std::string packed(std::span<const T> numbers) {
  static_assert(std::endian::native == std::endian::little);
  static_assert(std::is_same_v<T, float> || std::is_unsigned_v<T>);
  const char* type = std::is_same_v<T, float> ? "f4:" : sizeof(T) == 4 ? "u4:" : sizeof(T) == 2 ? "u2:" : "u1:";
  return type + base64(numbers.data(), numbers.size_bytes());
}
template <class T>
std::string packed(const std::vector<T>& numbers) {
  return packed(std::span<const T>(numbers));
}

/// A mesh as JSON: {"vertices", "triangles"}, packed; large ones as coarserMesh.
std::string meshJson(const TriangleMesh& mesh);

/// Links and joints of a hand as JSON, with all that poses of its links take (data.js).
std::string handJson(const Hand& hand);

/// A mesh that looks the same from afar, for drawing alone: vertices that share a cell of a grid become one, at their
/// mean, the grid as fine as `maxTriangles` allows. A mesh that has no more is returned as it is.
TriangleMesh coarserMesh(const TriangleMesh& mesh, std::size_t maxTriangles);

}  // namespace handhold
