#include "robot/neighbours.h"

#include <algorithm>

namespace handhold {

std::vector<std::pair<int, int>> neighbouringLinks(const Mechanism& mechanism) {
  const std::vector<Link>& links = mechanism.links;
  const int n = static_cast<int>(links.size());
  std::vector<std::pair<int, int>> pairs;
  std::vector<int> bodyOf(n, 0);  // the first link of those that are fixed together
  for (int link = 1; link < n; ++link) {
    bodyOf[link] = links[link].joint < 0 ? bodyOf[links[link].parentLink] : link;
    if (links[link].mesh.triangles.empty()) continue;
    int above = links[link].parentLink;
    while (above >= 0 && links[above].mesh.triangles.empty()) above = links[above].parentLink;
    if (above >= 0) pairs.emplace_back(above, link);
    for (int other = 0; other < link; ++other) {
      const bool fixedTogether = bodyOf[other] == bodyOf[link] && !links[other].mesh.triangles.empty();
      if (fixedTogether && other != above) pairs.emplace_back(other, link);
    }
  }
  return pairs;
}

}  // namespace handhold
