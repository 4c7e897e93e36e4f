#pragma once

// Private to this library: the readers of readGraspFile, and what they share.

#include "exchange/grasp_file.h"

#include <array>
#include <string>

namespace handhold {

GraspFile readAcronym(const std::string& path);
GraspFile readIsaac(const std::string& path);
GraspFile readGraspGen(const std::string& path);

/// A rigid transform from a 4x4 matrix, row-major. @throws InputError  `WHERE is ..., want a rigid transform`
Eigen::Isometry3d rigidTransform(const std::array<double, 16>& rows, const std::string& where);

}  // namespace handhold
