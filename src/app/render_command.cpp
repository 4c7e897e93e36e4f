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

/// One picture: a set file and the rank of a grasp in it.
struct PictureRequest {
  std::string path;
  std::size_t grasp = 0;
};

/// `SET` or `SET:I`; a file whose own name ends like that is taken as it is.
PictureRequest parseRequest(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || fs::exists(text)) return {text, 0};
  PictureRequest request{text.substr(0, colon), 0};
  const std::string number = text.substr(colon + 1);
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), request.grasp);
  if (error != std::errc() || end != number.data() + number.size()) {
    throw InputError(fmt::format("{}: grasp is \"{}\", want a whole number from 0", request.path, number));
  }
  return request;
}

/// `SET[:I]`, or several with commas between them.
std::vector<PictureRequest> parseRequests(const std::string& text) {
  if (fs::exists(text)) return {parseRequest(text)};
  std::vector<PictureRequest> requests;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    if (comma == begin)
      throw InputError(fmt::format("render: \"{}\" has an empty part, want SET[:I],SET[:I],...", text));
    requests.push_back(parseRequest(text.substr(begin, comma - begin)));
    begin = comma + 1;
  }
  return requests;
}

std::string describe(const GraspSet& set, std::size_t grasp) {
  return fmt::format("{} in hand {}, grasp {} of {}, epsilon {:.4f}, {} contacts", set.object, set.hand, grasp,
                     set.graspCount(), set.epsilon[grasp], set.contactBegin[grasp + 1] - set.contactBegin[grasp]);
}

}  // namespace

int runRender(const std::string& set, const std::string& output) {
  const std::vector<PictureRequest> requests = parseRequests(set);
  RenderSettings settings;
  if (requests.size() > 1) settings.width = 640, settings.height = 480;
  std::vector<Image> images;
  std::vector<std::string> lines;
  for (const PictureRequest& request : requests) {
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
