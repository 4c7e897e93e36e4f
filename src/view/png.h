#pragma once

#include "view/renderer.h"

#include <cstdint>
#include <filesystem>
#include <vector>

namespace handhold {

/// The bytes of an 8-bit RGB PNG, the same for the same picture.
/// @throws SystemError  no memory
std::vector<std::uint8_t> pngBytes(const Image& image);

/// Writes pngBytes to a file. An existing file is replaced, all at once.
/// @throws SystemError  `PATH: cannot be written: REASON`
void writePng(const Image& image, const std::filesystem::path& path);

}  // namespace handhold
