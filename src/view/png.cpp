#include "view/png.h"

#include "core/error.h"
#include "core/file.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include <fmt/format.h>
#include <png.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const fs::path& path, const char* reason) {
  throw SystemError(fmt::format("{}: cannot be written: {}", path.string(), reason));
}

}  // namespace

// libpng's simplified interface writes no time.
std::vector<std::uint8_t> pngBytes(const Image& image) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = static_cast<png_uint_32>(image.width);
  header.height = static_cast<png_uint_32>(image.height);
  header.format = PNG_FORMAT_RGB;
  png_alloc_size_t size = 0;
  std::vector<std::uint8_t> bytes;
  if (png_image_write_to_memory(&header, nullptr, &size, 0, image.rgb.data(), 0, nullptr) == 0) {
    throw SystemError(fmt::format("a picture cannot be made a PNG: {}", header.message));
  }
  bytes.resize(size);
  if (png_image_write_to_memory(&header, bytes.data(), &size, 0, image.rgb.data(), 0, nullptr) == 0) {
    throw SystemError(fmt::format("a picture cannot be made a PNG: {}", header.message));
  }
  bytes.resize(size);
  return bytes;
}

void writePng(const Image& image, const fs::path& path) {
  const std::vector<std::uint8_t> bytes = pngBytes(image);
  const fs::path temporary = temporaryName(path.parent_path());
  std::FILE* file = std::fopen(temporary.c_str(), "wbx");
  if (file == nullptr) refuse(path, std::strerror(errno));
  errno = 0;
  const bool written = std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
  const bool closed = std::fclose(file) == 0;
  const int reason = errno;
  std::error_code error;
  if (written && closed) fs::rename(temporary, path, error);
  if (written && closed && !error) return;
  std::error_code ignored;
  fs::remove(temporary, ignored);
  refuse(path, written && closed ? error.message().c_str() : std::strerror(reason));
}

}  // namespace handhold
