#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Some of many poses, and how well they stand for the others.
struct PoseCover {
  std::vector<std::size_t> chosen;  // ascending indices
  double radius = 0;                // m: every pose lies within it of a chosen one; 0 when all are chosen
};

/// Farthest-point choice: the first pose, then again and again the one farthest from those chosen, where
///
///     d(X, X') = |p - p'| + s angle(R, R')                                                                  (1)
///
/// is a metric. No point within s of the frame's origin moves by more than d between the two poses. No other choice of
/// as many poses has a radius below half of this one's: the chosen ones and the farthest of the rest are pairwise at
/// least `radius` apart, and two of them must share their nearest pose of the other choice. Distances that differ by
/// less than 1 nm are taken as equal, and the first of such poses is chosen: rounding does not decide.
///
/// @param poses  rigid, one frame
/// @param count  how many to choose, at least 1 unless there is no pose; all when there are no more
/// @param s      m, positive: the length of a turn by 1 rad
/// @note  O(count * poses). Const; safe from many threads.
PoseCover farthestPoses(const std::vector<Eigen::Isometry3d>& poses, std::size_t count, double s);

}  // namespace handhold
