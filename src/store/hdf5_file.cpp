#include "store/hdf5_file.h"

#include "core/error.h"

#include <algorithm>
#include <cassert>
#include <functional>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hdf5.h>

namespace handhold {
namespace {

static_assert(sizeof(hid_t) == sizeof(std::int64_t));

std::mutex libraryMutex;  // guards the HDF5 library and its error stack

constexpr std::size_t kMemoryIncrement = std::size_t{4} << 20;
/// A compressed dataset may claim more numbers than its file has bytes.
constexpr std::size_t kMostForeignNumbers = std::size_t{1} << 26;

/// An id of the library, closed with the function of its kind.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

/// The text of the innermost error. The outer ones only repeat which function passed it on.
std::string lastError() {
  std::string text = "no reason given";
  const auto takeFirst = [](unsigned depth, const H5E_error2_t* error, void* result) -> herr_t {
    if (depth == 0 && error->desc != nullptr) *static_cast<std::string*>(result) = error->desc;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, takeFirst, &text);
  return text;
}

/// Every thread has an error stack of its own, which prints itself unless told not to.
void silenceErrors() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

/// `result` of building `what`, unless it says that HDF5 refused.
template <class Result>
Result built(Result result, std::string_view what) {
  if (result < 0) throw SystemError(fmt::format("{}: HDF5 cannot build it: {}", what, lastError()));
  return result;
}

hid_t hdf5Type(NumberType type) {
  switch (type) {
    case NumberType::u1:
      return H5T_STD_U8LE;
    case NumberType::u2:
      return H5T_STD_U16LE;
    case NumberType::u4:
      return H5T_STD_U32LE;
    case NumberType::u8:
      return H5T_STD_U64LE;
    case NumberType::i4:
      return H5T_STD_I32LE;
    case NumberType::i8:
      return H5T_STD_I64LE;
    case NumberType::f4:
      return H5T_IEEE_F32LE;
    case NumberType::f8:
      return H5T_IEEE_F64LE;
  }
  assert(false);
  return -1;
}

hid_t memoryType(NumberType type) {
  switch (type) {
    case NumberType::u1:
      return H5T_NATIVE_UINT8;
    case NumberType::u2:
      return H5T_NATIVE_UINT16;
    case NumberType::u4:
      return H5T_NATIVE_UINT32;
    case NumberType::u8:
      return H5T_NATIVE_UINT64;
    case NumberType::i4:
      return H5T_NATIVE_INT32;
    case NumberType::i8:
      return H5T_NATIVE_INT64;
    case NumberType::f4:
      return H5T_NATIVE_FLOAT;
    case NumberType::f8:
      return H5T_NATIVE_DOUBLE;
  }
  assert(false);
  return -1;
}

std::string_view typeText(NumberType type) {
  static constexpr std::string_view kNames[] = {"u1", "u2", "u4", "u8", "i4", "i8", "f4", "f8"};
  return kNames[static_cast<std::size_t>(type)];
}

/// A type as found, in the words of db/FORMAT.md where it has some.
std::string typeText(hid_t type) {
  const H5T_class_t kind = H5Tget_class(type);
  const std::size_t bytes = H5Tget_size(type);
  if (kind == H5T_STRING) return H5Tis_variable_str(type) > 0 ? "text" : "text of fixed length";
  if (kind == H5T_FLOAT) return fmt::format("f{}", bytes);
  if (kind == H5T_INTEGER) return fmt::format("{}{}", H5Tget_sign(type) == H5T_SGN_NONE ? 'u' : 'i', bytes);
  return "no number and no text";
}

/// Variable-length UTF-8: h5py reads attributes of it as str, datasets with .asstr().
hid_t textType() {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

std::vector<const char*> pointersTo(const std::vector<std::string>& texts) {
  std::vector<const char*> pointers;
  pointers.reserve(texts.size());
  for (const std::string& text : texts) pointers.push_back(text.c_str());
  return pointers;
}

hid_t dataspace(const Shape& shape) {
  if (shape.empty()) return H5Screate(H5S_SCALAR);
  const std::vector<hsize_t> lengths(shape.begin(), shape.end());
  return H5Screate_simple(static_cast<int>(lengths.size()), lengths.data(), nullptr);
}

/// Contiguous, no time stamp.
void addDataset(hid_t file, const std::string& path, const Shape& shape, hid_t type, hid_t typeInMemory,
                const void* values) {
  const Handle space(built(dataspace(shape), path), H5Sclose);
  const Handle properties(built(H5Pcreate(H5P_DATASET_CREATE), path), H5Pclose);
  built(H5Pset_layout(properties, H5D_CONTIGUOUS), path);
  built(H5Pset_obj_track_times(properties, false), path);
  const Handle dataset(built(H5Dcreate2(file, path.c_str(), type, space, H5P_DEFAULT, properties, H5P_DEFAULT), path),
                       H5Dclose);
  if (H5Sget_simple_extent_npoints(space) == 0) return;
  built(H5Dwrite(dataset, typeInMemory, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), path);
}

void setAttribute(hid_t file, const std::string& object, const std::string& name, const Shape& shape, hid_t type,
                  hid_t typeInMemory, const void* values) {
  const std::string path = object + "@" + name;
  const Handle space(built(dataspace(shape), path), H5Sclose);
  const Handle attribute(
      built(H5Acreate_by_name(file, object.c_str(), name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
            path),
      H5Aclose);
  if (H5Sget_simple_extent_npoints(space) == 0) return;
  built(H5Awrite(attribute, typeInMemory, values), path);
}

Shape shapeOfSpace(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  std::vector<hsize_t> lengths(rank > 0 ? static_cast<std::size_t>(rank) : 0);
  if (!lengths.empty()) H5Sget_simple_extent_dims(space, lengths.data(), nullptr);
  return {lengths.begin(), lengths.end()};
}

/// As db/FORMAT.md has every dataset; a forged one could lead to any file of the reader's.
bool isContiguous(hid_t dataset) {
  const Handle creation(H5Dget_create_plist(dataset), H5Pclose);
  return H5Pget_layout(creation) == H5D_CONTIGUOUS && H5Pget_external_count(creation) == 0;
}

/// Texts that HDF5 allocated, given back to it at the end.
struct OwnedTexts {
  std::vector<char*> pointers;
  hid_t type, space;
  ~OwnedTexts() { H5Dvlen_reclaim(type, space, H5P_DEFAULT, pointers.data()); }

  std::vector<std::string> copy() const {
    std::vector<std::string> texts;
    for (const char* pointer : pointers) texts.emplace_back(pointer == nullptr ? "" : pointer);
    return texts;
  }
};

}  // namespace

std::string shapeText(const Shape& shape) { return fmt::format("({})", fmt::join(shape, ", ")); }

Hdf5Builder::Hdf5Builder(std::size_t userBlock) : lock_(libraryMutex) {
  silenceErrors();
  const std::string what = "HDF5 file in memory";
  const Handle access(built(H5Pcreate(H5P_FILE_ACCESS), what), H5Pclose);
  built(H5Pset_fapl_core(access, kMemoryIncrement, false), what);
  const Handle creation(built(H5Pcreate(H5P_FILE_CREATE), what), H5Pclose);
  built(H5Pset_userblock(creation, userBlock), what);
  built(H5Pset_obj_track_times(creation, false), what);
  // The driver looks for a file of this name before it starts an empty one. This name cannot exist.
  file_ = built(H5Fcreate("/dev/null/in-memory", H5F_ACC_TRUNC, creation, access), what);
}

Hdf5Builder::~Hdf5Builder() { H5Fclose(file_); }

void Hdf5Builder::addGroup(const std::string& path) {
  const Handle properties(built(H5Pcreate(H5P_GROUP_CREATE), path), H5Pclose);
  built(H5Pset_obj_track_times(properties, false), path);
  const Handle group(built(H5Gcreate2(file_, path.c_str(), H5P_DEFAULT, properties, H5P_DEFAULT), path), H5Gclose);
}

void Hdf5Builder::addNumbers(const std::string& path, const Shape& shape, NumberType type, const void* values,
                             [[maybe_unused]] std::size_t count) {
  assert(count == std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>()));
  addDataset(file_, path, shape, hdf5Type(type), memoryType(type), values);
}

void Hdf5Builder::addText(const std::string& path, const std::string& text) {
  const Handle type(built(textType(), path), H5Tclose);
  const char* pointer = text.c_str();
  addDataset(file_, path, {}, type, type, &pointer);
}

void Hdf5Builder::addTexts(const std::string& path, const std::vector<std::string>& texts) {
  const Handle type(built(textType(), path), H5Tclose);
  addDataset(file_, path, {texts.size()}, type, type, pointersTo(texts).data());
}

void Hdf5Builder::setNumberOf(const std::string& object, const std::string& attribute, NumberType type,
                              const void* value) {
  setAttribute(file_, object, attribute, {}, hdf5Type(type), memoryType(type), value);
}

void Hdf5Builder::setText(const std::string& object, const std::string& attribute, const std::string& text) {
  const Handle type(built(textType(), object), H5Tclose);
  const char* pointer = text.c_str();
  setAttribute(file_, object, attribute, {}, type, type, &pointer);
}

void Hdf5Builder::setTexts(const std::string& object, const std::string& attribute,
                           const std::vector<std::string>& texts) {
  const Handle type(built(textType(), object), H5Tclose);
  setAttribute(file_, object, attribute, {texts.size()}, type, type, pointersTo(texts).data());
}

std::string Hdf5Builder::image() {
  const std::string what = "HDF5 file in memory";
  built(H5Fflush(file_, H5F_SCOPE_GLOBAL), what);
  const ssize_t size = built(H5Fget_file_image(file_, nullptr, 0), what);
  std::string bytes(static_cast<std::size_t>(size), '\0');
  built(H5Fget_file_image(file_, bytes.data(), bytes.size()), what);
  return bytes;
}

Hdf5View::Hdf5View(const std::filesystem::path& path) : lock_(libraryMutex), name_(path.string()) {
  silenceErrors();
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access, false, true);
  // Closing the file closes whatever is still open in it.
  H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
  file_ = H5Fopen(name_.c_str(), H5F_ACC_RDONLY, access);
  if (file_ < 0) refuse(fmt::format("cannot be opened by HDF5: {}", lastError()));
  hsize_t bytes = 0;
  H5Fget_filesize(file_, &bytes);
  fileBytes_ = bytes;
}

Hdf5View::~Hdf5View() { H5Fclose(file_); }

void Hdf5View::refuse(std::string_view message) const { throw InputError(fmt::format("{}: {}", name_, message)); }

Shape Hdf5View::shapeOf(const std::string& path, NumberType type) const {
  const Handle dataset(H5Dopen2(file_, path.c_str(), H5P_DEFAULT), H5Dclose);
  if (dataset < 0) refuse(fmt::format("{} is missing, want a dataset", path));
  const Handle found(H5Dget_type(dataset), H5Tclose);
  if (H5Tequal(found, hdf5Type(type)) <= 0) {
    refuse(fmt::format("{} is of type {}, want {}", path, typeText(static_cast<hid_t>(found)), typeText(type)));
  }
  if (!isContiguous(dataset)) refuse(fmt::format("{} is in pieces or elsewhere, want it whole in this file", path));
  const Handle space(H5Dget_space(dataset), H5Sclose);
  const Shape shape = shapeOfSpace(space);
  std::size_t room = fileBytes_;
  for (const std::size_t length : shape) {
    if (length > 0 && room / length == 0)
      refuse(fmt::format("{} has shape {}, want a smaller one: the file has {} bytes", path, shapeText(shape),
                         fileBytes_));
    room = length > 0 ? room / length : room;
  }
  return shape;
}

void Hdf5View::readNumbers(const std::string& path, NumberType type, void* values, std::size_t count) const {
  if (count == 0) return;
  const Handle dataset(H5Dopen2(file_, path.c_str(), H5P_DEFAULT), H5Dclose);
  if (H5Dread(dataset, memoryType(type), H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0) {
    refuse(fmt::format("{} cannot be read: {}", path, lastError()));
  }
}

std::vector<double> Hdf5View::numbers(const std::string& path, Shape& shape) const {
  const Handle dataset(H5Dopen2(file_, path.c_str(), H5P_DEFAULT), H5Dclose);
  if (dataset < 0) refuse(fmt::format("{} is missing, want a dataset", path));
  const Handle found(H5Dget_type(dataset), H5Tclose);
  const H5T_class_t kind = H5Tget_class(found);
  if (kind != H5T_FLOAT && kind != H5T_INTEGER) {
    refuse(fmt::format("{} is of type {}, want numbers", path, typeText(static_cast<hid_t>(found))));
  }
  const Handle space(H5Dget_space(dataset), H5Sclose);
  shape = shapeOfSpace(space);
  std::size_t count = 1;
  for (const std::size_t length : shape) {
    if (length > kMostForeignNumbers / std::max<std::size_t>(count, 1)) {
      refuse(fmt::format("{} has shape {}, want at most {} numbers", path, shapeText(shape), kMostForeignNumbers));
    }
    count *= length;
  }
  std::vector<double> values(count);
  readNumbers(path, NumberType::f8, values.data(), count);
  return values;
}

bool Hdf5View::has(const std::string& path) const { return H5Lexists(file_, path.c_str(), H5P_DEFAULT) > 0; }

bool Hdf5View::hasAttribute(const std::string& object, const std::string& attribute) const {
  return H5Aexists_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT) > 0;
}

std::string Hdf5View::text(const std::string& path) const {
  const std::vector<std::string> all = texts(path);
  if (all.size() != 1) refuse(fmt::format("{} has {} texts, want one", path, all.size()));
  return all[0];
}

std::vector<std::string> Hdf5View::texts(const std::string& path) const {
  const Handle dataset(H5Dopen2(file_, path.c_str(), H5P_DEFAULT), H5Dclose);
  if (dataset < 0) refuse(fmt::format("{} is missing, want a dataset", path));
  const Handle found(H5Dget_type(dataset), H5Tclose);
  if (H5Tis_variable_str(found) <= 0) {
    refuse(fmt::format("{} is of type {}, want text", path, typeText(static_cast<hid_t>(found))));
  }
  if (!isContiguous(dataset)) refuse(fmt::format("{} is in pieces or elsewhere, want it whole in this file", path));
  const Handle space(H5Dget_space(dataset), H5Sclose);
  const hssize_t count = H5Sget_simple_extent_npoints(space);
  if (H5Sget_simple_extent_ndims(space) > 1) refuse(fmt::format("{} is a table, want one dimension", path));
  if (count <= 0) return {};
  if (static_cast<std::size_t>(count) > fileBytes_) refuse(fmt::format("{} has {} texts, want fewer", path, count));
  const Handle type(textType(), H5Tclose);
  OwnedTexts owned{std::vector<char*>(static_cast<std::size_t>(count)), type, space};
  if (H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, owned.pointers.data()) < 0) {
    refuse(fmt::format("{} cannot be read: {}", path, lastError()));
  }
  return owned.copy();
}

void Hdf5View::readNumberOf(const std::string& object, const std::string& attribute, NumberType type,
                            void* value) const {
  const std::string path = object + "@" + attribute;
  const Handle handle(H5Aopen_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  if (handle < 0) refuse(fmt::format("{} is missing, want an attribute", path));
  const Handle found(H5Aget_type(handle), H5Tclose);
  const Handle space(H5Aget_space(handle), H5Sclose);
  if (H5Tequal(found, hdf5Type(type)) <= 0 || H5Sget_simple_extent_type(space) != H5S_SCALAR) {
    refuse(fmt::format("{} is {} of shape {}, want one {}", path, typeText(static_cast<hid_t>(found)),
                       shapeText(shapeOfSpace(space)), typeText(type)));
  }
  if (H5Aread(handle, memoryType(type), value) < 0) refuse(fmt::format("{} cannot be read: {}", path, lastError()));
}

std::string Hdf5View::textAttribute(const std::string& object, const std::string& attribute) const {
  const std::vector<std::string> all = textsAttribute(object, attribute);
  if (all.size() != 1) refuse(fmt::format("{}@{} has {} texts, want one", object, attribute, all.size()));
  return all[0];
}

std::vector<std::string> Hdf5View::textsAttribute(const std::string& object, const std::string& attribute) const {
  const std::string path = object + "@" + attribute;
  const Handle handle(H5Aopen_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  if (handle < 0) refuse(fmt::format("{} is missing, want an attribute", path));
  const Handle found(H5Aget_type(handle), H5Tclose);
  if (H5Tis_variable_str(found) <= 0) {
    refuse(fmt::format("{} is of type {}, want text", path, typeText(static_cast<hid_t>(found))));
  }
  const Handle space(H5Aget_space(handle), H5Sclose);
  const hssize_t count = H5Sget_simple_extent_npoints(space);
  if (count <= 0) return {};
  if (static_cast<std::size_t>(count) > fileBytes_) refuse(fmt::format("{} has {} texts, want fewer", path, count));
  const Handle type(textType(), H5Tclose);
  OwnedTexts owned{std::vector<char*>(static_cast<std::size_t>(count)), type, space};
  if (H5Aread(handle, type, owned.pointers.data()) < 0) refuse(fmt::format("{} cannot be read: {}", path, lastError()));
  return owned.copy();
}

}  // namespace handhold
