#pragma once

#include "hand/mechanism.h"

#include <map>
#include <string>
#include <vector>

namespace handhold {

/// Nothing of a hand or a robot is farther from anything else of it [m]: more is a mistake in the unit.
inline constexpr double kFarthest = 10;

/// Fills `mechanism` with the subtree of the URDF below `rootLink` (the URDF's own root when empty).
/// Geometry is each link's <collision>, or its <visual> when it has none; links in `ignoreLinks` get none.
/// @throws InputError  naming the file and the element
void readUrdf(const std::string& path, const std::string& rootLink, const std::vector<std::string>& ignoreLinks,
              const PackagePaths& packages, Mechanism& mechanism);

/// The same from a database record: `text` is the URDF, `meshes` each link's geometry by its name.
void readStoredUrdf(const std::string& text, const std::string& rootLink,
                    const std::map<std::string, TriangleMesh>& meshes, Mechanism& mechanism);

/// A name as YAML reads it back, for the files that are begun from a URDF.
std::string yamlName(const std::string& name);

}  // namespace handhold
