#pragma once

#include "simulate/contacts.h"
#include "simulate/hand_fields.h"
#include "simulate/object_shell.h"

#include <cstddef>
#include <cstdint>
#include <span>

// The inner loops of the fast policy, in single precision, for 4, 8 or 16 numbers at once (Highway picks the widest
// instruction set that the machine has). Each result depends on its own lane alone or on a whole group, so that AVX2
// and AVX-512 give equal bits; without fused multiply-add last bits differ.
namespace handhold::kernels {

constexpr int kGroup = 16;

/// Sixteen points.
struct Points {
  alignas(64) float x[kGroup], y[kGroup], z[kGroup];
};

/// A place in a grid's link frame.
struct PlacedGrid {
  const LinkGrid* grid = nullptr;
  Placement placement;  // from the frame of the points
};

/// Blocks of the tree at X that a motion's coarse field lets touch for some s in [from, to): ids and first s, in field
/// units. Returns their number.
std::size_t selectBlocks(const Lattice<std::uint32_t>& coarse, const SphereTree& tree, const Placement& placement,
                         std::uint32_t from, std::uint32_t to, std::uint32_t* ids, std::uint32_t* firsts);

/// Points in arrays, each with its first touch in field units. There is room for a group more.
struct WaitingPoints {
  float *x, *y, *z;
  std::uint32_t* first;
  std::size_t count;
};

/// Adds the blocks' points that the fine field lets touch in [from, to): moved into the field's frame, with their first
/// s.
void selectPoints(const Lattice<std::uint32_t>& fine, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                  const Placement& placement, std::uint32_t from, std::uint32_t to, WaitingPoints& points);

/// Moves the points whose first touch is below `due`, and below `until`, to the end of `to`; their place then waits for
/// Motion::kNever. Returns the first touch among the others, `until` when none is earlier.
std::uint32_t takeDue(std::uint32_t due, std::uint32_t until, WaitingPoints& waiting, WaitingPoints& to);

/// Where the first of the points is touched in the motion, by Newton's method on the interpolated distance, each from
/// its s on; +inf when that is not before `best`. `grids`: by leaf.
float refineMotion(const Motion& motion, std::span<const PlacedGrid> grids, const Points& points, const float* s,
                   float from, float best);

/// The smallest signed distance of each point to any of the grids.
void distances(std::span<const PlacedGrid> grids, const Points& points, float* distance);

/// Blocks that the hand backing off may touch at some t >= from. Returns their number.
std::size_t selectColumns(const ColumnField& coarse, const SphereTree& tree, const Placement& placement, float from,
                          std::uint32_t* ids);

/// Of the blocks' points those that the hand may touch at some t >= from, moved into the palm frame, with the field's
/// node. Returns their number.
std::size_t columnPoints(const ColumnField& fine, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                         const Placement& placement, float from, float* x, float* y, float* z, std::uint32_t* nodes);

/// The field's intervals of t for `count` points, by their nodes and z (arrays with room for whole groups); none: from
/// +inf to -inf.
void columnIntervals(const ColumnField& field, std::size_t count, const std::uint32_t* nodes, const float* z,
                     float* const low[2], float* const high[2]);

/// The end of the run of intervals that t lies in (arrays with room for whole groups).
float climb(float t, std::size_t count, const float* const low[2], const float* const high[2]);

/// The intervals, by index, that begin at or before `top` and, cut off there, end beyond `floor`. Returns their number.
std::size_t lanesEndingIn(float floor, float top, std::size_t count, const float* low, const float* high,
                          std::uint32_t* ids);

/// The largest t <= start at which each point, moving along z with t, leaves the grid's link; -inf when it is not above
/// `best`.
void refineExit(const PlacedGrid& grid, const Points& points, const float* start, float best, float* left);

/// Blocks of the tree whose distance from the grid's surface may be at most `margin` [m], or that may lie inside it.
/// Returns their number.
std::size_t nearBlocks(const PlacedGrid& grid, const SphereTree& tree, float margin, std::uint32_t* ids);
/// Blocks of the shell's triangles, and triangles of these blocks, whose distance from the grid's surface may be at
/// most `margin` [m]. `scratch`: room as for all triangles of the blocks. Return their number.
std::size_t nearBoxes(const PlacedGrid& grid, const ObjectShell& shell, float margin, std::uint32_t* ids);
std::size_t nearTriangles(const PlacedGrid& grid, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                          float margin, std::uint32_t* scratch, std::uint32_t* ids);

/// Small triangles in a link's frame: corners (9), normal (3), velocity (3), in records that whole groups fill.
struct NearTriangles {
  std::vector<Record> record;
  std::vector<std::uint32_t> id;  // in the shell
};

/// Moves the triangles `near.id` into the link frame.
void placeTriangles(const ObjectShell& shell, const Placement& placement, NearTriangles& near);

/// Pairs of a near triangle `a` and a link's triangle `b`, both by place in their arrays, with the interval of tau in
/// which they meet.
struct Pairs {
  std::vector<std::uint32_t> a, b;
  std::vector<float> enter, leave;
  std::size_t count = 0;  // the arrays are longer
};

/// The pairs that may be within `reach` of each other and, when `facing`, face each other.
void findPairs(const LinkGrid& grid, const NearTriangles& near, float reach, bool facing, Pairs& pairs);

/// For each of the first `count` pairs the interval of tau in which `a`, moved by tau times its velocity, meets `b`;
/// enter > leave: none.
/// Vertex against face both ways and edge against edge.
void touchIntervals(const LinkGrid& grid, const NearTriangles& near, std::size_t count, Pairs& pairs);

/// Pairs of a triangle of the object's mesh, in whole, and one of the link's grid.
struct WholePairs {
  std::vector<std::uint32_t> object, link;
  std::vector<FeaturePairs> close;
  std::size_t count = 0;  // the arrays have room for a group more
};

/// Finds the pairs of features that may be within `reach`, all that are and few others, and drops the pairs of
/// triangles that have none.
void keepClose(const LinkGrid& grid, const ObjectShell& shell, const Placement& placement, float reach,
               WholePairs& pairs);

}  // namespace handhold::kernels
