#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace handhold {

/// Number types of the file, always little-endian: unsigned, signed and IEEE floating point of so many bytes.
enum class NumberType { u1, u2, u4, u8, i4, i8, f4, f8 };

template <class T>
consteval NumberType numberType() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return NumberType::u1;
  if constexpr (std::is_same_v<T, std::uint16_t>) return NumberType::u2;
  if constexpr (std::is_same_v<T, std::uint32_t>) return NumberType::u4;
  if constexpr (std::is_same_v<T, std::uint64_t>) return NumberType::u8;
  if constexpr (std::is_same_v<T, std::int32_t>) return NumberType::i4;
  if constexpr (std::is_same_v<T, std::int64_t>) return NumberType::i8;
  if constexpr (std::is_same_v<T, float>) return NumberType::f4;
  if constexpr (std::is_same_v<T, double>) return NumberType::f8;
}

using Shape = std::vector<std::size_t>;

/// A HDF5 file that is built in memory. The disk is written by us, not by HDF5, because HDF5 cannot close a file whose
/// last flush failed on a full disk, and because the reason (errno) would be lost. Nothing in the bytes depends on the
/// time, the machine or the thread: equal calls give equal bytes.
///
/// Texts are variable-length UTF-8. Object paths are absolute; a group is added before what lies in it.
/// Holds the lock on the HDF5 library while it lives: at most one builder or view at a time in a thread.
/// Every function throws SystemError when HDF5 refuses (out of memory).
class Hdf5Builder {
 public:
  /// @param userBlock  bytes kept free at the beginning of the file: 0, 512 or a larger power of two
  explicit Hdf5Builder(std::size_t userBlock);
  ~Hdf5Builder();
  Hdf5Builder(const Hdf5Builder&) = delete;
  Hdf5Builder& operator=(const Hdf5Builder&) = delete;

  void addGroup(const std::string& path);
  template <class T>
  void addArray(const std::string& path, const Shape& shape, const std::vector<T>& values) {
    addNumbers(path, shape, numberType<T>(), values.data(), values.size());
  }
  void addText(const std::string& path, const std::string& text);
  void addTexts(const std::string& path, const std::vector<std::string>& texts);

  template <class T>
  void setNumber(const std::string& object, const std::string& attribute, T value) {
    setNumberOf(object, attribute, numberType<T>(), &value);
  }
  void setText(const std::string& object, const std::string& attribute, const std::string& text);
  void setTexts(const std::string& object, const std::string& attribute, const std::vector<std::string>& texts);

  /// The file's bytes after the user block.
  std::string image();

 private:
  void addNumbers(const std::string& path, const Shape& shape, NumberType type, const void* values, std::size_t count);
  void setNumberOf(const std::string& object, const std::string& attribute, NumberType type, const void* value);

  std::unique_lock<std::mutex> lock_;  // guards the HDF5 library
  std::int64_t file_ = -1;
};

/// A HDF5 file that is read. Takes no file lock (they fail on some network file systems; sets never change).
/// Every function throws InputError `FILE: OBJECT is FOUND, want WANTED` when the object is missing or of another kind.
/// Holds the lock on the HDF5 library while it lives, as Hdf5Builder does.
class Hdf5View {
 public:
  explicit Hdf5View(const std::filesystem::path& path);
  ~Hdf5View();
  Hdf5View(const Hdf5View&) = delete;
  Hdf5View& operator=(const Hdf5View&) = delete;

  /// All numbers of a dataset, row-major; its shape is returned in `shape`.
  template <class T>
  std::vector<T> array(const std::string& path, Shape& shape) const {
    shape = shapeOf(path, numberType<T>());
    std::size_t count = 1;
    for (const std::size_t length : shape) count *= length;
    std::vector<T> values(count);
    readNumbers(path, numberType<T>(), values.data(), count);
    return values;
  }
  /// The same of a file that others wrote: whatever its number type, compressed or not.
  std::vector<double> numbers(const std::string& path, Shape& shape) const;
  /// The shape of a dataset of numbers, which are not read.
  template <class T>
  Shape shape(const std::string& path) const {
    return shapeOf(path, numberType<T>());
  }
  /// Is there a dataset or group of that name? The group that it lies in must exist.
  bool has(const std::string& path) const;
  bool hasAttribute(const std::string& object, const std::string& attribute) const;
  std::string text(const std::string& path) const;
  std::vector<std::string> texts(const std::string& path) const;

  template <class T>
  T number(const std::string& object, const std::string& attribute) const {
    T value{};
    readNumberOf(object, attribute, numberType<T>(), &value);
    return value;
  }
  std::string textAttribute(const std::string& object, const std::string& attribute) const;
  std::vector<std::string> textsAttribute(const std::string& object, const std::string& attribute) const;

  /// Throws InputError `FILE: MESSAGE`.
  [[noreturn]] void refuse(std::string_view message) const;

 private:
  /// The shape of a dataset of `type`; refuses one with more numbers than the file has room for.
  Shape shapeOf(const std::string& path, NumberType type) const;
  void readNumbers(const std::string& path, NumberType type, void* values, std::size_t count) const;
  void readNumberOf(const std::string& object, const std::string& attribute, NumberType type, void* value) const;

  std::unique_lock<std::mutex> lock_;  // guards the HDF5 library
  std::string name_;
  std::size_t fileBytes_ = 0;
  std::int64_t file_ = -1;
};

/// `(4, 3)`
std::string shapeText(const Shape& shape);

}  // namespace handhold
