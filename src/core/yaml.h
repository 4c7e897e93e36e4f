#pragma once

#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// A YAML value that knows its file, line and key, so that every complaint about it names all three.
/// A key that occurs twice in a map is refused on parsing. Immutable after parsing.
class YamlValue {
 public:
  enum class Kind { null, scalar, sequence, map };

  static YamlValue parseFile(const std::string& path);
  /// @param firstLine  where in the file the text begins, for messages
  static YamlValue parseText(std::string_view text, const std::string& fileName, int firstLine = 1);

  Kind kind() const { return kind_; }
  /// `FILE:LINE`
  std::string where() const;
  /// The key path from the top, as `catalog[0].mesh`.
  const std::string& key() const { return key_; }
  /// Throws InputError `FILE:LINE: KEY is FOUND, want WANTED`.
  [[noreturn]] void refuse(std::string_view wanted) const;
  /// Throws InputError `FILE:LINE: KEY MESSAGE`.
  [[noreturn]] void fail(std::string_view message) const;

  /// Refuses a value that is no map, and the first key that is not in `keys`.
  void allowKeys(std::initializer_list<std::string_view> keys) const;
  /// The value at `key`, or nullptr. Refuses a value that is no map.
  const YamlValue* find(std::string_view key) const;
  /// The value at `key`; throws InputError when it is missing.
  const YamlValue& require(std::string_view key) const;
  const std::vector<std::pair<std::string, YamlValue>>& entries() const;
  const std::vector<YamlValue>& items() const;

  std::string text() const;
  bool boolean() const;
  double number() const;
  double numberAtLeast(double low) const;
  double positiveNumber() const;
  int integer(int low, int high) const;
  /// Three numbers.
  Eigen::Vector3d vector3() const;
  /// Three numbers of length > 0, normalised.
  Eigen::Vector3d direction() const;
  /// A quaternion [x, y, z, w] of unit length to 1e-3.
  Eigen::Quaterniond rotation() const;
  /// {position: [x,y,z], orientation: [x,y,z,w]}, each part optional.
  Eigen::Isometry3d pose() const;
  std::vector<std::string> texts() const;

 private:
  struct Parser;
  std::string found() const;

  Kind kind_ = Kind::null;
  int line_ = 0;
  std::shared_ptr<const std::string> file_;
  std::string key_;
  std::string scalar_;
  std::vector<YamlValue> items_;
  std::vector<std::pair<std::string, YamlValue>> entries_;
};

}  // namespace handhold
