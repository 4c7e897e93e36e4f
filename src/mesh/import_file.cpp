#include "mesh/import_file.h"

#include "core/error.h"
#include "core/file.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <new>
#include <optional>
#include <ostream>
#include <string_view>

#include <assimp/DefaultLogger.hpp>
#include <assimp/Importer.hpp>
#include <assimp/LogStream.hpp>
#include <assimp/config.h>
#include <assimp/mesh.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSpaces = " \t\r\n\v\f";
constexpr std::size_t kMostReason = 160;  // letters
constexpr const char* kFormats = "obj, stl, ply, glb, gltf, dae, off, 3ds, fbx";

/// A refusal without its path, which importFile adds.
[[noreturn]] void refuse(const std::string& reason) { throw InputError(reason); }

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  return text;
}

// ---- Words and lines of a text in memory -----------------------------------------------------------------------

std::string_view trim(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(kSpaces);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kSpaces) - begin + 1);
}

/// Takes the next word off `text`; empty at the end.
std::string_view takeWord(std::string_view& text) {
  const std::size_t begin = std::min(text.find_first_not_of(kSpaces), text.size());
  const std::size_t end = std::min(text.find_first_of(kSpaces, begin), text.size());
  const std::string_view word = text.substr(begin, end - begin);
  text.remove_prefix(end);
  return word;
}

/// Takes the next line, without its end, off `text`.
std::string_view takeLine(std::string_view& text) {
  const std::size_t end = std::min(text.find('\n'), text.size());
  const std::string_view line = trim(text.substr(0, end));
  text.remove_prefix(std::min(end + 1, text.size()));
  return line;
}

/// The number that is all of `word`.
template <typename Number>
std::optional<Number> parse(std::string_view word) {
  if (!word.empty() && word[0] == '+') word.remove_prefix(1);
  Number number{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  // A double too small is a zero to us; one too large is left for the check of finiteness.
  const bool isWrong = std::is_integral_v<Number> ? error != std::errc() : error == std::errc::invalid_argument;
  if (isWrong || end != word.data() + word.size()) return std::nullopt;
  return number;
}

template <typename Number>
Number readRaw(std::string_view bytes, std::size_t offset, bool bigEndian = false) {
  unsigned char raw[sizeof(Number)];
  std::memcpy(raw, bytes.data() + offset, sizeof raw);
  if (bigEndian != (std::endian::native == std::endian::big)) std::reverse(std::begin(raw), std::end(raw));
  Number number;
  std::memcpy(&number, raw, sizeof raw);
  return number;
}

// ---- STL -------------------------------------------------------------------------------------------------------

void checkAsciiStl(std::string_view text) {
  std::size_t nCorners = 0;
  std::size_t nFacets = 0;
  std::string last;
  while (!text.empty()) {
    std::string_view line = takeLine(text);
    if (line.empty()) continue;
    last = lower(std::string(takeWord(line)));
    nCorners += last == "vertex" ? 1 : 0;
    nFacets += last == "endfacet" ? 1 : 0;
  }
  if (last != "endsolid")
    refuse(fmt::format("is truncated: an ASCII STL ends with \"endsolid\", this one with \"{}\"", last));
  if (nCorners != 3 * nFacets) {
    refuse(fmt::format("is damaged: {} vertices in {} facets, want 3 in each", nCorners, nFacets));
  }
}

void checkStl(std::string_view bytes) {
  constexpr std::size_t kHeader = 84;  // 80 of text, a count
  constexpr std::size_t kFacet = 50;
  const std::uint64_t count = bytes.size() < kHeader ? 0 : readRaw<std::uint32_t>(bytes, 80);
  const std::uint64_t wanted = kHeader + kFacet * count;
  if (bytes.size() >= kHeader && bytes.size() == wanted) return;
  // Some binary files begin with "solid" too, so it must also read like text.
  const std::string head = lower(std::string(trim(bytes.substr(0, 1024))));
  const bool isText =
      head.starts_with("solid") && head.find('\0') == std::string::npos &&
      (head.find("facet") != std::string::npos || head.find("endsolid") != std::string::npos || bytes.size() < kHeader);
  if (isText) return checkAsciiStl(bytes);
  if (bytes.size() < kHeader)
    refuse(fmt::format("is truncated: {} bytes, a binary STL has at least {}", bytes.size(), kHeader));
  refuse(fmt::format("is {}: {} bytes, want {} for the {} triangles of its header",
                     bytes.size() < wanted ? "truncated" : "damaged", bytes.size(), wanted, count));
}

// ---- PLY -------------------------------------------------------------------------------------------------------

struct PlyProperty {
  std::string name;
  std::string type;
  std::string countType;  // of a list; else empty
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  std::string format;
  std::vector<PlyElement> elements;
};

/// Bytes of a PLY scalar type; 0 when there is no such type.
std::size_t plyBytes(const std::string& type) {
  for (const auto& [names, bytes] : {std::pair{" char uchar int8 uint8 ", 1},
                                     {" short ushort int16 uint16 ", 2},
                                     {" int uint float int32 uint32 float32 ", 4},
                                     {" double float64 ", 8}}) {
    if (std::string_view(names).find(" " + type + " ") != std::string_view::npos)
      return static_cast<std::size_t>(bytes);
  }
  return 0;
}

PlyProperty plyProperty(std::string_view line) {
  PlyProperty property;
  const std::string_view all = trim(line);
  property.type = takeWord(line);
  if (property.type == "list") {
    property.countType = takeWord(line);
    property.type = takeWord(line);
  }
  property.name = takeWord(line);
  const bool known = plyBytes(property.type) > 0 && (property.countType.empty() || plyBytes(property.countType) > 0);
  if (!known || property.name.empty()) refuse(fmt::format("has an unknown property in its header: \"{}\"", all));
  return property;
}

/// Takes the header off `bytes`.
PlyHeader takePlyHeader(std::string_view& bytes) {
  PlyHeader header;
  if (takeLine(bytes) != "ply") refuse("does not begin with \"ply\"");
  while (true) {
    if (bytes.empty()) refuse("is truncated: its header has no end_header");
    std::string_view line = takeLine(bytes);
    const std::string_view key = takeWord(line);
    if (key == "end_header") break;
    if (key == "format") header.format = takeWord(line);
    if (key == "element") {
      PlyElement element;
      element.name = takeWord(line);
      const auto count = parse<std::uint64_t>(takeWord(line));
      if (!count) refuse(fmt::format("has no count for element \"{}\" in its header", element.name));
      element.count = *count;
      header.elements.push_back(std::move(element));
    }
    if (key == "property") {
      if (header.elements.empty()) refuse("has a property before any element in its header");
      header.elements.back().properties.push_back(plyProperty(line));
    }
  }
  if (header.format != "ascii" && header.format != "binary_little_endian" && header.format != "binary_big_endian") {
    refuse(fmt::format("has the format \"{}\", want ascii, binary_little_endian or binary_big_endian", header.format));
  }
  return header;
}

/// The data of a PLY file, one scalar after the other.
class PlyData {
 public:
  PlyData(std::string_view bytes, const std::string& format)
      : bytes_(bytes), ascii_(format == "ascii"), bigEndian_(format == "binary_big_endian") {}

  /// The next scalar, or nothing at the end of the file.
  std::optional<double> take(const std::string& type) {
    if (ascii_) {
      const std::string_view word = takeWord(bytes_);
      if (word.empty()) return std::nullopt;
      const auto number = parse<double>(word);
      if (!number) refuse(fmt::format("has \"{}\" in its data, want a number", word));
      return number;
    }
    const std::size_t size = plyBytes(type);
    if (bytes_.size() < size) return std::nullopt;
    const double number = binary(type, size);
    bytes_.remove_prefix(size);
    return number;
  }

 private:
  double binary(const std::string& type, std::size_t size) const {
    const bool isSigned = type[0] != 'u';
    if (size == 8) return readRaw<double>(bytes_, 0, bigEndian_);
    if (type[0] == 'f') return readRaw<float>(bytes_, 0, bigEndian_);
    if (size == 4 && isSigned) return readRaw<std::int32_t>(bytes_, 0, bigEndian_);
    if (size == 4) return readRaw<std::uint32_t>(bytes_, 0, bigEndian_);
    if (size == 2 && isSigned) return readRaw<std::int16_t>(bytes_, 0, bigEndian_);
    if (size == 2) return readRaw<std::uint16_t>(bytes_, 0, bigEndian_);
    return isSigned ? readRaw<std::int8_t>(bytes_, 0) : readRaw<std::uint8_t>(bytes_, 0);
  }

  std::string_view bytes_;
  bool ascii_;
  bool bigEndian_;
};

/// Reads one item of `element`; false when the data end before it does.
bool takePlyItem(PlyData& data, const PlyElement& element, std::uint64_t item, std::uint64_t nVertices) {
  for (const auto& property : element.properties) {
    double count = 1;
    const bool isList = !property.countType.empty();
    if (isList) {
      const auto length = data.take(property.countType);
      if (!length) return false;
      if (!(*length >= 0)) refuse(fmt::format("has a list of length {} in {} {}", *length, element.name, item));
      count = *length;
    }
    const bool isFace = isList && element.name == "face" && property.name.starts_with("vertex_ind");
    for (std::uint64_t k = 0; static_cast<double>(k) < count; ++k) {
      const auto value = data.take(property.type);
      if (!value) return false;
      if (isFace && !(*value >= 0 && *value < static_cast<double>(nVertices) && std::floor(*value) == *value)) {
        refuse(fmt::format("has vertex index {} in face {}, want 0 to {}", *value, item,
                           static_cast<double>(nVertices) - 1));
      }
    }
  }
  return true;
}

void checkPly(std::string_view bytes) {
  const PlyHeader header = takePlyHeader(bytes);
  PlyData data(bytes, header.format);
  std::uint64_t nVertices = 0;
  for (const auto& element : header.elements) nVertices += element.name == "vertex" ? element.count : 0;
  for (const auto& element : header.elements) {
    if (element.properties.empty()) continue;
    for (std::uint64_t item = 0; item < element.count; ++item) {
      if (takePlyItem(data, element, item, nVertices)) continue;
      refuse(fmt::format("is truncated: its header promises {} of element \"{}\", {} are there", element.count,
                         element.name, item));
    }
  }
}

// ---- OBJ -------------------------------------------------------------------------------------------------------

/// The faces so far: how many, the largest vertex index and where it was, since faces may name vertices that follow.
struct ObjFaces {
  std::size_t count = 0;
  std::int64_t largest = 0;
  std::size_t line = 0;
};

/// Appends the face to `reduced`, its vertices counted from 1.
void reduceObjFace(std::string_view words, std::size_t line, std::int64_t nVertices, ObjFaces& faces,
                   std::string& reduced) {
  std::size_t nCorners = 0;
  reduced += 'f';
  for (std::string_view word = takeWord(words); !word.empty() && word[0] != '#'; word = takeWord(words)) {
    const auto index = parse<std::int64_t>(word.substr(0, word.find('/')));
    if (!index || *index == 0 || *index < -nVertices) {
      refuse(fmt::format("line {}: vertex index \"{}\", want a whole number from 1, or from -{} to -1", line, word,
                         nVertices));
    }
    if (*index > faces.largest) {
      faces.largest = *index;
      faces.line = line;
    }
    reduced += fmt::format(" {}", *index > 0 ? *index : nVertices + 1 + *index);
    ++nCorners;
  }
  reduced += '\n';
  ++faces.count;
  if (nCorners < 3) refuse(fmt::format("line {}: a face with {} vertices, want 3 or more", line, nCorners));
}

/// Appends the vertex to `reduced`: three coordinates, and the weight if there are exactly four numbers (with six, the
/// rest is a colour).
void reduceObjVertex(std::string_view words, std::size_t line, std::string& reduced) {
  std::vector<std::string_view> numbers;
  for (std::string_view word = takeWord(words); !word.empty() && word[0] != '#'; word = takeWord(words)) {
    numbers.push_back(word);
  }
  numbers.resize(numbers.size() == 4 ? 4 : 3);
  reduced += 'v';
  for (std::string_view word : numbers) {
    if (!parse<double>(word)) refuse(fmt::format("line {}: coordinate \"{}\", want three numbers", line, word));
    if (word[0] == '+') word.remove_prefix(1);
    const bool negative = word[0] == '-';
    if (negative) word.remove_prefix(1);
    // assimp passes over a vertex with a number such as ".5".
    reduced += fmt::format(" {}{}{}", negative ? "-" : "", word[0] == '.' ? "0" : "", word);
  }
  reduced += '\n';
}

/// Takes the next line of an OBJ; a backslash continues it on the following one. Adds to `line` what it took.
std::string_view takeObjLine(std::string_view& text, std::size_t& line, std::string& joined) {
  ++line;
  std::string_view words = takeLine(text);
  if (!words.ends_with('\\')) return words;
  joined.clear();
  for (; words.ends_with('\\'); ++line, words = takeLine(text)) {
    joined += words.substr(0, words.size() - 1);
    joined += ' ';
  }
  joined += words;
  return joined;
}

/// Checks an OBJ, and reduces it to what is geometry: materials, normals and texture coordinates cannot matter then.
std::string reduceObj(std::string_view text) {
  std::string reduced;
  std::string joined;
  std::int64_t nVertices = 0;
  ObjFaces faces;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  for (std::size_t line = 0; !text.empty();) {
    const std::size_t first = line + 1;
    std::string_view words = takeObjLine(text, line, joined);
    const std::string_view key = takeWord(words);
    if (key == "v") {
      ++nVertices;
      reduceObjVertex(words, first, reduced);
    }
    if (key == "f") reduceObjFace(words, first, nVertices, faces, reduced);
  }
  if (faces.largest > nVertices) {
    refuse(fmt::format("line {}: vertex index {}, want at most {}, the number of vertices", faces.line, faces.largest,
                       nVertices));
  }
  if (faces.count == 0) refuse("has no triangles");
  return reduced;
}

// ---- OFF, GLB, 3DS ---------------------------------------------------------------------------------------------

void checkOff(std::string_view text) {
  std::vector<std::uint64_t> counts;  // vertices, faces, edges
  std::uint64_t nLines = 0;
  bool begun = false;
  while (!text.empty()) {
    std::string_view line = takeLine(text);
    line = trim(line.substr(0, line.find('#')));
    if (line.empty()) continue;
    if (counts.size() == 3) {
      ++nLines;
      continue;
    }
    for (std::string_view word = takeWord(line); !word.empty() && counts.size() < 3; word = takeWord(line)) {
      const auto number = parse<std::uint64_t>(word);
      if (!number && begun) refuse(fmt::format("has \"{}\" in its header, want three counts", word));
      if (number) counts.push_back(*number);
      begun = true;
    }
  }
  if (counts.size() < 3) refuse("is truncated: its header has no counts");
  if (nLines < counts[0] || nLines - counts[0] < counts[1]) {
    refuse(fmt::format("is truncated: {} lines of data, want {} vertices and {} faces", nLines, counts[0], counts[1]));
  }
}

void checkGlb(std::string_view bytes) {
  if (bytes.size() < 12 || !bytes.starts_with("glTF")) refuse("does not begin with the 12 bytes of a GLB header");
  const std::uint64_t length = readRaw<std::uint32_t>(bytes, 8);
  if (length > bytes.size())
    refuse(fmt::format("is truncated: {} bytes, its header promises {}", bytes.size(), length));
  if (readRaw<std::uint32_t>(bytes, 4) < 2) return;  // version 1 has no chunks
  for (std::uint64_t offset = 12; offset < length;) {
    const std::uint64_t chunk = offset + 8 <= length ? readRaw<std::uint32_t>(bytes, offset) : length;
    offset += 8 + chunk;
    if (offset > length) refuse(fmt::format("is truncated: a chunk ends at byte {}, the file at {}", offset, length));
  }
}

void check3ds(std::string_view bytes) {
  if (bytes.size() < 6 || readRaw<std::uint16_t>(bytes, 0) != 0x4d4d)
    refuse("does not begin with the main chunk of a 3DS");
  const std::uint64_t length = readRaw<std::uint32_t>(bytes, 2);
  if (length > bytes.size()) refuse(fmt::format("is truncated: {} bytes, its main chunk has {}", bytes.size(), length));
}

void checkContent(const std::string& extension, std::string_view bytes) {
  if (trim(bytes).empty()) refuse("is empty");
  if (extension == "stl") checkStl(bytes);
  if (extension == "ply") checkPly(bytes);
  if (extension == "off") checkOff(bytes);
  if (extension == "glb") checkGlb(bytes);
  if (extension == "3ds") check3ds(bytes);
}

// ---- COLLADA: up axis and unit are reported, not applied -------------------------------------------------------

/// The text between `begin` and the next `end`; empty when there is none.
std::string_view between(std::string_view text, std::string_view begin, char end) {
  const std::size_t at = text.find(begin);
  if (at == std::string_view::npos) return {};
  text.remove_prefix(at + begin.size());
  return trim(text.substr(0, text.find(end)));
}

/// assimp makes room for as many numbers as an attribute says, and drops the sign of a negative index.
void checkCollada(std::string_view text) {
  for (std::size_t at = text.find("count=\""); at != std::string_view::npos; at = text.find("count=\"", at + 1)) {
    const std::string_view count = between(text.substr(at), "count=\"", '"');
    if (parse<std::uint64_t>(count).value_or(text.size() + 1) <= text.size()) continue;
    refuse(fmt::format("has count=\"{}\" in {} bytes, want a whole number of what is there", count.substr(0, 40),
                       text.size()));
  }
  for (std::size_t at = text.find("<p>"); at != std::string_view::npos; at = text.find("<p>", at + 1)) {
    const std::string_view indices = between(text.substr(at), "<p>", '<');
    const std::size_t sign = indices.find('-');
    if (sign == std::string_view::npos) continue;
    std::string_view rest = indices.substr(sign);
    refuse(fmt::format("has the index {} in a <p>, want 0 or more", takeWord(rest)));
  }
}

/// Notes what the file says, and renames the unit's factor so that assimp, which has no option for it, does not see it.
void neutraliseCollada(std::string& text, std::vector<std::string>& notes) {
  const std::string_view up = between(text, "<up_axis>", '<');
  std::string unit;
  for (std::size_t at = text.find("<unit"); at != std::string::npos; at = text.find("<unit", at + 1)) {
    const std::size_t end = text.find('>', at);
    const std::size_t meter = text.find("meter", at);
    if (end == std::string::npos || meter > end) continue;
    // <unit meter="0.01" name="meter"/>: only the attribute has a sign of equality after it.
    for (std::size_t key = meter; key < end; key = text.find("meter", key + 1)) {
      const std::size_t sign = text.find_first_not_of(kSpaces, key + 5);
      if (sign >= end || text[sign] != '=' || kSpaces.find(text[key - 1]) == std::string_view::npos) continue;
      const std::size_t quote = text.find_first_of("\"'", sign);
      if (quote >= end) break;
      if (unit.empty()) unit = text.substr(quote + 1, text.find(text[quote], quote + 1) - quote - 1);
      text.replace(key, 5, "metre");
      break;
    }
  }
  if (!up.empty()) notes.push_back(fmt::format("the file says {}: reported, not applied", up.substr(0, 40)));
  if (!unit.empty()) notes.push_back(fmt::format("the file says unit {} m: reported, not applied", unit.substr(0, 40)));
}

void noteFbx(const aiScene& scene, std::vector<std::string>& notes) {
  std::int32_t axis = 0;
  float unit = 0;
  if (scene.mMetaData == nullptr) return;
  if (scene.mMetaData->Get("UpAxis", axis)) {
    notes.push_back(fmt::format("the file says {}_UP: reported, not applied", "XYZ"[std::clamp(axis, 0, 2)]));
  }
  if (scene.mMetaData->Get("UnitScaleFactor", unit)) {
    notes.push_back(fmt::format("the file says unit {} cm: reported, not applied", unit));
  }
}

// ---- The scene graph -------------------------------------------------------------------------------------------

Eigen::Affine3d toAffine(const aiMatrix4x4& m) {
  Eigen::Affine3d X;
  X.matrix() << m.a1, m.a2, m.a3, m.a4, m.b1, m.b2, m.b3, m.b4, m.c1, m.c2, m.c3, m.c4, m.d1, m.d2, m.d3, m.d4;
  return X;
}

/// Adds the triangles of one instance. Lines and points are left out; a mirror turns the triangles back outward.
void addInstance(TriangleMesh& mesh, const aiMesh& part, const Eigen::Affine3d& X, std::size_t maxTriangles) {
  const bool mirrored = X.linear().determinant() < 0;
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  const std::size_t before = mesh.triangles.size();
  for (unsigned i = 0; i < part.mNumFaces; ++i) {
    const aiFace& face = part.mFaces[i];
    if (face.mNumIndices != 3) continue;
    std::array<std::uint32_t, 3> t{};
    for (unsigned k = 0; k < 3; ++k) {
      if (face.mIndices[k] >= part.mNumVertices) {
        refuse(fmt::format("has vertex index {} in a face, want below {}", face.mIndices[k], part.mNumVertices));
      }
      t[k] = first + face.mIndices[k];
    }
    if (mirrored) std::swap(t[1], t[2]);
    mesh.triangles.push_back(t);
  }
  if (mesh.triangles.size() > maxTriangles) {
    refuse(fmt::format("has more than {} triangles, the limit", maxTriangles));
  }
  if (mesh.triangles.size() == before) return;
  for (unsigned i = 0; i < part.mNumVertices; ++i) {
    const aiVector3D& v = part.mVertices[i];
    mesh.vertices.push_back(X * Eigen::Vector3d(v.x, v.y, v.z));
  }
}

/// The transform of the root as the file has it. assimp turns two formats to y up there, without an option not to.
Eigen::Affine3d rootTransform(const aiScene& scene, const std::string& extension) {
  if (extension == "fbx") return Eigen::Affine3d::Identity();  // a node of assimp's own
  const Eigen::Affine3d X = toAffine(scene.mRootNode->mTransformation);
  if (extension != "3ds") return X;
  Eigen::Affine3d back = Eigen::Affine3d::Identity();
  back.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  return back * X;
}

/// All meshes of the scene where the nodes put them.
TriangleMesh flatten(const aiScene& scene, const Eigen::Affine3d& X_root, std::size_t maxTriangles) {
  TriangleMesh mesh;
  std::vector<std::pair<const aiNode*, Eigen::Affine3d>> open = {{scene.mRootNode, X_root}};
  while (!open.empty()) {
    const auto [node, X] = open.back();
    open.pop_back();
    for (unsigned i = 0; i < node->mNumMeshes; ++i) {
      addInstance(mesh, *scene.mMeshes[node->mMeshes[i]], X, maxTriangles);
    }
    for (unsigned i = node->mNumChildren; i-- > 0;) {
      const aiNode* child = node->mChildren[i];
      open.emplace_back(child, X * toAffine(child->mTransformation));
    }
  }
  return mesh;
}

/// assimp drops or bends faces with wrong indices in some formats, and only says so in its log.
class IndexWarnings : public Assimp::LogStream {
 public:
  void write(const char* message) override {
    const std::string text = lower(message);
    const auto has = [&](const char* part) { return text.find(part) != std::string::npos; };
    if (!has("out of range") && !has("out-of-range") && !has("out of bounds") && !has("index overflow")) return;
    seen_ = seen_ || (!has("material") && !has("color") && !has("uv ") && !has("normal"));
  }
  bool seen() const { return seen_; }

 private:
  bool seen_ = false;
};

/// Routes assimp's log, which is silent otherwise, through IndexWarnings while it lives.
class LogWatch {
 public:
  LogWatch() {
    Assimp::DefaultLogger::create("", Assimp::Logger::NORMAL, 0);
    Assimp::DefaultLogger::get()->attachStream(&warnings_, Assimp::Logger::Warn | Assimp::Logger::Err);
  }
  ~LogWatch() {
    Assimp::DefaultLogger::get()->detachStream(&warnings_, Assimp::Logger::Warn | Assimp::Logger::Err);
    Assimp::DefaultLogger::kill();
  }
  LogWatch(const LogWatch&) = delete;
  LogWatch& operator=(const LogWatch&) = delete;
  bool sawWrongIndex() const { return warnings_.seen(); }

 private:
  IndexWarnings warnings_;
};

/// From `content` unless that is empty, else from the file.
const aiScene& readScene(Assimp::Importer& importer, const std::string& path, const std::string& extension,
                         const std::string& content) {
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  importer.SetPropertyBool(AI_CONFIG_IMPORT_NO_SKELETON_MESHES, true);
  const LogWatch log;
  const aiScene* scene = content.empty() ? importer.ReadFile(path, aiProcess_Triangulate)
                                         : importer.ReadFileFromMemory(content.data(), content.size(),
                                                                       aiProcess_Triangulate, extension.c_str());
  if (scene != nullptr && log.sawWrongIndex()) refuse("has a face with a vertex index out of range");
  if (scene != nullptr && scene->mRootNode != nullptr) return *scene;
  std::string reason = importer.GetErrorString();
  if (reason.find("bad_alloc") != std::string::npos) throw std::bad_alloc();
  if (reason.size() > kMostReason) reason = reason.substr(0, kMostReason) + "...";  // assimp may quote the whole file
  refuse(fmt::format("is not a readable {} file: {}", extension, reason.empty() ? "no reason given" : reason));
}

/// Checks the file and returns what assimp should read instead of it; empty for the file itself.
std::string prepareContent(const std::string& path, const std::string& extension, std::vector<std::string>& notes) {
  std::string content = readFile(path);
  checkContent(extension, content);
  if (extension == "obj") return reduceObj(content);
  if (extension != "dae") return {};
  checkCollada(content);
  neutraliseCollada(content, notes);
  return content;
}

ImportedMesh importChecked(const std::string& path, const std::string& extension, std::size_t maxTriangles) {
  ImportedMesh result;
  const std::string content = prepareContent(path, extension, result.notes);
  Assimp::Importer importer;
  const aiScene& scene = readScene(importer, path, extension, content);
  if (extension == "fbx") noteFbx(scene, result.notes);
  result.mesh = flatten(scene, rootTransform(scene, extension), maxTriangles);
  if (result.mesh.triangles.empty()) refuse("has no triangles");
  return result;
}

}  // namespace

ImportedMesh importFile(const std::string& path, std::size_t maxTriangles) {
  try {
    const std::string dotted = lower(fs::path(path).extension().string());
    const std::string extension = dotted.empty() ? dotted : dotted.substr(1);
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    if (!fs::exists(status))
      refuse(fmt::format("cannot be read: {}", error ? error.message() : "No such file or directory"));
    if (fs::is_directory(status)) refuse("cannot be read: is a folder");
    if (!fs::is_regular_file(status)) refuse("cannot be read: is not a regular file");
    if (extension.empty() || fmt::format(" {},", kFormats).find(fmt::format(" {},", extension)) == std::string::npos) {
      refuse(fmt::format("is of unknown format \"{}\", want one of {}", dotted, kFormats));
    }
    return importChecked(path, extension, maxTriangles);
  } catch (const InputError& error) {
    // readFile names the path itself.
    if (std::string_view(error.what()).starts_with(path + ": ")) throw;
    throw InputError(fmt::format("{}: {}", path, error.what()));
  }
}

void importToStream(const std::string& path, std::size_t maxTriangles, std::ostream& out) {
  const ImportedMesh imported = importFile(path, maxTriangles);
  std::string notes;
  for (const auto& note : imported.notes) notes += note + "\n";
  notes.resize(std::min(notes.size(), kMaxNotesBytes));
  const auto& [vertices, triangles] = imported.mesh;
  const ImportHeader header{kImportMagic, vertices.size(), triangles.size(), notes.size()};
  const auto write = [&](const void* data, std::size_t bytes) {
    out.write(static_cast<const char*>(data), static_cast<std::streamsize>(bytes));
  };
  static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double) && sizeof(triangles[0]) == 3 * sizeof(std::uint32_t));
  write(&header, sizeof header);
  write(vertices.data(), vertices.size() * sizeof vertices[0]);
  write(triangles.data(), triangles.size() * sizeof triangles[0]);
  write(notes.data(), notes.size());
  out.flush();
  if (!out) throw SystemError(fmt::format("{}: the mesh could not be handed over", path));
}

void limitThisProcess(const ImportLimits& limits) {
  const auto set = [](int what, std::uint64_t value) {
    const rlimit limit{value, value};
    ::setrlimit(static_cast<__rlimit_resource_t>(what), &limit);  // a lower limit that stands already is as good
  };
  set(RLIMIT_CORE, 0);
  set(RLIMIT_CPU, static_cast<std::uint64_t>(std::ceil(std::clamp(limits.seconds, 0.0, 1e9))) + 1);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  set(RLIMIT_AS, limits.bytes);  // sanitizers reserve terabytes of addresses
#endif
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // a killed job leaves no importer behind
}

}  // namespace handhold
