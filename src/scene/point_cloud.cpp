#include "scene/point_cloud.h"

#include "core/error.h"
#include "core/file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <string_view>
#include <unordered_map>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

/// Goes through a text line by line.
class Lines {
 public:
  explicit Lines(std::string_view text) : rest_(text) {}

  bool next(std::string_view& line) {
    if (rest_.empty()) return false;
    const std::size_t end = rest_.find('\n');
    line = rest_.substr(0, end);
    rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    ++number_;
    return true;
  }
  int number() const { return number_; }
  std::string_view rest() const { return rest_; }

 private:
  std::string_view rest_;
  int number_ = 0;
};

std::vector<std::string_view> words(std::string_view line) {
  constexpr std::string_view kBlank = " \t,";
  std::vector<std::string_view> result;
  for (std::size_t begin = line.find_first_not_of(kBlank); begin != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(kBlank, begin), line.size());
    result.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kBlank, end);
  }
  return result;
}

std::optional<double> number(std::string_view word) {
  const std::string text(word);
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return end == text.c_str() + text.size() ? std::optional(value) : std::nullopt;
}

/// Text of a file as it may stand in a message.
std::string shown(std::string_view text) {
  std::string result(text.substr(0, 60));
  for (char& c : result) c = c >= ' ' && c <= '~' ? c : '?';
  return result;
}

void requireInRange(const Vector3d& point, const std::string& where) {
  if ((point.array().abs() <= kFarthestCoordinate).all()) return;  // also false for NaN
  throw InputError(fmt::format("{} is ({}, {}, {}), want finite metres within {}", where, point.x(), point.y(),
                               point.z(), kFarthestCoordinate));
}

std::vector<Vector3d> readXyz(const std::string& path, std::string_view text) {
  std::vector<Vector3d> points;
  Lines lines(text);
  for (std::string_view line; lines.next(line);) {
    const std::vector<std::string_view> found = words(line.substr(0, line.find('#')));
    if (found.empty()) continue;
    const auto at = [&](std::size_t k) { return k < found.size() ? number(found[k]) : std::nullopt; };
    const auto x = at(0), y = at(1), z = at(2);
    if (!x || !y || !z) {
      throw InputError(fmt::format("{}:{}: is \"{}\", want three numbers x y z", path, lines.number(), shown(line)));
    }
    points.emplace_back(*x, *y, *z);
    requireInRange(points.back(), fmt::format("{}:{}: the point", path, lines.number()));
  }
  return points;
}

// ---------------------------------------------------------------------------------------------------------------- PLY

enum class Scalar { i8, u8, i16, u16, i32, u32, f32, f64 };

std::size_t sizeOf(Scalar scalar) {
  constexpr std::array<std::size_t, 8> kSizes = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<std::size_t>(scalar)];
}

struct Property {
  std::string name;
  Scalar type = Scalar::f32;
  std::optional<Scalar> count;  // a list has one
};

struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
};

enum class PlyFormat { ascii, littleEndian, bigEndian };

class PlyReader {
 public:
  PlyReader(const std::string& path, std::string_view text) : path_(path), lines_(text) {}

  std::vector<Vector3d> read() {
    readHeader();
    std::vector<Vector3d> points;
    for (const Element& element : elements_) {
      if (element.properties.empty() && element.name != "vertex") continue;  // nothing of it is in the body
      const bool isVertex = element.name == "vertex";
      const std::array<std::size_t, 3> axes = isVertex ? axesOf(element) : std::array<std::size_t, 3>{};
      for (std::size_t i = 0; i < element.count; ++i) {
        readItem(element, i);
        if (!isVertex) continue;
        points.emplace_back(values_[axes[0]], values_[axes[1]], values_[axes[2]]);
        requireInRange(points.back(), fmt::format("{}: vertex {}", path_, i));
      }
      if (isVertex) return points;
    }
    throw InputError(fmt::format("{}: has no \"element vertex\", want one with x, y and z", path_));
  }

 private:
  [[noreturn]] void refuseLine(std::string_view line, std::string_view wanted) const {
    throw InputError(fmt::format("{}:{}: is \"{}\", want {}", path_, lines_.number(), shown(line), wanted));
  }

  Scalar scalar(std::string_view word, std::string_view line) const {
    static const std::map<std::string_view, Scalar> kTypes = {
        {"char", Scalar::i8},   {"int8", Scalar::i8},     {"uchar", Scalar::u8},   {"uint8", Scalar::u8},
        {"short", Scalar::i16}, {"int16", Scalar::i16},   {"ushort", Scalar::u16}, {"uint16", Scalar::u16},
        {"int", Scalar::i32},   {"int32", Scalar::i32},   {"uint", Scalar::u32},   {"uint32", Scalar::u32},
        {"float", Scalar::f32}, {"float32", Scalar::f32}, {"double", Scalar::f64}, {"float64", Scalar::f64}};
    const auto type = kTypes.find(word);
    if (type == kTypes.end()) refuseLine(line, "a number type of PLY, such as float");
    return type->second;
  }

  void readHeader() {
    std::string_view line;
    lines_.next(line);  // the word ply
    bool hasFormat = false;
    while (lines_.next(line)) {
      const std::vector<std::string_view> found = words(line);
      if (found.empty() || found[0] == "comment" || found[0] == "obj_info") continue;
      if (found[0] == "end_header") {
        if (!hasFormat) refuseLine(line, "a format line before it");
        return;
      }
      if (found[0] == "format") {
        readFormat(found, line);
        hasFormat = true;
      } else if (found[0] == "element") {
        readElement(found, line);
      } else if (found[0] == "property" && !elements_.empty()) {
        readProperty(found, line);
      } else {
        refuseLine(line, "format, element, property, comment or end_header");
      }
    }
    throw InputError(fmt::format("{}: ends in its header, want end_header", path_));
  }

  void readFormat(const std::vector<std::string_view>& found, std::string_view line) {
    static const std::map<std::string_view, PlyFormat> kFormats = {{"ascii", PlyFormat::ascii},
                                                                   {"binary_little_endian", PlyFormat::littleEndian},
                                                                   {"binary_big_endian", PlyFormat::bigEndian}};
    const auto format = found.size() == 3 ? kFormats.find(found[1]) : kFormats.end();
    if (format == kFormats.end()) refuseLine(line, "format ascii, binary_little_endian or binary_big_endian");
    format_ = format->second;
  }

  void readElement(const std::vector<std::string_view>& found, std::string_view line) {
    const auto count = found.size() == 3 ? number(found[2]) : std::nullopt;
    if (!count || *count < 0 || *count > 1e9 || *count != std::floor(*count)) refuseLine(line, "element NAME COUNT");
    elements_.push_back({std::string(found[1]), static_cast<std::size_t>(*count), {}});
  }

  void readProperty(const std::vector<std::string_view>& found, std::string_view line) {
    Property property{std::string(found.back()), Scalar::f32, std::nullopt};
    if (found.size() == 5 && found[1] == "list") {
      property.count = scalar(found[2], line);
      property.type = scalar(found[3], line);
    } else if (found.size() == 3) {
      property.type = scalar(found[1], line);
    } else {
      refuseLine(line, "property TYPE NAME");
    }
    elements_.back().properties.push_back(std::move(property));
  }

  std::array<std::size_t, 3> axesOf(const Element& element) const {
    std::array<std::size_t, 3> axes{};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::string name(1, "xyz"[k]);
      const auto& all = element.properties;
      const auto found = std::find_if(all.begin(), all.end(), [&](const Property& p) { return p.name == name; });
      if (found == all.end() || found->count || (found->type != Scalar::f32 && found->type != Scalar::f64)) {
        throw InputError(fmt::format("{}: vertices have {} {}, want it as float or double", path_,
                                     found == all.end() ? "no" : "another type of", name));
      }
      axes[k] = static_cast<std::size_t>(found - all.begin());
    }
    return axes;
  }

  /// Puts the values of one item into values_, one a property; lists are passed over.
  void readItem(const Element& element, std::size_t index) {
    values_.assign(element.properties.size(), 0);
    if (format_ == PlyFormat::ascii) {
      readAsciiItem(element, index);
    } else {
      for (std::size_t k = 0; k < values_.size(); ++k) {
        const Property& property = element.properties[k];
        if (!property.count) {
          values_[k] = take(property.type, element, index);
          continue;
        }
        const double length = take(*property.count, element, index);
        if (length < 0) refuseItem(element, index, fmt::format("has a list of {}", length), "a length >= 0");
        skip(static_cast<std::size_t>(length) * sizeOf(property.type), element, index);
      }
    }
  }

  void readAsciiItem(const Element& element, std::size_t index) {
    std::string_view line;
    std::vector<std::string_view> found;
    while (found.empty()) {
      if (!lines_.next(line)) refuseEnd(element, index);
      found = words(line);
    }
    std::size_t at = 0;
    for (std::size_t k = 0; k < values_.size(); ++k) {
      const auto value = at < found.size() ? number(found[at]) : std::nullopt;
      if (!value) refuseLine(line, fmt::format("{} numbers of {} {}", values_.size(), element.name, index));
      const bool isList = element.properties[k].count.has_value();
      if (isList && !(*value >= 0 && *value <= static_cast<double>(found.size()))) {
        refuseLine(line, "a list as long as it says");
      }
      values_[k] = *value;
      at += isList ? 1 + static_cast<std::size_t>(*value) : 1;
    }
  }

  double take(Scalar scalar, const Element& element, std::size_t index) {
    std::array<char, 8> bytes{};
    const std::size_t size = sizeOf(scalar);
    const std::string_view from = body().substr(0, size);
    if (from.size() < size) refuseEnd(element, index);
    std::copy(from.begin(), from.end(), bytes.begin());
    offset_ += size;
    if ((format_ == PlyFormat::bigEndian) != (std::endian::native == std::endian::big)) {
      std::reverse(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    }
    switch (scalar) {
      case Scalar::i8:
        return as<std::int8_t>(bytes);
      case Scalar::u8:
        return as<std::uint8_t>(bytes);
      case Scalar::i16:
        return as<std::int16_t>(bytes);
      case Scalar::u16:
        return as<std::uint16_t>(bytes);
      case Scalar::i32:
        return as<std::int32_t>(bytes);
      case Scalar::u32:
        return as<std::uint32_t>(bytes);
      case Scalar::f32:
        return as<float>(bytes);
      case Scalar::f64:
        return as<double>(bytes);
    }
    return 0;
  }

  template <typename T>
  static double as(const std::array<char, 8>& bytes) {
    T value;
    std::memcpy(&value, bytes.data(), sizeof value);
    return static_cast<double>(value);
  }

  void skip(std::size_t size, const Element& element, std::size_t index) {
    if (body().size() < size) refuseEnd(element, index);
    offset_ += size;
  }

  std::string_view body() const { return lines_.rest().substr(offset_); }

  [[noreturn]] void refuseEnd(const Element& element, std::size_t index) const {
    refuseItem(element, index, "is missing", fmt::format("{} of them, as the header says", element.count));
  }
  [[noreturn]] void refuseItem(const Element& element, std::size_t index, std::string_view found,
                               std::string_view wanted) const {
    throw InputError(fmt::format("{}: {} {} {}, want {}", path_, shown(element.name), index, found, wanted));
  }

  const std::string& path_;
  Lines lines_;  // behind the header: the body
  std::size_t offset_ = 0;
  PlyFormat format_ = PlyFormat::ascii;
  std::vector<Element> elements_;
  std::vector<double> values_;
};

struct VoxelHash {
  std::size_t operator()(const std::array<double, 3>& voxel) const {
    std::uint64_t hash = 0;
    for (const double x : voxel) {
      hash = (hash ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(x))) * 0x9e3779b97f4a7c15ULL;
      hash ^= hash >> 32;
    }
    return hash;
  }
};

}  // namespace

std::vector<Vector3d> readPointCloud(const std::string& path) {
  const std::string text = readFile(path);
  const bool isPly = text.starts_with("ply\n") || text.starts_with("ply\r\n");
  std::vector<Vector3d> points = isPly ? PlyReader(path, text).read() : readXyz(path, text);
  if (points.empty()) throw InputError(fmt::format("{}: has no points, want at least one", path));
  return points;
}

double thinPoints(std::vector<Vector3d>& points, double voxel) {
  std::unordered_map<std::array<double, 3>, std::size_t, VoxelHash> keptIn;
  double farthest = 0;
  std::size_t kept = 0;
  for (const Vector3d& point : points) {
    const Vector3d cell = (point / voxel).array().floor() + 0.0;  // no -0
    const auto [entry, isFirst] = keptIn.try_emplace({cell.x(), cell.y(), cell.z()}, kept);
    if (isFirst) {
      points[kept++] = point;
    } else {
      farthest = std::max(farthest, (point - points[entry->second]).norm());
    }
  }
  points.resize(kept);
  return farthest;
}

}  // namespace handhold
