# Writes the source of handhold::pageFile (src/view/page_files.h) with the text of files in it. Called while building:
#   cmake -DOUTPUT=FILE.cpp "-DFILES=A;B" -P embed_files.cmake
set(rows "")
foreach(file IN LISTS FILES)
  get_filename_component(name "${file}" NAME)
  file(READ "${file}" content)
  string(APPEND rows "    {\"${name}\"sv, R\"page-file(${content})page-file\"sv},\n")
endforeach()
list(LENGTH FILES count)
file(WRITE "${OUTPUT}" "#include \"view/page_files.h\"

#include <algorithm>
#include <array>
#include <cassert>
#include <utility>

namespace handhold {
namespace {

using namespace std::string_view_literals;

constexpr std::array<std::pair<std::string_view, std::string_view>, ${count}> kFiles = {{
${rows}}};

}  // namespace

std::string_view pageFile(std::string_view name) {
  const auto file = std::find_if(kFiles.begin(), kFiles.end(), [&](const auto& entry) { return entry.first == name; });
  assert(file != kFiles.end());
  return file->second;
}

}  // namespace handhold
")
