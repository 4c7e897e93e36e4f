#pragma once

#include "mesh/triangle_mesh.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace handhold::test {

/// Writes `content` to a file of the test's own and returns its path.
inline std::string writeTemporary(const std::string& name, const std::string& content) {
  const auto* info = testing::UnitTest::GetInstance()->current_test_info();
  const std::string path =
      fmt::format("{}/{}-{}-{}-{}", testing::TempDir(), ::getpid(), info->test_suite_name(), info->name(), name);
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

template <typename Number>
std::string raw(Number number, bool bigEndian = false) {
  std::string bytes(sizeof number, '\0');
  std::memcpy(bytes.data(), &number, sizeof number);
  if (bigEndian != (std::endian::native == std::endian::big)) std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

inline std::string objText(const TriangleMesh& mesh) {
  std::string text = "mtllib missing.mtl\nusemtl gone\n";
  for (const auto& v : mesh.vertices) text += fmt::format("v {} {} {}\n", v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) text += fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  return text;
}

inline std::string offText(const TriangleMesh& mesh) {
  std::string text = fmt::format("OFF\n# made by a test\n{} {} 0\n", mesh.vertices.size(), mesh.triangles.size());
  for (const auto& v : mesh.vertices) text += fmt::format("{} {} {}\n", v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return text;
}

inline std::string stlText(const TriangleMesh& mesh) {
  std::string text = "solid thing\n";
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    text += "facet normal 0 0 0\n outer loop\n";
    for (const auto& v : mesh.corners(i)) text += fmt::format("  vertex {} {} {}\n", v.x(), v.y(), v.z());
    text += " endloop\nendfacet\n";
  }
  return text + "endsolid thing\n";
}

/// Its free text begins with "solid", as that of some programs does.
inline std::string stlBinary(const TriangleMesh& mesh) {
  std::string bytes = "solid but binary";
  bytes.resize(80, ' ');
  bytes += raw(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    bytes += std::string(12, '\0');
    for (const auto& v : mesh.corners(i)) {
      for (const double x : v) bytes += raw(static_cast<float>(x));
    }
    bytes += std::string(2, '\0');
  }
  return bytes;
}

inline std::string plyHeader(const TriangleMesh& mesh, const std::string& format) {
  return fmt::format(
      "ply\nformat {} 1.0\ncomment a test\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
      format, mesh.vertices.size(), mesh.triangles.size());
}

inline std::string plyText(const TriangleMesh& mesh) {
  std::string text = plyHeader(mesh, "ascii");
  for (const auto& v : mesh.vertices) text += fmt::format("{} {} {}\n", v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return text;
}

inline std::string plyBinary(const TriangleMesh& mesh, bool bigEndian) {
  std::string bytes = plyHeader(mesh, bigEndian ? "binary_big_endian" : "binary_little_endian");
  for (const auto& v : mesh.vertices) {
    for (const double x : v) bytes += raw(static_cast<float>(x), bigEndian);
  }
  for (const auto& t : mesh.triangles) {
    bytes += '\3';
    for (const auto index : t) bytes += raw(static_cast<std::int32_t>(index), bigEndian);
  }
  return bytes;
}

/// `nodes` is the JSON list of nodes; node 0 is the root, and the mesh has number 0.
inline std::string glbBinary(const TriangleMesh& mesh, const std::string& nodes) {
  std::string data;
  for (const auto& v : mesh.vertices) {
    for (const double x : v) data += raw(static_cast<float>(x));
  }
  const std::size_t split = data.size();
  for (const auto& t : mesh.triangles) {
    for (const auto index : t) data += raw(index);
  }
  std::string json = fmt::format(
      R"({{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":{},"buffers":[{{"byteLength":{}}}],)"
      R"("bufferViews":[{{"buffer":0,"byteLength":{}}},{{"buffer":0,"byteOffset":{},"byteLength":{}}}],)"
      R"("accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3"}},)"
      R"({{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}],)"
      R"("meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}]}})",
      nodes, data.size(), split, split, data.size() - split, mesh.vertices.size(), 3 * mesh.triangles.size());
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const auto size = [](std::size_t bytes) { return raw(static_cast<std::uint32_t>(bytes)); };
  return "glTF" + raw(std::uint32_t{2}) + size(28 + json.size() + data.size()) + size(json.size()) + "JSON" + json +
         size(data.size()) + std::string("BIN\0", 4) + data;
}

/// One object, without the animation part that holds a hierarchy.
inline std::string binary3ds(const TriangleMesh& mesh) {
  const auto chunk = [](std::uint16_t id, const std::string& content) {
    return raw(id) + raw(static_cast<std::uint32_t>(6 + content.size())) + content;
  };
  std::string vertices = raw(static_cast<std::uint16_t>(mesh.vertices.size()));
  for (const auto& v : mesh.vertices) {
    for (const double x : v) vertices += raw(static_cast<float>(x));
  }
  std::string faces = raw(static_cast<std::uint16_t>(mesh.triangles.size()));
  for (const auto& t : mesh.triangles) {
    for (const auto index : t) faces += raw(static_cast<std::uint16_t>(index));
    faces += raw(std::uint16_t{0});
  }
  const std::string object = std::string("thing\0", 6) + chunk(0x4100, chunk(0x4110, vertices) + chunk(0x4120, faces));
  return chunk(0x4d4d, chunk(0x3d3d, chunk(0x4000, object)));
}

/// `asset` holds unit and up axis, `transform` is inside the node.
inline std::string daeText(const TriangleMesh& mesh, const std::string& asset, const std::string& transform) {
  std::string positions;
  std::string indices;
  for (const auto& v : mesh.vertices) positions += fmt::format("{} {} {} ", v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) indices += fmt::format("{} {} {} ", t[0], t[1], t[2]);
  return fmt::format(
      R"(<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><!-- unit and axis -->{}</asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="{}">{}</float_array><technique_common>
<accessor source="#a" count="{}" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{}"><input semantic="VERTEX" source="#v" offset="0"/><p>{}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n">{}<instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
)",
      asset, 3 * mesh.vertices.size(), positions, mesh.vertices.size(), mesh.triangles.size(), indices, transform);
}

}  // namespace handhold::test
