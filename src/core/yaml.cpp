#include "core/yaml.h"

#include "core/error.h"
#include "core/file.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/yaml.h>

namespace handhold {

/// Turns yaml-cpp's tree into ours. Depth and size are limited: aliases could otherwise blow a small file up.
struct YamlValue::Parser {
  std::shared_ptr<const std::string> file;
  int firstLine = 1;
  int budget = 1'000'000;

  YamlValue convert(const YAML::Node& node, const std::string& key, int depth) {
    YamlValue value;
    value.file_ = file;
    value.key_ = key;
    value.line_ = node.Mark().line + firstLine;
    if (depth > 50 || --budget < 0) value.fail("is nested too deeply or too large");
    if (node.IsScalar()) {
      value.kind_ = Kind::scalar;
      value.scalar_ = node.Scalar();
    } else if (node.IsSequence()) {
      value.kind_ = Kind::sequence;
      for (std::size_t i = 0; i < node.size(); ++i) {
        value.items_.push_back(convert(node[i], fmt::format("{}[{}]", key, i), depth + 1));
      }
    } else if (node.IsMap()) {
      value.kind_ = Kind::map;
      for (const auto& entry : node) addEntry(value, entry.first, entry.second, depth);
    }
    return value;
  }

  void addEntry(YamlValue& map, const YAML::Node& keyNode, const YAML::Node& valueNode, int depth) {
    if (!keyNode.IsScalar()) map.fail("has a key that is no plain text");
    const std::string& name = keyNode.Scalar();
    YamlValue entry = convert(valueNode, map.key_.empty() ? name : map.key_ + "." + name, depth + 1);
    entry.line_ = keyNode.Mark().line + firstLine;
    if (map.find(name) != nullptr) entry.fail("is given twice, want it once");
    map.entries_.emplace_back(name, std::move(entry));
  }
};

namespace {

/// Texts and keys in messages: what is wanted stands behind them.
std::string shortened(const std::string& text) {
  constexpr std::size_t kLongest = 60;
  return text.size() <= kLongest ? text : text.substr(0, kLongest - 3) + "...";
}

/// YAML::Load reads the first document and drops the others (YAML::LoadAll does not end on some broken files).
void refuseSecondDocument(std::string_view text, const std::string& fileName, int firstLine) {
  bool begun = false;
  for (int line = firstLine; !text.empty(); ++line) {
    const std::string_view content = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(content.size() + 1, text.size()));
    const bool isMarker = content.substr(0, 3) == "---" && content.find_first_not_of(" \t\r", 3) != 3;
    if (isMarker && begun) {
      throw InputError(fmt::format("{}:{}: begins another document, want one in the file", fileName, line));
    }
    const std::size_t first = content.find_first_not_of(" \t\r");
    begun = begun || (first != std::string_view::npos && content[first] != '#' && content[first] != '%');
  }
}

}  // namespace

YamlValue YamlValue::parseFile(const std::string& path) { return parseText(readFile(path), path); }

YamlValue YamlValue::parseText(std::string_view text, const std::string& fileName, int firstLine) {
  try {
    Parser parser{std::make_shared<const std::string>(fileName), firstLine};
    YamlValue value = parser.convert(YAML::Load(std::string(text)), "", 0);
    if (value.kind_ == Kind::null) throw InputError(fmt::format("{}: is empty, want keys and values", fileName));
    refuseSecondDocument(text, fileName, firstLine);
    return value;
  } catch (const YAML::DeepRecursion& error) {
    throw InputError(fmt::format("{}:{}: is nested too deeply", fileName, error.mark.line + firstLine));
  } catch (const YAML::Exception& error) {
    throw InputError(fmt::format("{}:{}: is no valid YAML: {}", fileName, error.mark.line + firstLine, error.msg));
  }
}

std::string YamlValue::where() const { return fmt::format("{}:{}", *file_, line_); }

std::string YamlValue::found() const {
  switch (kind_) {
    case Kind::null:
      return "empty";
    case Kind::scalar:
      return "\"" + shortened(scalar_) + "\"";
    case Kind::sequence:
      return fmt::format("a list of {}", items_.size());
    case Kind::map:
      return "a map";
  }
  return "";
}

void YamlValue::refuse(std::string_view wanted) const { fail(fmt::format("is {}, want {}", found(), wanted)); }

void YamlValue::fail(std::string_view message) const {
  throw InputError(fmt::format("{}: {} {}", where(), key_.empty() ? "the file" : shortened(key_), message));
}

void YamlValue::allowKeys(std::initializer_list<std::string_view> keys) const {
  for (const auto& [name, value] : entries()) {
    if (std::find(keys.begin(), keys.end(), name) == keys.end()) {
      value.fail(fmt::format("is not a known key, want one of: {}", fmt::join(keys, ", ")));
    }
  }
}

const YamlValue* YamlValue::find(std::string_view key) const {
  for (const auto& [name, value] : entries()) {
    if (name == key) return &value;
  }
  return nullptr;
}

const YamlValue& YamlValue::require(std::string_view key) const {
  const YamlValue* value = find(key);
  if (value == nullptr) fail(fmt::format("has no key \"{}\", want one", key));
  return *value;
}

const std::vector<std::pair<std::string, YamlValue>>& YamlValue::entries() const {
  if (kind_ != Kind::map) refuse("a map");
  return entries_;
}

const std::vector<YamlValue>& YamlValue::items() const {
  if (kind_ != Kind::sequence) refuse("a list");
  return items_;
}

std::string YamlValue::text() const {
  if (kind_ != Kind::scalar || scalar_.empty()) refuse("a text");
  const auto isControl = [](unsigned char c) { return std::iscntrl(c) != 0; };
  if (std::any_of(scalar_.begin(), scalar_.end(), isControl)) refuse("a text of one line without control characters");
  return scalar_;
}

bool YamlValue::boolean() const {
  if (kind_ == Kind::scalar && scalar_ == "true") return true;
  if (kind_ == Kind::scalar && scalar_ == "false") return false;
  refuse("true or false");
}

double YamlValue::number() const {
  if (kind_ != Kind::scalar || scalar_.empty()) refuse("a number");
  char* end = nullptr;
  const double value = std::strtod(scalar_.c_str(), &end);
  if (end != scalar_.c_str() + scalar_.size() || !std::isfinite(value)) refuse("a finite number");
  return value;
}

double YamlValue::numberAtLeast(double low) const {
  const double value = number();
  if (value < low) refuse(fmt::format("a number >= {}", low));
  return value;
}

double YamlValue::positiveNumber() const {
  const double value = number();
  if (value <= 0) refuse("a number > 0");
  return value;
}

int YamlValue::integer(int low, int high) const {
  char* end = nullptr;
  errno = 0;
  const long value = kind_ == Kind::scalar ? std::strtol(scalar_.c_str(), &end, 10) : 0;
  if (kind_ != Kind::scalar || scalar_.empty() || end != scalar_.c_str() + scalar_.size() || errno != 0 ||
      value < low || value > high) {
    refuse(fmt::format("a whole number from {} to {}", low, high));
  }
  return static_cast<int>(value);
}

Eigen::Vector3d YamlValue::vector3() const {
  if (kind_ != Kind::sequence || items_.size() != 3) refuse("three numbers [x, y, z]");
  return {items_[0].number(), items_[1].number(), items_[2].number()};
}

Eigen::Vector3d YamlValue::direction() const {
  const Eigen::Vector3d value = vector3();
  if (value.stableNorm() < 1e-9) refuse("a direction [x, y, z] that is not zero");
  return value.stableNormalized();
}

Eigen::Quaterniond YamlValue::rotation() const {
  if (kind_ != Kind::sequence || items_.size() != 4) refuse("four numbers [x, y, z, w]");
  const Eigen::Quaterniond quaternion(items_[3].number(), items_[0].number(), items_[1].number(), items_[2].number());
  if (std::abs(quaternion.norm() - 1) > 1e-3) fail("is not of length 1, want a unit quaternion [x, y, z, w]");
  return quaternion.normalized();
}

Eigen::Isometry3d YamlValue::pose() const {
  allowKeys({"position", "orientation"});
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  if (const YamlValue* position = find("position")) X.translation() = position->vector3();
  if (const YamlValue* orientation = find("orientation")) X.linear() = orientation->rotation().toRotationMatrix();
  return X;
}

std::vector<std::string> YamlValue::texts() const {
  std::vector<std::string> result;
  for (const YamlValue& item : items()) result.push_back(item.text());
  return result;
}

}  // namespace handhold
