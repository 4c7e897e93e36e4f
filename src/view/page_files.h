#pragma once

#include <string_view>

namespace handhold {

/// The text of a file of src/view/page, or of three.min.js, by its name; the files are part of the program
/// (cmake/embed_files.cmake), so that a report needs nothing but the program.
std::string_view pageFile(std::string_view name);

}  // namespace handhold
