#pragma once

#include "quality/force_closure.h"
#include "quality/lanes.h"

#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Core>

// The wrenches as a structure of arrays, eight columns a block; no other library includes it.
namespace handhold::polar {

using lanes::Lanes;

/// Instruction sets that the kernels are compiled for, by the doubles in a vector. All give equal bits.
enum class InstructionSet : unsigned char { baseline, avx2 };

/// The best one that this machine has.
InstructionSet instructionSet();
const char* name(InstructionSet set);

/// testForceClosure and epsilonMetric by a chosen instruction set, which the machine must have.
ForceClosureResult testForceClosure(const WrenchView& wrenches, InstructionSet set);
double epsilonMetric(const WrenchView& wrenches, const ForceClosureResult& closure, InstructionSet set);

/// Eight wrenches, coordinate by coordinate: [k][l] is coordinate k of wrench l.
using EightWrenches = std::array<std::array<double, 8>, 6>;

struct alignas(64) ColumnBlock {
  EightWrenches w;  // columns 8 b to 8 b + 7
};

/// The columns; the last block is filled up with column 0.
struct Columns {
  const ColumnBlock* blocks;
  int nBlocks;
  int n;
};

/// A column and how far it reaches along a direction.
struct Support {
  int column = -1;
  double value = -HUGE_VAL;
};

template <int W>
HANDHOLD_INLINE Lanes<W> laneNumbers() {
  alignas(64) constexpr std::array<double, 8> kNumbers = {0, 1, 2, 3, 4, 5, 6, 7};
  return Lanes<W>::load(kNumbers.data());
}

/// Copies into scratch, which keeps its memory.
HANDHOLD_INLINE Columns packColumns(const WrenchView& wrenches, std::vector<ColumnBlock>& scratch) {
  const int n = static_cast<int>(wrenches.cols());
  const int nBlocks = (n + 7) / 8;
  if (scratch.size() < static_cast<std::size_t>(nBlocks)) scratch.resize(static_cast<std::size_t>(nBlocks));
  const double* from = wrenches.data();
  for (int b = 0; b < n / 8; ++b, from += 48) {
    for (int k = 0; k < 6; ++k) {
      for (int l = 0; l < 8; ++l) scratch[b].w[k][l] = from[6 * l + k];
    }
  }
  for (int j = n / 8 * 8; j < 8 * nBlocks; ++j) {
    for (int k = 0; k < 6; ++k) scratch[j / 8].w[k][j % 8] = wrenches(k, j < n ? j : 0);
  }
  return {scratch.data(), nBlocks, n};
}

template <int W>
HANDHOLD_INLINE Lanes<W> coordinate(const ColumnBlock& block, int k) {
  return Lanes<W>::load(block.w[k].data());
}

/// d . w of eight wrenches.
template <int W>
HANDHOLD_INLINE Lanes<W> product(const EightWrenches& w, const double* d) {
  const Lanes<W> first = Lanes<W>::load(w[0].data()) * d[0] + Lanes<W>::load(w[1].data()) * d[1];
  const Lanes<W> second = Lanes<W>::load(w[2].data()) * d[2] + Lanes<W>::load(w[3].data()) * d[3];
  const Lanes<W> third = Lanes<W>::load(w[4].data()) * d[4] + Lanes<W>::load(w[5].data()) * d[5];
  return (first + second) + third;
}

/// The largest of values that come eight at a time.
template <int W>
struct Largest {
  Lanes<W> best, bestBlock, block;

  HANDHOLD_INLINE static Largest none() {
    const Lanes<W> zero = Lanes<W>::all(0);
    return {Lanes<W>::all(-HUGE_VAL), zero, zero};
  }

  HANDHOLD_INLINE void add(const Lanes<W>& value) {
    const auto better = value > best;
    best = select(better, value, best);
    bestBlock = select(better, block, bestBlock);
    block = block + Lanes<W>::all(1);
  }

  /// With the number of the value, the lowest among equals; -1 when no value is a number.
  HANDHOLD_INLINE Support support() const {
    const double value = largest(best);
    if (value == -HUGE_VAL) return {};
    const Lanes<W> index = bestBlock * 8.0 + laneNumbers<W>();
    const auto isBest = best == Lanes<W>::all(value);
    return {static_cast<int>(least(select(isBest, index, Lanes<W>::all(HUGE_VAL)))), value};
  }
};

/// The column that reaches farthest along d.
template <int W>
HANDHOLD_INLINE Support supportColumn(const Columns& columns, const double* d) {
  auto farthest = Largest<W>::none();
  for (int b = 0; b < columns.nBlocks; ++b) farthest.add(product<W>(columns.blocks[b].w, d));
  return farthest.support();
}

}  // namespace handhold::polar
