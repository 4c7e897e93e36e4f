#include "app/commands.h"
#include "core/error.h"
#include "store/database.h"
#include "view/grasp_picture.h"
#include "view/png.h"

#include <algorithm>
#include <charconv>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// `SET[:I]`, or several with commas between them.
std::vector<GraspName> parseRequests(const std::string& text) {
  if (fs::exists(text)) return {parseGraspName(text)};
  std::vector<GraspName> requests;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    if (comma == begin)
      throw InputError(fmt::format("render: \"{}\" has an empty part, want SET[:I],SET[:I],...", text));
    requests.push_back(parseGraspName(text.substr(begin, comma - begin)));
    begin = comma + 1;
  }
  return requests;
}

std::string describe(const GraspSet& set, std::size_t grasp) {
  return fmt::format("{} in hand {}, grasp {} of {}, epsilon {:.4f}, {} contacts", set.object, set.hand, grasp,
                     set.graspCount(), set.epsilon[grasp], set.contactBegin[grasp + 1] - set.contactBegin[grasp]);
}

}  // namespace

GraspName parseGraspName(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || fs::exists(text)) return {text, 0};
  GraspName name{text.substr(0, colon), 0};
  const std::string number = text.substr(colon + 1);
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), name.grasp);
  if (error != std::errc() || end != number.data() + number.size()) {
    throw InputError(fmt::format("{}: grasp is \"{}\", want a whole number from 0", name.path, number));
  }
  return name;
}

int runRender(const std::string& set, const std::string& output) {
  if (fs::path(output).extension() != ".png") {
    throw InputError(fmt::format("render: --out {} is written as PNG, want a name that ends in .png", output));
  }
  const std::vector<GraspName> requests = parseRequests(set);
  RenderSettings settings;
  if (requests.size() > 1) settings.width = 640, settings.height = 480;
  std::vector<Image> images;
  std::vector<std::string> lines;
  for (const GraspName& request : requests) {
    const GraspSet stored = readGraspSet(request.path);
    try {
      images.push_back(graspPicture(stored, request.grasp, settings));
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: {}", request.path, error.what()));
    }
    lines.push_back(fmt::format("{}: {}\n", output, describe(stored, request.grasp)));
  }
  writePng(images.size() == 1 ? images[0] : composeGrid(images, gridColumns(images.size())), output);
  for (const std::string& line : lines) fmt::print("{}", line);
  return kExitDone;
}

}  // namespace handhold
