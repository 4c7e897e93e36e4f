#pragma once

// Private to src/robot: which links always hang together, for the reader of robot.yaml and for its first draft.

#include "hand/mechanism.h"

#include <utility>
#include <vector>

namespace handhold {

/// Pairs of links (lower index first) with geometry whose touching means nothing: neighbours in the tree, links without
/// geometry passed over, and links that no joint moves against each other.
std::vector<std::pair<int, int>> neighbouringLinks(const Mechanism& mechanism);

}  // namespace handhold
