#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// Coordinates and sizes beyond this are taken for another unit or a damaged file [m].
inline constexpr double kFarthestCoordinate = 1e4;

/// The points of a file [m]: PLY (ascii or binary of either byte order; x, y, z of `element vertex` as float or double,
/// everything else skipped) when it begins with the word ply, else text with x y z in a line, further columns ignored
/// and comments from # to the end of the line.
/// @throws InputError  naming the file, the line or vertex, what was found and what was wanted
std::vector<Eigen::Vector3d> readPointCloud(const std::string& path);

/// Keeps the first point of each voxel of edge `voxel` [m], in the order given. Returns the farthest [m] that a dropped
/// point lies from the one kept in its voxel, at most the voxel's diagonal.
double thinPoints(std::vector<Eigen::Vector3d>& points, double voxel);

}  // namespace handhold
