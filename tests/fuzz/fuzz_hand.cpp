// Any two texts as a hand: a hand.yaml, a line of "---URDF---", a URDF. Geometry is given as a stored hand's is, so
// that no mesh file is read: every name in the URDF is a link with a box.
#include "fuzz/one_line.h"
#include "hand/hand.h"
#include "mesh/shapes.h"

namespace handhold {
namespace {

constexpr std::string_view kSeparator = "---URDF---\n";

std::vector<std::string> namesIn(const std::string& urdf) {
  constexpr std::string_view kName = "name=\"";
  std::vector<std::string> names;
  for (std::size_t at = urdf.find(kName); at != std::string::npos; at = urdf.find(kName, at + 1)) {
    const std::size_t begin = at + kName.size();
    names.push_back(urdf.substr(begin, std::min(urdf.find('"', begin), urdf.size()) - begin));
  }
  return names;
}

void readHand(const std::string& text) {
  const std::size_t split = text.find(kSeparator);
  if (split == std::string::npos) return;
  const std::string urdf = text.substr(split + kSeparator.size());
  const std::vector<std::string> names = namesIn(urdf);
  const std::vector<TriangleMesh> boxes(names.size(), test::box({-0.01, -0.01, -0.01}, {0.01, 0.01, 0.01}));
  try {
    const Hand hand = restoreHand("hand", urdf, text.substr(0, split), names, boxes);
    for (const Preshape& preshape : hand.preshapes) forwardKinematics(hand, preshape.jointPosition);
  } catch (const InputError& error) {
    fuzz::requireOneLine(error);
  }
}

}  // namespace
}  // namespace handhold

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  handhold::readHand(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
