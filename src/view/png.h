#pragma once

#include "view/renderer.h"

#include <filesystem>

namespace handhold {

/// Writes an 8-bit RGB PNG, the same bytes for the same picture. An existing file is replaced, all at once.
/// @throws SystemError  `PATH: cannot be written: REASON`
void writePng(const Image& image, const std::filesystem::path& path);

}  // namespace handhold
