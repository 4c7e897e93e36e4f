#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace handhold {

/// Counter-based random numbers: value i of stream `key` depends on (key, i) alone, never on who asked before.
/// The mixer is SplitMix64's finaliser (Steele, Lea, Flood 2014, "Fast splittable pseudorandom number generators").
class RandomStream {
 public:
  explicit RandomStream(std::uint64_t key) : key_(mix(key + kGolden)) {}

  /// A stream of its own for an item of this one. The key is mixed once more than the item: item a of stream b is
  /// another stream than item b of stream a.
  RandomStream child(std::uint64_t item) const { return RandomStream(mix(key_) ^ mix(item + kGolden)); }

  /// 64 random bits at position `counter`.
  std::uint64_t bits(std::uint64_t counter) const { return mix(key_ + (counter + 1) * kGolden); }

  /// Uniform in [0, 1), 53 bits, at position `counter`.
  double uniform(std::uint64_t counter) const { return static_cast<double>(bits(counter) >> 11) * 0x1.0p-53; }

  /// Standard normal, from the uniform numbers at positions 2 counter and 2 counter + 1 (Box, Muller 1958).
  double normal(std::uint64_t counter) const {
    const double radius = std::sqrt(-2 * std::log1p(-uniform(2 * counter)));
    return radius * std::cos(2 * std::numbers::pi * uniform(2 * counter + 1));
  }

 private:
  static constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;

  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }

  std::uint64_t key_;
};

}  // namespace handhold
