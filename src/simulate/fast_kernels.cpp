#include "simulate/fast_kernels.h"

#include <algorithm>
#include <cmath>
#include <limits>

// Three instruction sets: AVX-512, AVX2 with fused multiply-add, and plain code.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "simulate/fast_kernels.cpp"
// clang-format off: this one includes the file again for each instruction set and must come first
#include <hwy/foreach_target.h>
// clang-format on
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace handhold::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, kGroup>;
using DI = hn::RebindToSigned<D>;
using DU = hn::RebindToUnsigned<D>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using M = hn::Mask<D>;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

alignas(64) constexpr std::array<std::uint32_t, kGroup> kNumbers = {0, 1, 2,  3,  4,  5,  6,  7,
                                                                    8, 9, 10, 11, 12, 13, 14, 15};

struct V3 {
  V x, y, z;
};

HWY_INLINE V3 operator-(const V3& a, const V3& b) { return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)}; }
HWY_INLINE V dot(const V3& a, const V3& b) { return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z))); }
HWY_INLINE V3 cross(const V3& a, const V3& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)), hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}
HWY_INLINE V3 scaled(const V3& a, V s) { return {hn::Mul(a.x, s), hn::Mul(a.y, s), hn::Mul(a.z, s)}; }
HWY_INLINE V length(const V3& a) { return hn::Sqrt(dot(a, a)); }

HWY_INLINE V3 rotate(const Placement& X, const V3& a) {
  const D d;
  const auto& r = X.rotation;
  return {hn::MulAdd(hn::Set(d, r[0]), a.x, hn::MulAdd(hn::Set(d, r[1]), a.y, hn::Mul(hn::Set(d, r[2]), a.z))),
          hn::MulAdd(hn::Set(d, r[3]), a.x, hn::MulAdd(hn::Set(d, r[4]), a.y, hn::Mul(hn::Set(d, r[5]), a.z))),
          hn::MulAdd(hn::Set(d, r[6]), a.x, hn::MulAdd(hn::Set(d, r[7]), a.y, hn::Mul(hn::Set(d, r[8]), a.z)))};
}

HWY_INLINE V3 move(const Placement& X, const V3& a) {
  const D d;
  const V3 b = rotate(X, a);
  return {hn::Add(b.x, hn::Set(d, X.translation[0])), hn::Add(b.y, hn::Set(d, X.translation[1])),
          hn::Add(b.z, hn::Set(d, X.translation[2]))};
}

/// A placement as loops need it: a copy, as Frame is.
struct Transform {
  V3 row[3];
  V3 translation;

  HWY_INLINE explicit Transform(const Placement& X) {
    const D d;
    const auto& r = X.rotation;
    for (int i = 0; i < 3; ++i) row[i] = {hn::Set(d, r[3 * i]), hn::Set(d, r[3 * i + 1]), hn::Set(d, r[3 * i + 2])};
    translation = {hn::Set(d, X.translation[0]), hn::Set(d, X.translation[1]), hn::Set(d, X.translation[2])};
  }

  HWY_INLINE V3 rotate(const V3& a) const { return {dot(row[0], a), dot(row[1], a), dot(row[2], a)}; }
  HWY_INLINE V3 operator()(const V3& a) const {
    const V3 b = rotate(a);
    return {hn::Add(b.x, translation.x), hn::Add(b.y, translation.y), hn::Add(b.z, translation.z)};
  }
};

HWY_INLINE V3 load(const float* x, const float* y, const float* z) {
  const D d;
  return {hn::LoadU(d, x), hn::LoadU(d, y), hn::LoadU(d, z)};
}

#if HWY_TARGET != HWY_SCALAR
/// Records' blocks of four numbers, one of every four records: block b of the vector is of record at[4 b].
template <class DT>
HWY_INLINE hn::Vec<DT> blocksOf(DT dt, const float* base, std::size_t stride, const std::uint32_t* at) {
  if constexpr (hn::MaxLanes(DT()) <= 4) {
    return hn::LoadU(dt, base + stride * at[0]);
  } else {
    const hn::Half<DT> half;
    return hn::Combine(dt, blocksOf(half, base, stride, at + hn::MaxLanes(dt) / 2), blocksOf(half, base, stride, at));
  }
}

/// Turns four vectors of blocks: lane j of a block of the k-th becomes lane k of the same block of the j-th.
HWY_INLINE void turnBlocks(V (&v)[4]) {
  const D d;
  const hn::RepartitionToWide<D> wide;
  const auto lower = [&](V a, V b) {
    return hn::BitCast(d, hn::InterleaveLower(wide, hn::BitCast(wide, a), hn::BitCast(wide, b)));
  };
  const auto upper = [&](V a, V b) {
    return hn::BitCast(d, hn::InterleaveUpper(wide, hn::BitCast(wide, a), hn::BitCast(wide, b)));
  };
  const V a = hn::InterleaveLower(d, v[0], v[1]), b = hn::InterleaveUpper(d, v[0], v[1]);
  const V c = hn::InterleaveLower(d, v[2], v[3]), e = hn::InterleaveUpper(d, v[2], v[3]);
  v[0] = lower(a, c);
  v[1] = upper(a, c);
  v[2] = lower(b, e);
  v[3] = upper(b, e);
}
#endif

/// Four numbers of the records `at`, `stride` numbers apart: fields[k] holds base[k] of each. Rows are loaded and
/// turned, which takes a fraction of the time of four gathers.
HWY_INLINE void loadFour(const float* base, std::size_t stride, const std::uint32_t* at, V (&fields)[4]) {
  const D d;
#if HWY_TARGET == HWY_SCALAR
  for (int k = 0; k < 4; ++k) fields[k] = hn::Set(d, base[stride * at[0] + k]);
#else
  for (int k = 0; k < 4; ++k) fields[k] = blocksOf(d, base, stride, at + k);
  turnBlocks(fields);
#endif
}

/// The first kFields numbers of the records `at`.
template <int kFields>
struct Fields {
  V value[kFields];

  HWY_INLINE V3 vector(int k) const { return {value[k], value[k + 1], value[k + 2]}; }
};
template <int kFields, class R>
HWY_INLINE Fields<kFields> loadRecords(const R* records, const std::uint32_t* at) {
  const float* const base = records->value.data();
  Fields<kFields> fields;
  for (int k = 0; k < kFields; k += 4) {
    V four[4];
    loadFour(base + k, sizeof(R) / sizeof(float), at, four);
    for (int j = 0; j < 4; ++j) fields.value[k + j] = four[j];
  }
  return fields;
}

#if HWY_TARGET != HWY_SCALAR
/// The inverse of blocksOf, for records one after the other.
template <class DT>
HWY_INLINE void storeBlocks(DT dt, hn::Vec<DT> blocks, std::size_t stride, float* base) {
  if constexpr (hn::MaxLanes(DT()) <= 4) {
    hn::StoreU(blocks, dt, base);
  } else {
    const hn::Half<DT> half;
    storeBlocks(half, hn::LowerHalf(half, blocks), stride, base);
    storeBlocks(half, hn::UpperHalf(half, blocks), stride, base + stride * hn::MaxLanes(dt) / 2);
  }
}
#endif

/// The inverse of loadRecords, for records one after the other.
template <int kFields>
HWY_INLINE void storeRecords(const Fields<kFields>& fields, Record* to) {
  float* const base = to->value.data();
  for (int k = 0; k < kFields; k += 4) {
#if HWY_TARGET == HWY_SCALAR
    for (int j = 0; j < 4; ++j) base[k + j] = hn::GetLane(fields.value[k + j]);
#else
    V four[4] = {fields.value[k], fields.value[k + 1], fields.value[k + 2], fields.value[k + 3]};
    turnBlocks(four);
    for (int j = 0; j < 4; ++j) storeBlocks(D(), four[j], kGroup, base + k + j * kGroup);
#endif
  }
}

/// A lattice as loops need it: a copy, which what they store cannot change, so that nothing is loaded or worked out
/// again each time.
struct Frame {
  V inverse;  // 1 / step
  V3 origin;
  V3 size;
  VI row, layer;  // nodes in each

  template <class T>
  HWY_INLINE static Frame of(const Lattice<T>& lattice) {
    const D d;
    const DI di;
    const auto size = [&](int axis) { return hn::Set(d, static_cast<float>(lattice.size[axis])); };
    return {hn::Set(d, 1.0F / lattice.step),
            {hn::Set(d, lattice.origin.x()), hn::Set(d, lattice.origin.y()), hn::Set(d, lattice.origin.z())},
            {size(0), size(1), size(2)},
            hn::Set(di, lattice.size[0]),
            hn::Set(di, lattice.size[1])};
  }

  HWY_INLINE VI index(VI x, VI y, VI z) const { return hn::Add(hn::Mul(hn::Add(hn::Mul(z, layer), y), row), x); }
};

/// Coordinates in lattice steps.
HWY_INLINE V3 inSteps(const Frame& lattice, const V3& p) { return scaled(p - lattice.origin, lattice.inverse); }

/// From where `X` comes from into the lattice's steps at once.
HWY_INLINE Transform stepsAfter(const Transform& X, const Frame& lattice) {
  Transform result = X;
  for (V3& row : result.row) row = scaled(row, lattice.inverse);
  result.translation = inSteps(lattice, X.translation);
  return result;
}

/// The nearest node's index for coordinates in steps, and whether the point's cell is one of the lattice.
HWY_INLINE VI nearestNode(const Frame& lattice, const V3& u, M& inside) {
  const D d;
  const DI di;
  const auto half = hn::Set(d, 0.5F);
  const V3 b = {hn::Add(u.x, half), hn::Add(u.y, half), hn::Add(u.z, half)};
  const auto in = [&](V a, V size) { return hn::And(hn::Ge(a, hn::Zero(d)), hn::Lt(a, size)); };
  inside = hn::And(in(b.x, lattice.size.x), hn::And(in(b.y, lattice.size.y), in(b.z, lattice.size.z)));
  const auto node = [&](V a) { return hn::ConvertTo(di, hn::IfThenElseZero(inside, a)); };
  return lattice.index(node(b.x), node(b.y), node(b.z));
}

/// Interpolated distance at `p` (in the link frame), its gradient, and how far `p` lies outside the lattice, where the
/// distance is a lower bound and the gradient is zero.
struct Sampled {
  V distance;
  V3 gradient;
  V outside;
};

/// Distances at a node and at the next along x.
struct NodePair {
  V here, next;
};
HWY_INLINE NodePair gatherPair(const std::int32_t* pairs, VI at) {
  const D d;
  const VI packed = hn::GatherIndex(DI(), pairs, at);
  const V unit = hn::Set(d, LinkGrid::kUnit);
  return {hn::Mul(hn::ConvertTo(d, hn::ShiftRight<16>(hn::ShiftLeft<16>(packed))), unit),
          hn::Mul(hn::ConvertTo(d, hn::ShiftRight<16>(packed)), unit)};
}

HWY_INLINE Sampled sample(const LinkGrid& grid, const V3& p) {
  const D d;
  const DI di;
  const Lattice<float>& lattice = grid.distance;
  const V3 u = inSteps(Frame::of(lattice), p);
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0F);
  const auto clamp = [&](V a, int size) {
    return hn::Min(hn::Max(a, zero), hn::Set(d, static_cast<float>(size) - 1.001F));
  };
  const V3 c = {clamp(u.x, lattice.size[0]), clamp(u.y, lattice.size[1]), clamp(u.z, lattice.size[2])};
  const VI ix = hn::ConvertTo(di, c.x), iy = hn::ConvertTo(di, c.y), iz = hn::ConvertTo(di, c.z);
  const V3 f = {hn::Sub(c.x, hn::ConvertTo(d, ix)), hn::Sub(c.y, hn::ConvertTo(d, iy)),
                hn::Sub(c.z, hn::ConvertTo(d, iz))};
  const VI index =
      hn::Add(hn::Mul(hn::Add(hn::Mul(iz, hn::Set(di, lattice.size[1])), iy), hn::Set(di, lattice.size[0])), ix);
  const std::int32_t* v = grid.nodePairs.data();
  const std::ptrdiff_t row = lattice.size[0], layer = row * lattice.size[1];
  const auto [v000, v100] = gatherPair(v, index);
  const auto [v010, v110] = gatherPair(v + row, index);
  const auto [v001, v101] = gatherPair(v + layer, index);
  const auto [v011, v111] = gatherPair(v + layer + row, index);
  const auto mix = [&](V a, V b, V w) { return hn::MulAdd(hn::Sub(b, a), w, a); };
  const V x00 = mix(v000, v100, f.x), x10 = mix(v010, v110, f.x), x01 = mix(v001, v101, f.x),
          x11 = mix(v011, v111, f.x);
  const V y0 = mix(x00, x10, f.y), y1 = mix(x01, x11, f.y);
  const V gx0 = mix(hn::Sub(v100, v000), hn::Sub(v110, v010), f.y);
  const V gx1 = mix(hn::Sub(v101, v001), hn::Sub(v111, v011), f.y);
  const V inverse = hn::Set(d, 1.0F / lattice.step);
  Sampled result;
  result.distance = mix(y0, y1, f.z);
  result.gradient = {hn::Mul(mix(gx0, gx1, f.z), inverse),
                     hn::Mul(mix(hn::Sub(x10, x00), hn::Sub(x11, x01), f.z), inverse),
                     hn::Mul(hn::Sub(y1, y0), inverse)};
  const V3 off = u - c;
  result.outside = hn::Mul(length(off), hn::Set(d, lattice.step));
  const M out = hn::Gt(result.outside, hn::Set(d, 2e-6F + 0.002F * lattice.step));
  const V positive = hn::Max(result.distance, zero);
  const V bound = hn::Sqrt(hn::MulAdd(positive, positive, hn::Mul(result.outside, result.outside)));
  result.distance = hn::IfThenElse(out, bound, result.distance);
  const V keep = hn::IfThenElse(out, zero, one);
  result.gradient = scaled(result.gradient, keep);
  return result;
}

/// The selected lanes of eight, first to last, for every selection.
constexpr std::array<std::array<std::uint8_t, 8>, 256> selectionsOfEight() {
  std::array<std::array<std::uint8_t, 8>, 256> lanes{};
  for (unsigned bits = 0; bits < 256; ++bits) {
    int n = 0;
    for (std::uint8_t lane = 0; lane < 8; ++lane) {
      if ((bits >> lane & 1) != 0) lanes[bits][n++] = lane;
    }
  }
  return lanes;
}
[[maybe_unused]] constexpr auto kSelectionsOfEight = selectionsOfEight();

/// Stores the selected lanes one after the other and returns their number. Writes a whole vector (where a processor has
/// a narrower store of selected lanes it can be far slower), so `to` has room for a group more.
template <class DT>
HWY_INLINE std::size_t storeSelected(DT dt, hn::Mask<DT> mask, hn::Vec<DT> value, hn::TFromD<DT>* to) {
#if HWY_TARGET == HWY_AVX2  // Highway's own Compress has GCC copy its table to the stack each time
  std::uint8_t bits = 0;
  hn::StoreMaskBits(dt, mask, &bits);
  const hn::Rebind<std::uint8_t, DI> bytes;
  const VI lanes = hn::PromoteTo(DI(), hn::LoadU(bytes, kSelectionsOfEight[bits].data()));
  hn::StoreU(hn::TableLookupLanes(value, hn::IndicesFromVec(dt, lanes)), dt, to);
  return hwy::PopCount(bits);
#else
  hn::StoreU(hn::Compress(value, mask), dt, to);
  return hn::CountTrue(dt, mask);
#endif
}
HWY_INLINE std::size_t storeSelected(M mask, V value, float* to) { return storeSelected(D(), mask, value, to); }
HWY_INLINE std::size_t storeSelected(M mask, hn::Vec<DU> value, std::uint32_t* to) {
  const DU du;
  return storeSelected(du, hn::RebindMask(du, mask), value, to);
}

/// first, first + 1, ... (Highway's Iota writes them one by one, and then waits for what it wrote)
HWY_INLINE hn::Vec<DU> numbersFrom(std::size_t first) {
  const DU du;
  return hn::Add(hn::Load(du, kNumbers.data()), hn::Set(du, static_cast<std::uint32_t>(first)));
}

std::size_t SelectBlocks(const Lattice<std::uint32_t>& coarse, const SphereTree& tree, const Placement& placement,
                         std::uint32_t from, std::uint32_t to, std::uint32_t* ids, std::uint32_t* firsts) {
  const D d;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  const Frame frame = Frame::of(coarse);
  const Transform steps = stepsAfter(Transform(placement), frame);
  std::size_t count = 0;
  const auto& super = tree.superblocks;
  const V size[3] = {hn::Set(d, static_cast<float>(coarse.size[0] - 1)),
                     hn::Set(d, static_cast<float>(coarse.size[1] - 1)),
                     hn::Set(d, static_cast<float>(coarse.size[2] - 1))};
  alignas(64) std::uint32_t passing[kGroup];
  for (std::size_t i = 0; i < super.size(); i += N) {
    const V3 u = steps(load(&super.x[i], &super.y[i], &super.z[i]));
    const V zero = hn::Zero(d);
    const auto off = [&](V a, V last) { return hn::Sub(a, hn::Min(hn::Max(a, zero), last)); };
    const V out = length({off(u.x, size[0]), off(u.y, size[1]), off(u.z, size[2])});
    const V reach = hn::Mul(hn::LoadU(d, &super.radius[i]), frame.inverse);
    const M near = hn::Le(out, hn::Add(reach, hn::Set(d, 1.0F)));
    const std::size_t n = storeSelected(near, numbersFrom(i), passing);
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t begin = static_cast<std::size_t>(passing[k]) * kGroup;
      for (std::size_t b = begin; b < std::min(begin + kGroup, tree.blocks.size()); b += N) {
        M inside;
        const V3 at = steps(load(&tree.blocks.x[b], &tree.blocks.y[b], &tree.blocks.z[b]));
        const VI node = nearestNode(frame, at, inside);
        const auto cell =
            hn::BitCast(du, hn::GatherIndex(DI(), reinterpret_cast<const std::int32_t*>(coarse.value.data()), node));
        const auto first = hn::And(cell, hn::Set(du, 0xFFFFU)), last = hn::ShiftRight<16>(cell);
        const auto touch = hn::AndNot(hn::Lt(last, hn::Set(du, from)), hn::Lt(first, hn::Set(du, to)));
        const M mask = hn::And(inside, hn::RebindMask(d, touch));
        storeSelected(mask, hn::Max(first, hn::Set(du, from)), firsts + count);
        count += storeSelected(mask, numbersFrom(b), ids + count);
      }
    }
  }
  return count;
}

void SelectPoints(const Lattice<std::uint32_t>& fine, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                  const Placement& placement, std::uint32_t from, std::uint32_t to, WaitingPoints& points) {
  const D d;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  const Frame frame = Frame::of(fine);
  const Transform moved(placement), steps = stepsAfter(moved, frame);
  std::size_t count = points.count;
  for (const std::uint32_t block : blocks) {
    const std::size_t begin = static_cast<std::size_t>(block) * kGroup;
    for (std::size_t i = begin; i < begin + kGroup; i += N) {
      M inside;
      const V3 given = load(&shell.point[0][i], &shell.point[1][i], &shell.point[2][i]);
      const VI node = nearestNode(frame, steps(given), inside);
      const auto cell =
          hn::BitCast(du, hn::GatherIndex(DI(), reinterpret_cast<const std::int32_t*>(fine.value.data()), node));
      const auto first = hn::And(cell, hn::Set(du, 0xFFFFU));
      const auto last = hn::ShiftRight<16>(cell);
      const auto touch = hn::And(hn::RebindMask(du, inside),
                                 hn::AndNot(hn::Lt(last, hn::Set(du, from)), hn::Lt(first, hn::Set(du, to))));
      const M mask = hn::RebindMask(d, touch);
      if (hn::AllFalse(d, mask)) continue;
      const V3 p = moved(given);
      storeSelected(mask, p.x, points.x + count);
      storeSelected(mask, p.y, points.y + count);
      storeSelected(mask, p.z, points.z + count);
      count += storeSelected(mask, hn::Max(first, hn::Set(du, from)), points.first + count);
    }
  }
  points.count = count;
}

std::uint32_t TakeDue(std::uint32_t due, std::uint32_t until, WaitingPoints& waiting, WaitingPoints& to) {
  const D d;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  auto least = hn::Set(du, until);
  for (std::size_t i = 0; i < waiting.count; i += N) {
    const auto there = hn::FirstN(du, waiting.count - i);
    const auto first = hn::IfThenElse(there, hn::LoadU(du, waiting.first + i), hn::Set(du, Motion::kNever));
    const auto now = hn::Lt(first, hn::Set(du, std::min(due, until)));
    const auto rest = hn::IfThenElse(now, hn::Set(du, Motion::kNever), first);
    least = hn::Min(least, rest);
    if (hn::AllFalse(du, now)) continue;  // most often
    hn::StoreU(rest, du, waiting.first + i);
    const M taken = hn::RebindMask(d, now);
    storeSelected(taken, hn::LoadU(d, waiting.x + i), to.x + to.count);
    storeSelected(taken, hn::LoadU(d, waiting.y + i), to.y + to.count);
    storeSelected(taken, hn::LoadU(d, waiting.z + i), to.z + to.count);
    to.count += storeSelected(taken, first, to.first + to.count);
  }
  return hn::GetLane(hn::MinOfLanes(du, least));
}

constexpr int kMostNodes = 24;

/// The smallest distance of each point to a motion's leaves at its own s, the change of that distance with s, and the
/// point's speed there.
HWY_INLINE void motionDistance(const Motion& motion, std::span<const PlacedGrid> grids, const V3& p, V s, V& distance,
                               V& change, V& speed) {
  const D d;
  V3 at[kMostNodes], velocity[kMostNodes];
  const V3 still = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
  const auto all = [&](double x) { return hn::Set(d, static_cast<float>(x)); };
  for (std::size_t i = 0; i < motion.nodes.size(); ++i) {
    const MotionNode& node = motion.nodes[i];
    const V3 y = move(node.fromParent, node.parent < 0 ? p : at[node.parent]);
    const V3 v = node.parent < 0 ? still : rotate(node.fromParent, velocity[node.parent]);
    const V free = hn::MulAdd(all(node.rate), s, all(node.offset));
    const V q = hn::Min(hn::Max(free, all(node.lower)), all(node.upper));
    const V rate = hn::IfThenElseZero(hn::Eq(q, free), all(node.rate));
    if (node.turns) {
      const V c = hn::Cos(d, q), n = hn::Sin(d, q);
      at[i].x = hn::MulAdd(c, y.x, hn::Mul(n, y.y));
      at[i].y = hn::Sub(hn::Mul(c, y.y), hn::Mul(n, y.x));
      at[i].z = y.z;
      velocity[i].x = hn::MulAdd(rate, at[i].y, hn::MulAdd(c, v.x, hn::Mul(n, v.y)));
      velocity[i].y = hn::Sub(hn::Sub(hn::Mul(c, v.y), hn::Mul(n, v.x)), hn::Mul(rate, at[i].x));
      velocity[i].z = v.z;
    } else {
      at[i] = {y.x, y.y, hn::Sub(y.z, q)};
      velocity[i] = {v.x, v.y, hn::Sub(v.z, rate)};
    }
  }
  distance = hn::Set(d, kInfinity);
  change = hn::Zero(d);
  speed = hn::Set(d, 1e-6F);
  for (std::size_t k = 0; k < motion.leaves.size(); ++k) {
    const MotionLeaf& leaf = motion.leaves[k];
    const V3 w = rotate(leaf.fromNode, velocity[leaf.node]);
    const Sampled sampled = sample(*grids[k].grid, move(leaf.fromNode, at[leaf.node]));
    const M nearer = hn::Lt(sampled.distance, distance);
    distance = hn::IfThenElse(nearer, sampled.distance, distance);
    change = hn::IfThenElse(nearer, dot(sampled.gradient, w), change);
    speed = hn::Max(speed, length(w));
  }
}

float RefineMotion(const Motion& motion, std::span<const PlacedGrid> grids, const Points& points, const float* start,
                   float from, float best) {
  constexpr int kRounds = 40;
  constexpr float kTouch = 5e-6F;    // m: found
  constexpr float kPassed = 4e-4F;   // m
  constexpr float kCareful = 2e-4F;  // m, of a step where the distance does not say how far
  constexpr float kGrazing = 0.05F;  // of the speed
  const D d;
  const std::size_t N = hn::Lanes(d);
  const V begin = hn::Set(d, from);
  // The group's vectors advance side by side, so that what one round finds ends the others' search after the same round
  // for any width.
  alignas(64) float sOf[kGroup], beforeOf[kGroup], distanceOf[kGroup], changeOf[kGroup], activeOf[kGroup];
  for (std::size_t i = 0; i < kGroup; i += N) {
    const V s = hn::LoadU(d, start + i);
    hn::Store(s, d, sOf + i);
    hn::Store(s, d, beforeOf + i);
    hn::Store(hn::Set(d, kInfinity), d, distanceOf + i);
    hn::Store(hn::Zero(d), d, changeOf + i);
    hn::Store(hn::IfThenElseZero(hn::Lt(s, hn::Set(d, best)), hn::Set(d, 1.0F)), d, activeOf + i);
  }
  float end = best;
  bool searching = true;
  for (int round = 0; round < kRounds && searching; ++round) {
    V found = hn::Set(d, end);
    for (std::size_t i = 0; i < kGroup; i += N) {
      M active = hn::Gt(hn::Load(d, activeOf + i), hn::Zero(d));
      if (hn::AllFalse(d, active)) continue;
      const V s = hn::Load(d, sOf + i), before = hn::Load(d, beforeOf + i);
      const V lastDistance = hn::Load(d, distanceOf + i), lastChange = hn::Load(d, changeOf + i);
      V distance, change, speed;
      motionDistance(motion, grids, load(points.x + i, points.y + i, points.z + i), s, distance, change, speed);
      // Passed by: the tangents on both sides meet below the closest approach. Where that is close the surface between
      // the points may have been touched.
      const V apex =
          hn::Div(hn::Sub(hn::MulAdd(change, hn::Sub(before, s), distance), lastDistance), hn::Sub(lastChange, change));
      const V closest = hn::MulAdd(lastChange, apex, lastDistance);
      const M passed = hn::And(hn::And(hn::Lt(lastChange, hn::Zero(d)), hn::Gt(change, hn::Zero(d))),
                               hn::Lt(closest, hn::Set(d, kPassed)));
      const M approaching = hn::Lt(change, hn::Mul(speed, hn::Set(d, -kGrazing)));
      const M inside = hn::Lt(distance, hn::Zero(d));
      const M within = hn::Le(hn::Abs(distance), hn::Set(d, kTouch));
      const M atStart = hn::And(inside, hn::Le(s, begin));
      // Inside without approaching: on its way out from the start, or come in at a grazing angle since.
      const M grazed = hn::And(hn::Lt(distance, hn::Set(d, -kTouch)), hn::Not(approaching));
      const M leaving = hn::And(grazed, atStart);
      const M hit = hn::And(active, hn::Or(hn::And(approaching, hn::Or(within, atStart)), hn::AndNot(leaving, grazed)));
      found = hn::IfThenElse(hit, hn::Min(found, s), found);
      const M close = hn::AndNot(hit, hn::And(active, hn::AndNot(inside, passed)));
      found = hn::IfThenElse(close, hn::Min(found, hn::Max(hn::Min(hn::Add(before, apex), s), before)), found);
      active = hn::AndNot(hn::Or(close, hn::Or(hit, leaving)), active);
      const V newton = hn::Div(distance, hn::Neg(change));
      const V careful = hn::Div(hn::Max(distance, hn::Set(d, kCareful)), speed);
      V step = hn::IfThenElse(approaching, newton, careful);
      const V longest = hn::Div(hn::Set(d, 6e-3F), speed);
      step = hn::Min(hn::Max(step, hn::Neg(longest)), longest);
      hn::Store(hn::IfThenElse(active, hn::Max(hn::Add(s, step), begin), s), d, sOf + i);
      hn::Store(s, d, beforeOf + i);
      hn::Store(distance, d, distanceOf + i);
      hn::Store(change, d, changeOf + i);
      hn::Store(hn::IfThenElseZero(active, hn::Set(d, 1.0F)), d, activeOf + i);
    }
    end = hn::GetLane(hn::MinOfLanes(d, found));
    searching = false;
    for (std::size_t i = 0; i < kGroup; i += N) {
      const V active = hn::Load(d, activeOf + i);
      const M still = hn::And(hn::Gt(active, hn::Zero(d)), hn::Lt(hn::Load(d, sOf + i), hn::Set(d, end)));
      hn::Store(hn::IfThenElseZero(still, active), d, activeOf + i);
      searching = searching || !hn::AllFalse(d, still);
    }
  }
  // Rounds used up: as far as it is known to be free, for the triangles to say.
  for (int i = 0; i < kGroup && searching; ++i) {
    if (activeOf[i] > 0) end = std::min(end, sOf[i]);
  }
  return end < best ? end : kInfinity;
}

void Distances(std::span<const PlacedGrid> grids, const Points& points, float* distance) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  for (std::size_t i = 0; i < kGroup; i += N) {
    const V3 p = load(points.x + i, points.y + i, points.z + i);
    V least = hn::Set(d, kInfinity);
    for (const PlacedGrid& grid : grids) least = hn::Min(least, sample(*grid.grid, move(grid.placement, p)).distance);
    hn::StoreU(least, d, distance + i);
  }
}

/// An interval of z at a node, and whether there is one.
struct Interval {
  V bottom, top;
  M isThere;
};
HWY_INLINE Interval gatherInterval(const ColumnField& field, int k, VI node) {
  const D d;
  const VI packed = hn::GatherIndex(DI(), field.intervals.value.data()->data() + k, hn::ShiftLeft<1>(node));
  const VI bottom = hn::ShiftRight<16>(hn::ShiftLeft<16>(packed)), top = hn::ShiftRight<16>(packed);
  const V unit = hn::Set(d, field.unit);
  return {hn::Mul(hn::ConvertTo(d, bottom), unit), hn::Mul(hn::ConvertTo(d, top), unit),
          hn::Not(hn::RebindMask(d, hn::Gt(bottom, top)))};
}

/// x and y in a column field's steps, z in metres.
HWY_INLINE Transform columnSteps(const Transform& X, const Frame& lattice) {
  Transform result = stepsAfter(X, lattice);
  result.row[2] = X.row[2];
  result.translation.z = X.translation.z;
  return result;
}

std::size_t SelectColumns(const ColumnField& coarse, const SphereTree& tree, const Placement& placement, float from,
                          std::uint32_t* ids) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  std::size_t count = 0;
  const auto& lattice = coarse.intervals;
  const Frame frame = Frame::of(lattice);
  const Transform steps = columnSteps(Transform(placement), frame);
  alignas(64) std::uint32_t passing[kGroup];
  const auto& super = tree.superblocks;
  for (std::size_t i = 0; i < super.size(); i += N) {
    const V3 u = steps(load(&super.x[i], &super.y[i], &super.z[i]));
    const V zero = hn::Zero(d);
    const auto off = [&](V a, int size) {
      return hn::Sub(a, hn::Min(hn::Max(a, zero), hn::Set(d, static_cast<float>(size - 1))));
    };
    const V ox = off(u.x, lattice.size[0]), oy = off(u.y, lattice.size[1]);
    const V reach = hn::MulAdd(hn::LoadU(d, &super.radius[i]), frame.inverse, hn::Set(d, 1.0F));
    const M near = hn::Le(hn::MulAdd(ox, ox, hn::Mul(oy, oy)), hn::Mul(reach, reach));
    const std::size_t n = storeSelected(near, numbersFrom(i), passing);
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t begin = static_cast<std::size_t>(passing[k]) * kGroup;
      for (std::size_t b = begin; b < std::min(begin + kGroup, tree.blocks.size()); b += N) {
        M inside;
        const V3 p = steps(load(&tree.blocks.x[b], &tree.blocks.y[b], &tree.blocks.z[b]));
        const VI node = nearestNode(frame, {p.x, p.y, zero}, inside);
        const Interval highest = gatherInterval(coarse, 0, node);
        const M real = hn::And(highest.isThere, hn::Lt(hn::Abs(p.z), hn::Set(d, 1e3F)));
        const M touch = hn::And(real, hn::And(inside, hn::Ge(hn::Sub(highest.top, p.z), hn::Set(d, from))));
        count += storeSelected(touch, numbersFrom(b), ids + count);
      }
    }
  }
  return count;
}

std::size_t ColumnPoints(const ColumnField& fine, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                         const Placement& placement, float from, float* x, float* y, float* z, std::uint32_t* nodes) {
  const D d;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  std::size_t count = 0;
  const Frame frame = Frame::of(fine.intervals);
  const Transform moved(placement), steps = columnSteps(moved, frame);
  for (const std::uint32_t block : blocks) {
    const std::size_t begin = static_cast<std::size_t>(block) * kGroup;
    for (std::size_t i = begin; i < begin + kGroup; i += N) {
      M inside;
      const V3 given = load(&shell.point[0][i], &shell.point[1][i], &shell.point[2][i]);
      const V3 u = steps(given);
      const VI node = nearestNode(frame, {u.x, u.y, hn::Zero(d)}, inside);
      const Interval highest = gatherInterval(fine, 0, node);
      const M above = hn::Ge(hn::Sub(highest.top, u.z), hn::Set(d, from));
      const M touch = hn::And(inside, hn::And(highest.isThere, above));
      if (hn::AllFalse(d, touch)) continue;
      const V3 p = moved(given);
      storeSelected(touch, p.x, x + count);
      storeSelected(touch, p.y, y + count);
      storeSelected(touch, p.z, z + count);
      count += storeSelected(touch, hn::BitCast(du, node), nodes + count);
    }
  }
  return count;
}

void ColumnIntervals(const ColumnField& field, std::size_t count, const std::uint32_t* nodes, const float* z,
                     float* const low[2], float* const high[2]) {
  const D d;
  const DI di;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  for (std::size_t i = 0; i < count; i += N) {
    const auto real = hn::FirstN(du, count - i);
    const VI node = hn::BitCast(di, hn::IfThenElseZero(real, hn::LoadU(du, nodes + i)));
    const V above = hn::LoadU(d, z + i);
    for (int k = 0; k < 2; ++k) {
      const Interval interval = gatherInterval(field, k, node);
      const V from = hn::Sub(interval.bottom, above), to = hn::Sub(interval.top, above);
      hn::StoreU(hn::IfThenElse(interval.isThere, from, hn::Set(d, kInfinity)), d, low[k] + i);
      hn::StoreU(hn::IfThenElse(interval.isThere, to, hn::Set(d, -kInfinity)), d, high[k] + i);
    }
  }
}

float Climb(float t, std::size_t count, const float* const low[2], const float* const high[2]) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  for (float before = -1; before != t;) {
    before = t;
    V now = hn::Set(d, t);
    for (int k = 0; k < 2; ++k) {
      for (std::size_t i = 0; i < count; i += N) {
        const V end = hn::LoadU(d, high[k] + i);
        const M run =
            hn::And(hn::And(hn::Le(hn::LoadU(d, low[k] + i), now), hn::Gt(end, now)), hn::FirstN(d, count - i));
        now = hn::IfThenElse(run, end, now);
      }
    }
    t = hn::GetLane(hn::MaxOfLanes(d, now));
  }
  return t;
}

std::size_t LanesEndingIn(float floor, float top, std::size_t count, const float* low, const float* high,
                          std::uint32_t* ids) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  std::size_t listed = 0;
  for (std::size_t i = 0; i < count; i += N) {
    const M ends = hn::Gt(hn::Min(hn::LoadU(d, high + i), hn::Set(d, top)), hn::Set(d, floor));
    const M met = hn::And(hn::And(ends, hn::Le(hn::LoadU(d, low + i), hn::Set(d, top))), hn::FirstN(d, count - i));
    if (hn::AllFalse(d, met)) continue;  // most often
    listed += storeSelected(met, numbersFrom(i), ids + listed);
  }
  return listed;
}

void RefineExit(const PlacedGrid& grid, const Points& points, const float* start, float best, float* left) {
  constexpr int kRounds = 10;
  constexpr float kTouch = 5e-6F;  // m
  constexpr float kGrazing = 0.05F;
  const D d;
  const std::size_t N = hn::Lanes(d);
  const V3 along = rotate(grid.placement, {hn::Zero(d), hn::Zero(d), hn::Set(d, 1.0F)});
  for (std::size_t i = 0; i < kGroup; i += N) {
    const V3 p = move(grid.placement, load(points.x + i, points.y + i, points.z + i));
    V t = hn::LoadU(d, start + i);
    V result = hn::Set(d, -kInfinity);
    M active = hn::Gt(t, hn::Set(d, best));
    for (int round = 0; round < kRounds && !hn::AllFalse(d, active); ++round) {
      const V3 at = {hn::MulAdd(along.x, t, p.x), hn::MulAdd(along.y, t, p.y), hn::MulAdd(along.z, t, p.z)};
      const Sampled sampled = sample(*grid.grid, at);
      const V change = dot(sampled.gradient, along);
      const M hit = hn::And(active, hn::Le(hn::Abs(sampled.distance), hn::Set(d, kTouch)));
      result = hn::IfThenElse(hit, t, result);
      const M inside = hn::Lt(sampled.distance, hn::Zero(d));
      const M opening = hn::Gt(change, hn::Set(d, kGrazing));
      // Inside where going down does not lead out: the start itself is blocked.
      const M stuck = hn::And(active, hn::AndNot(hit, hn::AndNot(opening, inside)));
      result = hn::IfThenElse(stuck, t, result);
      active = hn::AndNot(hn::Or(hit, stuck), active);
      const V newton = hn::Div(sampled.distance, change);
      const V careful = hn::Max(sampled.distance, hn::Set(d, 2e-4F));
      V step = hn::IfThenElse(opening, newton, careful);
      step = hn::Min(hn::Max(step, hn::Set(d, -6e-3F)), hn::Set(d, 6e-3F));
      t = hn::IfThenElse(active, hn::Sub(t, step), t);
      active = hn::And(active, hn::Gt(t, hn::Set(d, best)));
    }
    hn::StoreU(result, d, left + i);
  }
}

/// Which spheres may come within `margin` of a grid's surface, by the nearest node's value.
struct NearTest {
  Frame frame;
  Transform steps;
  V3 last;  // nodes
  V margin, squaredStep, offNode;
  const std::int32_t* nodePairs;

  HWY_INLINE NearTest(const PlacedGrid& placed, float m)
      : frame(Frame::of(placed.grid->distance)),
        steps(stepsAfter(Transform(placed.placement), frame)),
        margin(hn::Set(D(), m)),
        nodePairs(placed.grid->nodePairs.data()) {
    const D d;
    const Lattice<float>& lattice = placed.grid->distance;
    const V one = hn::Set(d, 1.0F);
    last = {hn::Sub(frame.size.x, one), hn::Sub(frame.size.y, one), hn::Sub(frame.size.z, one)};
    squaredStep = hn::Set(d, lattice.step * lattice.step);
    offNode = hn::Set(d, 0.8661F * lattice.step);
  }

  HWY_INLINE M operator()(const float* x, const float* y, const float* z, const float* radius) const {
    const D d;
    const DI di;
    const V3 u = steps(load(x, y, z));
    const V zero = hn::Zero(d), half = hn::Set(d, 0.5F);
    const auto clamp = [&](V a, V most) { return hn::Min(hn::Max(a, zero), most); };
    const V3 c = {clamp(u.x, last.x), clamp(u.y, last.y), clamp(u.z, last.z)};
    const auto node = [&](V a) { return hn::ConvertTo(di, hn::Add(a, half)); };
    const V3 off = u - c;
    const V reach = hn::Add(hn::LoadU(d, radius), margin);
    const M close = hn::Le(hn::Mul(dot(off, off), squaredStep), hn::Mul(reach, reach));
    const V value = gatherPair(nodePairs, frame.index(node(c.x), node(c.y), node(c.z))).here;
    return hn::And(close, hn::Le(value, hn::Add(reach, offNode)));
  }
};

/// What may come within `margin` of a surface, by the plane of the node nearest to its middle (Planes).
struct PlaneTest {
  Frame frame;
  Transform moved;
  V3 last;  // nodes
  V step, margin, reach;
  const std::int32_t* nodes;

  HWY_INLINE PlaneTest(const Planes& planes, const Placement& placement, float m)
      : frame(Frame::of(planes.nodes)),
        moved(placement),
        step(hn::Set(D(), planes.nodes.step)),
        margin(hn::Set(D(), m)),
        reach(hn::Set(D(), planes.reach)),
        nodes(reinterpret_cast<const std::int32_t*>(planes.nodes.value.data())) {
    const V one = hn::Set(D(), 1.0F);
    last = {hn::Sub(frame.size.x, one), hn::Sub(frame.size.y, one), hn::Sub(frame.size.z, one)};
  }

  /// In the frame of the points: what lies at q is g.q + offset above the plane of the node.
  struct Seen {
    V3 g;
    V offset;
    V toMiddle;  // from the node
    V outside;   // of the lattice
  };

  HWY_INLINE Seen from(const V3& middle) const {
    const D d;
    const DI di;
    const V3 center = moved(middle);
    const V3 u = inSteps(frame, center);
    const auto clamp = [&](V a, V most) { return hn::Min(hn::Max(a, hn::Zero(d)), most); };
    const V3 c = {clamp(u.x, last.x), clamp(u.y, last.y), clamp(u.z, last.z)};
    const auto nearest = [&](V a) { return hn::ConvertTo(di, hn::Add(a, hn::Set(d, 0.5F))); };
    const VI x = nearest(c.x), y = nearest(c.y), z = nearest(c.z);
    const auto along = [&](VI i, V origin) { return hn::MulAdd(hn::ConvertTo(d, i), step, origin); };
    const V3 node = {along(x, frame.origin.x), along(y, frame.origin.y), along(z, frame.origin.z)};
    const VI at = hn::ShiftLeft<1>(frame.index(x, y, z));
    const VI first = hn::GatherIndex(di, nodes, at), second = hn::GatherIndex(di, nodes + 1, at);
    const auto low = [&](VI a) { return hn::ConvertTo(d, hn::ShiftRight<16>(hn::ShiftLeft<16>(a))); };
    const auto high = [&](VI a) { return hn::ConvertTo(d, hn::ShiftRight<16>(a)); };
    const V3 g = scaled({low(first), high(first), low(second)}, hn::Set(d, 1.0F / Planes::kDirectionUnit));
    const V height = hn::Mul(high(second), hn::Set(d, Planes::kUnit));
    // g.(R p + t - n) = (R^T g).p + g.(t - n)
    const auto back = [&](V a, V b, V e) { return hn::MulAdd(a, g.x, hn::MulAdd(b, g.y, hn::Mul(e, g.z))); };
    return {{back(moved.row[0].x, moved.row[1].x, moved.row[2].x), back(moved.row[0].y, moved.row[1].y, moved.row[2].y),
             back(moved.row[0].z, moved.row[1].z, moved.row[2].z)},
            hn::Add(dot(g, moved.translation - node), height),
            length(center - node),
            hn::Mul(length(u - c), step)};
  }

  /// `lowest`: of g.q; `radius`: of what it is, around its middle.
  HWY_INLINE M operator()(const Seen& seen, V lowest, V radius) const {
    const M isKnown = hn::Lt(hn::Add(hn::Add(seen.toMiddle, radius), margin), reach);
    return hn::Not(hn::And(isKnown, hn::Gt(hn::Add(lowest, seen.offset), margin)));
  }
};

std::size_t NearBlocks(const PlacedGrid& grid, const SphereTree& tree, float margin, std::uint32_t* ids) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  const NearTest isNear(grid, margin);
  std::size_t count = 0;
  alignas(64) std::uint32_t passing[kGroup];
  const auto& super = tree.superblocks;
  const auto& blocks = tree.blocks;
  for (std::size_t i = 0; i < super.size(); i += N) {
    const M near = isNear(&super.x[i], &super.y[i], &super.z[i], &super.radius[i]);
    const std::size_t n = storeSelected(near, numbersFrom(i), passing);
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t begin = static_cast<std::size_t>(passing[k]) * kGroup;
      for (std::size_t b = begin; b < std::min(begin + kGroup, blocks.size()); b += N) {
        const M touch = isNear(&blocks.x[b], &blocks.y[b], &blocks.z[b], &blocks.radius[b]);
        count += storeSelected(touch, numbersFrom(b), ids + count);
      }
    }
  }
  return count;
}

std::size_t NearBoxes(const PlacedGrid& grid, const ObjectShell& shell, float margin, std::uint32_t* ids) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  const NearTest isNear(grid, margin);
  const Planes& planes = grid.grid->blockPlanes;
  const PlaneTest byPlane(planes, grid.placement, margin);
  const V beyond = hn::Set(d, margin - planes.reach);
  std::size_t count = 0;
  alignas(64) std::uint32_t passing[kGroup];
  const auto& super = shell.triangleTree.superblocks;
  const auto& box = shell.triangleBox;
  const std::size_t blocks = box[0].size();
  for (std::size_t i = 0; i < super.size(); i += N) {
    const M near = isNear(&super.x[i], &super.y[i], &super.z[i], &super.radius[i]);
    const std::size_t n = storeSelected(near, numbersFrom(i), passing);
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t begin = static_cast<std::size_t>(passing[k]) * kGroup;
      for (std::size_t b = begin; b < std::min(begin + kGroup, blocks); b += N) {
        const V3 middle = load(&box[0][b], &box[1][b], &box[2][b]), half = load(&box[3][b], &box[4][b], &box[5][b]);
        const auto seen = byPlane.from(middle);
        const V3 steep = {hn::Abs(seen.g.x), hn::Abs(seen.g.y), hn::Abs(seen.g.z)};
        const V radius = length(half);
        // What lies outside the lattice is the reach farther away.
        const M isWithin = hn::Le(seen.outside, hn::Add(radius, beyond));
        const M mayBe = hn::Or(isWithin, hn::Le(seen.outside, hn::Zero(d)));
        const M touch = hn::And(mayBe, byPlane(seen, hn::Sub(dot(seen.g, middle), dot(steep, half)), radius));
        count += storeSelected(touch, numbersFrom(b), ids + count);
      }
    }
  }
  return count;
}

std::size_t NearTriangles(const PlacedGrid& grid, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                          float margin, std::uint32_t* scratch, std::uint32_t* ids) {
  const D d;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  const NearTest isNear(grid, margin);
  std::size_t passing = 0;
  for (const std::uint32_t block : blocks) {
    const std::size_t begin = static_cast<std::size_t>(block) * kGroup;
    for (std::size_t i = begin; i < begin + kGroup; i += N) {
      const M near = isNear(&shell.sphere[0][i], &shell.sphere[1][i], &shell.sphere[2][i], &shell.sphere[3][i]);
      passing += storeSelected(near, numbersFrom(i), scratch + passing);
    }
  }
  for (std::size_t i = passing; i < (passing + N - 1) / N * N; ++i) scratch[i] = 0;
  std::size_t count = 0;
  const PlaneTest byPlane(grid.grid->planes, grid.placement, margin);
  for (std::size_t i = 0; i < passing; i += N) {
    const auto triangle = loadRecords<16>(shell.triangle.data(), scratch + i);
    const auto seen = byPlane.from(triangle.vector(12));
    const V lowest = hn::Min(dot(seen.g, triangle.vector(0)),
                             hn::Min(dot(seen.g, triangle.vector(3)), dot(seen.g, triangle.vector(6))));
    const M near = byPlane(seen, lowest, triangle.value[15]);
    count += storeSelected(hn::And(near, hn::FirstN(d, passing - i)), hn::LoadU(du, scratch + i), ids + count);
  }
  return count;
}

void PlaceTriangles(const ObjectShell& shell, const Placement& placement, kernels::NearTriangles& near) {
  const D d;
  const std::size_t N = hn::Lanes(d);
  const Transform moved(placement);
  const std::size_t count = near.id.size();
  const std::size_t full = (count + kGroup - 1) / kGroup * kGroup;
  near.id.resize(full, 0);
  near.record.resize(full);
  for (std::size_t i = 0; i < full; i += N) {
    const auto given = loadRecords<12>(shell.triangle.data(), &near.id[i]);
    Fields<12> placed;
    for (int k = 0; k < 12; k += 3) {
      const V3 p = k < 9 ? moved(given.vector(k)) : moved.rotate(given.vector(k));
      placed.value[k] = p.x;
      placed.value[k + 1] = p.y;
      placed.value[k + 2] = p.z;
    }
    storeRecords(placed, &near.record[i]);
  }
  near.id.resize(count);
}

void FindPairs(const LinkGrid& grid, const kernels::NearTriangles& near, float reach, bool facing, Pairs& pairs) {
  const D d;
  const DU du;
  const std::size_t N = hn::Lanes(d);
  const LinkGrid::Triangle* const whole = grid.triangle.data();
  std::size_t count = 0;
  // Neighbours stand together: what a group of near triangles cannot meet is passed over for all of them.
  for (std::size_t group = 0; group < near.id.size(); group += kGroup) {
    alignas(64) float bound[6][kGroup], own[12][kGroup];  // corners and normals in one place
    float around[6];
    for (std::size_t i = 0; i < kGroup; i += N) {
      const auto fields = loadRecords<12>(&near.record[group], &kNumbers[i]);
      for (int k = 0; k < 12; ++k) hn::Store(fields.value[k], d, &own[k][i]);
    }
    for (int axis = 0; axis < 3; ++axis) {
      V lowest = hn::Set(d, kInfinity), highest = hn::Set(d, -kInfinity);
      for (std::size_t i = 0; i < kGroup; i += N) {
        const auto corner = [&](int k) { return hn::Load(d, &own[3 * k + axis][i]); };
        const V p = corner(0), q = corner(1), r = corner(2), margin = hn::Set(d, reach);
        const V lower = hn::Sub(hn::Min(p, hn::Min(q, r)), margin), upper = hn::Add(hn::Max(p, hn::Max(q, r)), margin);
        hn::Store(lower, d, &bound[axis][i]);
        hn::Store(upper, d, &bound[3 + axis][i]);
        const M real = hn::FirstN(d, near.id.size() - std::min(near.id.size(), group + i));
        lowest = hn::IfThenElse(real, hn::Min(lowest, lower), lowest);
        highest = hn::IfThenElse(real, hn::Max(highest, upper), highest);
      }
      around[axis] = hn::GetLane(hn::MinOfLanes(d, lowest));
      around[3 + axis] = hn::GetLane(hn::MaxOfLanes(d, highest));
    }
    // Which of sixteen boxes the group may meet, by index.
    const auto listMet = [&](const Boxes& boxes, std::size_t begin, std::uint32_t* ids) {
      std::size_t n = 0;
      for (std::size_t k = begin; k < begin + kGroup; k += N) {
        const auto along = [&](int axis) {
          return hn::And(hn::Le(hn::LoadU(d, &boxes.bound[axis][k]), hn::Set(d, around[3 + axis])),
                         hn::Ge(hn::LoadU(d, &boxes.bound[3 + axis][k]), hn::Set(d, around[axis])));
        };
        const M met = hn::And(along(0), hn::And(along(1), along(2)));
        n += storeSelected(met, numbersFrom(k), ids + n);
      }
      return n;
    };
    // Which of the listed triangles meet the box of one of the group. Here and below no branch asks for it: it would be
    // guessed wrong as often as not.
    const auto keepMet = [&](std::uint32_t* ids, std::size_t n) {
      std::size_t kept = 0;
      for (std::size_t k = 0; k < n; ++k) {
        const std::uint32_t b = ids[k];
        const float* const box = &whole[b].value[13];
        bool isMet = false;
        for (std::size_t i = 0; i < kGroup; i += N) {
          const auto along = [&](int axis) {
            return hn::And(hn::Le(hn::Set(d, box[axis]), hn::Load(d, &bound[3 + axis][i])),
                           hn::Ge(hn::Set(d, box[3 + axis]), hn::Load(d, &bound[axis][i])));
          };
          isMet |= !hn::AllFalse(d, hn::And(along(0), hn::And(along(1), along(2))));
        }
        ids[kept] = b;
        kept += isMet ? 1 : 0;
      }
      return kept;
    };
    const auto addPairs = [&](std::uint32_t b) {
      if (pairs.a.size() < count + 2 * kGroup) {
        for (auto* array : {&pairs.a, &pairs.b}) array->resize(2 * count + 4 * kGroup);
        for (auto* array : {&pairs.enter, &pairs.leave}) array->resize(2 * count + 4 * kGroup);
      }
      const float* const one = whole[b].value.data();
      const auto value = [&](int k) { return hn::Set(d, one[k]); };
      const V3 n = {value(9), value(10), value(11)};
      for (std::size_t i = 0; i < kGroup; i += N) {
        const auto all = [&](int k) { return load(&own[k][i], &own[k + 1][i], &own[k + 2][i]); };
        const auto within = [&](V first, V second, V third) {
          return hn::And(hn::Le(hn::Min(first, hn::Min(second, third)), hn::Set(d, reach)),
                         hn::Ge(hn::Max(first, hn::Max(second, third)), hn::Set(d, -reach)));
        };
        M may = hn::FirstN(d, near.id.size() - std::min(near.id.size(), group + i));
        for (int axis = 0; axis < 3; ++axis) {
          may = hn::And(may, hn::Le(value(13 + axis), hn::Load(d, &bound[3 + axis][i])));
          may = hn::And(may, hn::Ge(value(16 + axis), hn::Load(d, &bound[axis][i])));
        }
        const V3 corner = all(0), normal = all(9);
        if (facing) may = hn::And(may, hn::Lt(dot(n, normal), hn::Zero(d)));
        const V offset = value(12);
        may = hn::And(may, within(hn::Sub(dot(n, corner), offset), hn::Sub(dot(n, all(3)), offset),
                                  hn::Sub(dot(n, all(6)), offset)));
        const auto side = [&](int k) { return dot(normal, V3{value(k), value(k + 1), value(k + 2)} - corner); };
        may = hn::And(may, within(side(0), side(3), side(6)));
        hn::StoreU(hn::Set(du, b), du, &pairs.b[count]);
        count += storeSelected(may, numbersFrom(group + i), &pairs.a[count]);
      }
    };
    alignas(64) std::uint32_t superblocks[2 * kGroup], blocks[2 * kGroup], triangles[kGroup * kGroup + kGroup];
    for (std::size_t s = 0; s < grid.superblockBoxes.size(); s += kGroup) {
      const std::size_t metAbove = listMet(grid.superblockBoxes, s, superblocks);
      for (std::size_t i = 0; i < metAbove; ++i) {
        const std::size_t met = listMet(grid.blockBoxes, static_cast<std::size_t>(superblocks[i]) * kGroup, blocks);
        std::size_t listed = 0;
        for (std::size_t j = 0; j < met; ++j) {
          listed += listMet(grid.triangleBoxes, static_cast<std::size_t>(blocks[j]) * kGroup, triangles + listed);
        }
        listed = keepMet(triangles, listed);
        for (std::size_t k = 0; k < listed; ++k) addPairs(triangles[k]);
      }
    }
  }
  for (std::size_t j = count; j < (count + kGroup - 1) / kGroup * kGroup; ++j) pairs.a[j] = pairs.b[j] = 0;
  pairs.count = count;
}

void TouchIntervals(const LinkGrid& grid, const kernels::NearTriangles& near, std::size_t count, Pairs& pairs) {
  constexpr float kSlack = 5e-8F;     // m: neighbours overlap rather than leave a gap
  constexpr float kParallel = 1e-9F;  // squared sine
  const D d;
  const std::size_t N = hn::Lanes(d);
  const V slack = hn::Set(d, kSlack);
  for (std::size_t i = 0; i < count; i += N) {
    const auto ofNear = loadRecords<16>(near.record.data(), &pairs.a[i]);
    const auto ofLink = loadRecords<12>(grid.triangle.data(), &pairs.b[i]);
    const V3 o[3] = {ofNear.vector(0), ofNear.vector(3), ofNear.vector(6)};
    const V3 w = ofNear.vector(12);
    const V3 l[3] = {ofLink.vector(0), ofLink.vector(3), ofLink.vector(6)};
    V first = hn::Set(d, kInfinity), last = hn::Set(d, -kInfinity);
    const auto take = [&](M valid, V tau) {
      first = hn::IfThenElse(valid, hn::Min(first, tau), first);
      last = hn::IfThenElse(valid, hn::Max(last, tau), last);
    };
    const V3 oe[3] = {o[1] - o[0], o[2] - o[1], o[0] - o[2]};
    const V3 le[3] = {l[1] - l[0], l[2] - l[1], l[0] - l[2]};
    // How far beyond its ends each edge reaches, as a part of its length.
    V beyondObject[3], beyondLink[3], objectLength[3], linkLength[3];
    for (int k = 0; k < 3; ++k) {
      objectLength[k] = length(oe[k]);
      linkLength[k] = length(le[k]);
      beyondObject[k] = hn::Div(slack, objectLength[k]);
      beyondLink[k] = hn::Div(slack, linkLength[k]);
    }
    // Corners of one against the face of the other; `sense` turns the motion around for the link's corners.
    const auto cornersAgainst = [&](const V3* corner, const V3* face, const V3* edge, const V* edgeLength,
                                    float sense) {
      const V3 n = cross(edge[0], edge[1]);
      const V across = hn::Mul(length(n), hn::Neg(slack));  // -slack times 2 area
      const V approach = hn::Mul(dot(n, w), hn::Set(d, sense));
      for (int k = 0; k < 3; ++k) {
        const V3 r = corner[k] - face[0];
        const V tau = hn::Neg(hn::Div(dot(n, r), approach));
        const V way = hn::Mul(tau, hn::Set(d, sense));
        const V3 q = {hn::MulAdd(way, w.x, r.x), hn::MulAdd(way, w.y, r.y), hn::MulAdd(way, w.z, r.z)};
        // Barycentric coordinates times (2 area)^2.
        const V u = dot(cross(edge[0], q), n);
        const V3 q1 = q - edge[0];
        const V v = dot(cross(edge[1], q1), n);
        const V s = dot(cross(edge[2], q), n);
        take(hn::And(hn::Ge(u, hn::Mul(across, edgeLength[0])),
                     hn::And(hn::Ge(v, hn::Mul(across, edgeLength[1])), hn::Ge(s, hn::Mul(across, edgeLength[2])))),
             tau);
      }
    };
    cornersAgainst(o, l, le, linkLength, 1.0F);
    cornersAgainst(l, o, oe, objectLength, -1.0F);
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) {
        const V3 c = cross(oe[j], le[k]);
        const V cc = dot(c, c);
        const V3 r = l[k] - o[j];
        const V tau = hn::Div(dot(c, r), dot(c, w));
        const V3 q = {hn::NegMulAdd(tau, w.x, r.x), hn::NegMulAdd(tau, w.y, r.y), hn::NegMulAdd(tau, w.z, r.z)};
        const V onObject = dot(cross(q, le[k]), c), onLink = dot(cross(q, oe[j]), c);  // times cc
        const M crossing = hn::Gt(cc, hn::Mul(hn::Set(d, kParallel), hn::Mul(dot(oe[j], oe[j]), dot(le[k], le[k]))));
        const auto on = [&](V x, V beyond) {
          const V before = hn::Mul(beyond, cc);
          return hn::And(hn::Ge(x, hn::Neg(before)), hn::Le(x, hn::Add(cc, before)));
        };
        take(hn::And(crossing, hn::And(on(onObject, beyondObject[j]), on(onLink, beyondLink[k]))), tau);
      }
    }
    hn::StoreU(first, d, &pairs.enter[i]);
    hn::StoreU(last, d, &pairs.leave[i]);
  }
}

/// What of two triangles is out of reach of each other.
struct Apart {
  M wholly;
  M corner[3];   // of the other triangle, of the face
  M edge[3][3];  // of the other triangle, of each edge of the face
};

/// Rules out by gaps along the face's normal and, in its plane, along the normals of its edges. The gap along an axis
/// of length one is no larger than the distance, however badly the axis is known: slivers need no care.
HWY_INLINE Apart apartFrom(const V3 (&face)[3], const V3 (&other)[3], V reach) {
  constexpr float kLeastSquare = 1e-30F;  // m^4: below, no axis is known
  const D d;
  const V3 side[3] = {face[1] - face[0], face[2] - face[1], face[0] - face[2]};
  const V3 across = cross(side[0], side[1]);
  const V square = dot(across, across);
  const V inverse = hn::Div(hn::Set(d, 1.0F), hn::Sqrt(square));
  const V3 normal = scaled(across, hn::IfThenElseZero(hn::Gt(square, hn::Set(d, kLeastSquare)), inverse));
  Apart apart;
  {
    V of[3], at[3];
    for (int k = 0; k < 3; ++k) {
      of[k] = dot(normal, face[k]);
      at[k] = dot(normal, other[k]);
    }
    const V top = hn::Add(hn::Max(of[0], hn::Max(of[1], of[2])), reach);
    const V bottom = hn::Sub(hn::Min(of[0], hn::Min(of[1], of[2])), reach);
    M above[3], below[3];
    for (int k = 0; k < 3; ++k) {
      above[k] = hn::Gt(at[k], top);
      below[k] = hn::Lt(at[k], bottom);
      apart.corner[k] = hn::Or(above[k], below[k]);
    }
    for (int k = 0; k < 3; ++k) {
      const int next = (k + 1) % 3;
      const M out = hn::Or(hn::And(above[k], above[next]), hn::And(below[k], below[next]));
      for (int j = 0; j < 3; ++j) apart.edge[k][j] = out;
    }
    apart.wholly =
        hn::Or(hn::And(above[0], hn::And(above[1], above[2])), hn::And(below[0], hn::And(below[1], below[2])));
  }
  for (int j = 0; j < 3; ++j) {
    const V3 axis = cross(side[j], normal);  // outward
    const V scaledReach = hn::Mul(reach, length(axis));
    const int end = (j + 1) % 3, opposite = (j + 2) % 3;
    const V begin = dot(axis, face[j]), finish = dot(axis, face[end]);
    const V top = hn::Add(hn::Max(hn::Max(begin, finish), dot(axis, face[opposite])), scaledReach);
    const V bottom = hn::Sub(hn::Min(begin, finish), scaledReach);  // of the edge alone
    M above[3], below[3];
    for (int k = 0; k < 3; ++k) {
      const V at = dot(axis, other[k]);
      above[k] = hn::Gt(at, top);
      below[k] = hn::Lt(at, bottom);
      apart.corner[k] = hn::Or(apart.corner[k], above[k]);
    }
    for (int k = 0; k < 3; ++k) {
      const int next = (k + 1) % 3;
      const M out = hn::Or(hn::And(above[k], above[next]), hn::And(below[k], below[next]));
      apart.edge[k][j] = hn::Or(apart.edge[k][j], out);
    }
    apart.wholly = hn::Or(apart.wholly, hn::And(above[0], hn::And(above[1], above[2])));
  }
  return apart;
}

/// Is there a gap along the common normal of two edges? None is seen where it is not known.
HWY_INLINE M edgesAreApart(const V3& p0, const V3& p1, const V3& q0, const V3& q1, V reach) {
  constexpr float kLeastSquare = 1e-24F;  // m^4
  const D d;
  const V3 axis = cross(p1 - p0, q1 - q0);
  const V square = dot(axis, axis);
  const V a = dot(axis, p0), b = dot(axis, p1), e = dot(axis, q0), f = dot(axis, q1);
  const V gap = hn::Max(hn::Sub(hn::Min(a, b), hn::Max(e, f)), hn::Sub(hn::Min(e, f), hn::Max(a, b)));
  const M isWide = hn::Gt(hn::Mul(gap, hn::Abs(gap)), hn::Mul(hn::Mul(reach, reach), square));
  return hn::And(isWide, hn::Gt(square, hn::Set(d, kLeastSquare)));
}

void KeepClose(const LinkGrid& grid, const ObjectShell& shell, const Placement& placement, float reach,
               WholePairs& pairs) {
  const D d;
  const DU du;
  const Transform moved(placement);
  const std::size_t N = hn::Lanes(d);
  // Rounding, as coordinates can be as large as this.
  const auto& t = placement.translation;
  const float farthest =
      std::sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + static_cast<float>(shell.radius + grid.radius);
  const V within = hn::Set(d, reach + 1e-6F + 2e-6F * farthest);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < pairs.count; i += N) {
    const M isPair = hn::FirstN(d, pairs.count - i);
    const auto object = hn::IfThenElseZero(hn::RebindMask(du, isPair), hn::LoadU(du, &pairs.object[i]));
    const auto link = hn::IfThenElseZero(hn::RebindMask(du, isPair), hn::LoadU(du, &pairs.link[i]));
    alignas(64) std::uint32_t objects[kGroup], links[kGroup];
    hn::Store(object, du, objects);
    hn::Store(link, du, links);
    const auto ofObject = loadRecords<12>(shell.sourceTriangle.data(), objects);
    const auto ofLink = loadRecords<12>(grid.triangle.data(), links);
    // Seen from the link's first corner, so that numbers are small.
    const V3 origin = ofLink.vector(0);
    const V3 l[3] = {{hn::Zero(d), hn::Zero(d), hn::Zero(d)}, ofLink.vector(3) - origin, ofLink.vector(6) - origin};
    const V3 o[3] = {moved(ofObject.vector(0)) - origin, moved(ofObject.vector(3)) - origin,
                     moved(ofObject.vector(6)) - origin};
    const Apart byLink = apartFrom(l, o, within), byObject = apartFrom(o, l, within);
    auto close = hn::Zero(du);
    const auto add = [&](int bit, M apart) {
      close = hn::Or(close, hn::IfThenZeroElse(hn::RebindMask(du, apart), hn::Set(du, FeaturePairs{1} << bit)));
    };
    for (int k = 0; k < 3; ++k) {
      add(k, byLink.corner[k]);
      add(3 + k, byObject.corner[k]);
      for (int j = 0; j < 3; ++j) {
        const M out = hn::Or(byLink.edge[k][j], byObject.edge[j][k]);
        add(6 + 3 * k + j, hn::Or(out, edgesAreApart(o[k], o[(k + 1) % 3], l[j], l[(j + 1) % 3], within)));
      }
    }
    close = hn::IfThenZeroElse(hn::RebindMask(du, hn::Or(byLink.wholly, byObject.wholly)), close);
    const M keep = hn::And(isPair, hn::RebindMask(d, hn::Ne(close, hn::Zero(du))));
    storeSelected(keep, object, &pairs.object[kept]);
    storeSelected(keep, link, &pairs.link[kept]);
    kept += storeSelected(keep, close, &pairs.close[kept]);
  }
  pairs.count = kept;
}

}  // namespace
}  // namespace handhold::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace handhold::kernels {

HWY_EXPORT(SelectBlocks);
HWY_EXPORT(SelectPoints);
HWY_EXPORT(TakeDue);
HWY_EXPORT(RefineMotion);
HWY_EXPORT(Distances);
HWY_EXPORT(SelectColumns);
HWY_EXPORT(ColumnIntervals);
HWY_EXPORT(LanesEndingIn);
HWY_EXPORT(RefineExit);
HWY_EXPORT(Climb);
HWY_EXPORT(ColumnPoints);
HWY_EXPORT(NearBlocks);
HWY_EXPORT(NearBoxes);
HWY_EXPORT(NearTriangles);
HWY_EXPORT(PlaceTriangles);
HWY_EXPORT(FindPairs);
HWY_EXPORT(TouchIntervals);
HWY_EXPORT(KeepClose);

std::size_t selectBlocks(const Lattice<std::uint32_t>& coarse, const SphereTree& tree, const Placement& placement,
                         std::uint32_t from, std::uint32_t to, std::uint32_t* ids, std::uint32_t* firsts) {
  return HWY_DYNAMIC_DISPATCH(SelectBlocks)(coarse, tree, placement, from, to, ids, firsts);
}
void selectPoints(const Lattice<std::uint32_t>& fine, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                  const Placement& placement, std::uint32_t from, std::uint32_t to, WaitingPoints& points) {
  HWY_DYNAMIC_DISPATCH(SelectPoints)(fine, shell, blocks, placement, from, to, points);
}
std::uint32_t takeDue(std::uint32_t due, std::uint32_t until, WaitingPoints& waiting, WaitingPoints& to) {
  return HWY_DYNAMIC_DISPATCH(TakeDue)(due, until, waiting, to);
}
float refineMotion(const Motion& motion, std::span<const PlacedGrid> grids, const Points& points, const float* s,
                   float from, float best) {
  return HWY_DYNAMIC_DISPATCH(RefineMotion)(motion, grids, points, s, from, best);
}
void distances(std::span<const PlacedGrid> grids, const Points& points, float* distance) {
  HWY_DYNAMIC_DISPATCH(Distances)(grids, points, distance);
}
std::size_t selectColumns(const ColumnField& coarse, const SphereTree& tree, const Placement& placement, float from,
                          std::uint32_t* ids) {
  return HWY_DYNAMIC_DISPATCH(SelectColumns)(coarse, tree, placement, from, ids);
}
std::size_t columnPoints(const ColumnField& fine, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                         const Placement& placement, float from, float* x, float* y, float* z, std::uint32_t* nodes) {
  return HWY_DYNAMIC_DISPATCH(ColumnPoints)(fine, shell, blocks, placement, from, x, y, z, nodes);
}
void columnIntervals(const ColumnField& field, std::size_t count, const std::uint32_t* nodes, const float* z,
                     float* const low[2], float* const high[2]) {
  HWY_DYNAMIC_DISPATCH(ColumnIntervals)(field, count, nodes, z, low, high);
}
float climb(float t, std::size_t count, const float* const low[2], const float* const high[2]) {
  return HWY_DYNAMIC_DISPATCH(Climb)(t, count, low, high);
}
std::size_t lanesEndingIn(float floor, float top, std::size_t count, const float* low, const float* high,
                          std::uint32_t* ids) {
  return HWY_DYNAMIC_DISPATCH(LanesEndingIn)(floor, top, count, low, high, ids);
}
void refineExit(const PlacedGrid& grid, const Points& points, const float* start, float best, float* left) {
  HWY_DYNAMIC_DISPATCH(RefineExit)(grid, points, start, best, left);
}
std::size_t nearBlocks(const PlacedGrid& grid, const SphereTree& tree, float margin, std::uint32_t* ids) {
  return HWY_DYNAMIC_DISPATCH(NearBlocks)(grid, tree, margin, ids);
}
std::size_t nearBoxes(const PlacedGrid& grid, const ObjectShell& shell, float margin, std::uint32_t* ids) {
  return HWY_DYNAMIC_DISPATCH(NearBoxes)(grid, shell, margin, ids);
}
std::size_t nearTriangles(const PlacedGrid& grid, const ObjectShell& shell, std::span<const std::uint32_t> blocks,
                          float margin, std::uint32_t* scratch, std::uint32_t* ids) {
  return HWY_DYNAMIC_DISPATCH(NearTriangles)(grid, shell, blocks, margin, scratch, ids);
}
void placeTriangles(const ObjectShell& shell, const Placement& placement, NearTriangles& near) {
  HWY_DYNAMIC_DISPATCH(PlaceTriangles)(shell, placement, near);
}
void findPairs(const LinkGrid& grid, const NearTriangles& near, float reach, bool facing, Pairs& pairs) {
  HWY_DYNAMIC_DISPATCH(FindPairs)(grid, near, reach, facing, pairs);
}
void touchIntervals(const LinkGrid& grid, const NearTriangles& near, std::size_t count, Pairs& pairs) {
  HWY_DYNAMIC_DISPATCH(TouchIntervals)(grid, near, count, pairs);
}
void keepClose(const LinkGrid& grid, const ObjectShell& shell, const Placement& placement, float reach,
               WholePairs& pairs) {
  HWY_DYNAMIC_DISPATCH(KeepClose)(grid, shell, placement, reach, pairs);
}

}  // namespace handhold::kernels
#endif
