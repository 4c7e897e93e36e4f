// Random streams, hashes, rounding: numbers that must be equal on every machine.

#include "core/float_rounding.h"
#include "core/hash.h"
#include "core/random.h"

#include <array>
#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <gtest/gtest.h>

namespace handhold {
namespace {

// ---- RandomStream ----------------------------------------------------------------------------------------------

TEST(RandomStream, ValuesDoNotDependOnTheOrderOfAsking) {
  const RandomStream forwards(7), backwards(7);
  std::vector<std::uint64_t> first, second(100);
  for (std::uint64_t i = 0; i < 100; ++i) first.push_back(forwards.bits(i));
  for (std::uint64_t i = 100; i-- > 0;) second[i] = backwards.bits(i);
  EXPECT_EQ(first, second);
  EXPECT_EQ(forwards.child(3).bits(5), RandomStream(7).child(3).bits(5));
}

// A change here changes every database that is built from a seed.
TEST(RandomStream, StaysTheSameFromReleaseToRelease) {
  EXPECT_EQ(RandomStream(0).bits(0), 0xa706dd2f4d197e6fULL);
  EXPECT_EQ(RandomStream(1).child(2).bits(3), 0x5a4c2a25151ab2ebULL);
}

TEST(RandomStream, KeysChildrenAndCountersAllDiffer) {
  std::set<std::uint64_t> seen;
  std::size_t asked = 0;
  for (std::uint64_t key = 0; key < 50; ++key) {
    for (std::uint64_t i = 0; i < 50; ++i) {
      seen.insert(RandomStream(key).bits(i));
      seen.insert(RandomStream(key).child(i).bits(0));
      seen.insert(RandomStream(key).child(i).child(key).bits(1));
      asked += 3;
    }
  }
  EXPECT_EQ(seen.size(), asked);
}

// Past failure: item a of stream b was item b of stream a, and item a of stream a was the same for every a.
TEST(RandomStream, ItemAndStreamDoNotExchange) {
  EXPECT_NE(RandomStream(3).child(5).bits(0), RandomStream(5).child(3).bits(0));
  EXPECT_NE(RandomStream(3).child(3).bits(0), RandomStream(5).child(5).bits(0));
  EXPECT_NE(RandomStream(1).child(3).child(5).bits(0), RandomStream(1).child(5).child(3).bits(0));
}

// Mean, variance, kurtosis and the tails of the normal distribution, each within five standard errors.
TEST(RandomStream, NormalNumbersAreNormal) {
  constexpr int kCount = 100'000;
  double sum = 0, squares = 0, fourths = 0, products = 0;
  int beyondTwo = 0;
  for (int i = 0; i < kCount; ++i) {
    const double x = RandomStream(5).normal(i), y = RandomStream(5).normal(i + 1);
    ASSERT_TRUE(std::isfinite(x));
    sum += x;
    squares += x * x;
    fourths += x * x * x * x;
    products += x * y;
    beyondTwo += std::abs(x) > 2;
  }
  const double error = 5 / std::sqrt(kCount);
  EXPECT_NEAR(sum / kCount, 0, error);
  EXPECT_NEAR(squares / kCount, 1, error * std::sqrt(2));
  EXPECT_NEAR(fourths / kCount, 3, error * std::sqrt(96));
  EXPECT_NEAR(products / kCount, 0, error);
  EXPECT_NEAR(beyondTwo / static_cast<double>(kCount), std::erfc(std::sqrt(2)), error * 0.21);
}

// One bit more in the key or the counter flips half of the bits, give or take.
TEST(RandomStream, NeighboursAreUnrelated) {
  int flippedByKey = 0, flippedByCounter = 0;
  constexpr int kPairs = 1000;
  for (std::uint64_t i = 0; i < kPairs; ++i) {
    flippedByKey += __builtin_popcountll(RandomStream(i).bits(9) ^ RandomStream(i + 1).bits(9));
    flippedByCounter += __builtin_popcountll(RandomStream(9).bits(i) ^ RandomStream(9).bits(i + 1));
  }
  const double fiveSigma = 5 * 4 / std::sqrt(kPairs);  // of the mean: one pair has sigma 4 bits
  EXPECT_NEAR(static_cast<double>(flippedByKey) / kPairs, 32, fiveSigma);
  EXPECT_NEAR(static_cast<double>(flippedByCounter) / kPairs, 32, fiveSigma);
}

TEST(RandomStream, UniformFillsTheUnitInterval) {
  constexpr int kDraws = 100'000, kBins = 10;
  const RandomStream stream(123);
  double sum = 0, squares = 0;
  std::vector<int> bins(kBins, 0);
  for (int i = 0; i < kDraws; ++i) {
    const double u = stream.uniform(i);
    ASSERT_GE(u, 0);
    ASSERT_LT(u, 1);
    sum += u;
    squares += u * u;
    ++bins[static_cast<std::size_t>(u * kBins)];
  }
  const double mean = sum / kDraws;
  EXPECT_NEAR(mean, 0.5, 5 * std::sqrt(1.0 / 12 / kDraws));  // five standard deviations
  EXPECT_NEAR(squares / kDraws - mean * mean, 1.0 / 12, 0.002);
  for (const int count : bins) EXPECT_NEAR(count, kDraws / kBins, 5 * std::sqrt(kDraws * 0.09));
}

// ---- Hashes ----------------------------------------------------------------------------------------------------

std::string hashOfTexts(std::initializer_list<std::string_view> texts) {
  ContentHash hash;
  for (const auto text : texts) hash.addText(text);
  return hash.hex();
}

// The published values of XXH3 for no input at all.
TEST(Hash, IsXxh3) {
  EXPECT_EQ(hashText(""), 0x2d06800538d394c2ULL);
  EXPECT_EQ(hashBytes(nullptr, 0), "99aa06d3014798d86001c324468d497f");
}

TEST(Hash, SameTextSameHash) {
  const std::string text = "jobs/mug.yaml";
  EXPECT_EQ(hashText(text), hashText("jobs/mug.yaml"));
  EXPECT_NE(hashText(text), hashText("jobs/mug.yamm"));
  EXPECT_EQ(hashBytes(text.data(), text.size()), hashBytes("jobs/mug.yaml", 13));
  EXPECT_EQ(hashBytes(text.data(), text.size()).size(), 32U);
  EXPECT_NE(hashText(std::string("a\0b", 3)), hashText("a"));
}

TEST(Hash, FieldsAreSeparated) {
  EXPECT_EQ(hashOfTexts({"ab", "c"}), hashOfTexts({"ab", "c"}));
  EXPECT_NE(hashOfTexts({"ab", "c"}), hashOfTexts({"a", "bc"}));
  EXPECT_NE(hashOfTexts({"abc", ""}), hashOfTexts({"", "abc"}));
  EXPECT_NE(hashOfTexts({"abc"}), hashOfTexts({"abc", ""}));
  EXPECT_NE(hashOfTexts({"a", "b"}), hashOfTexts({"b", "a"}));
}

// Bytes in one piece or in many are the same bytes, whatever the blocks inside the hash are.
TEST(Hash, PiecesOfBytesAddUp) {
  const std::string bytes(5000, 'q');
  for (const std::size_t split : {0, 1, 63, 64, 255, 256, 257, 1024, 4999, 5000}) {
    ContentHash hash;
    hash.addBytes(bytes.data(), split);
    hash.addBytes(bytes.data() + split, bytes.size() - split);
    EXPECT_EQ(hash.hex(), hashBytes(bytes.data(), bytes.size())) << split;
  }
}

TEST(Hash, NumbersDifferInTheLastBitAndZeroHasNoSign) {
  const auto hashOf = [](double x) {
    ContentHash hash;
    hash.addNumber(x);
    return hash.hex();
  };
  EXPECT_NE(hashOf(0.1), hashOf(std::nextafter(0.1, 1)));
  EXPECT_EQ(hashOf(0.0), hashOf(-0.0));
}

// ---- Rounding --------------------------------------------------------------------------------------------------

TEST(RoundedToFloat, IsTheNearestFloat) {
  EXPECT_EQ(roundedToFloat(0.1), static_cast<double>(0.1F));
  EXPECT_EQ(roundedToFloat(0.5), 0.5);
  EXPECT_EQ(roundedToFloat(1 + 0x1p-24), 1);  // half way: to the even one
  EXPECT_EQ(roundedToFloat(1 + 0x1.8p-24), 1 + 0x1p-23);
  EXPECT_EQ(roundedToFloat(roundedToFloat(1.0 / 3)), roundedToFloat(1.0 / 3));
  EXPECT_FALSE(std::signbit(roundedToFloat(-0.0)));
  EXPECT_FALSE(std::signbit(roundedToFloat(-1e-60)));
}

bool isFloat(double x) {
  volatile float narrow = static_cast<float>(x);  // volatile: the compiler must not take x for it either
  return static_cast<double>(narrow) == x;
}

double somethingUneven(const RandomStream& stream, std::uint64_t i) { return 0.2 * stream.uniform(i) - 0.1; }

// Past failure: at -O3 gcc 12 vectorised this loop and left some of the numbers as they were.
TEST(RoundedToFloat, IsDroppedForNoElementOfAnyArray) {
  for (std::size_t size = 1; size <= 40; ++size) {
    const RandomStream stream(size);
    std::vector<Eigen::Vector3d> points(size);
    for (std::size_t i = 0; i < size; ++i) {
      for (int k = 0; k < 3; ++k) points[i][k] = somethingUneven(stream, 3 * i + k);
    }
    const std::vector<Eigen::Vector3d> before = points;
    for (auto& point : points) {
      for (double& x : point) x = roundedToFloat(x);
    }
    for (std::size_t i = 0; i < size; ++i) {
      for (int k = 0; k < 3; ++k) {
        EXPECT_TRUE(isFloat(points[i][k])) << "size " << size << ", point " << i << ", coordinate " << k;
        EXPECT_NEAR(points[i][k], before[i][k], 1e-8);
      }
    }
  }
}

template <std::size_t Size>
void expectArrayOfFloats() {
  const RandomStream stream(Size);
  std::array<Eigen::Vector3d, Size> points;
  for (std::size_t i = 0; i < Size; ++i) {
    for (int k = 0; k < 3; ++k) points[i][k] = somethingUneven(stream, 3 * i + k);
  }
  for (auto& point : points) point = point.unaryExpr([](double x) { return roundedToFloat(x); });
  for (const auto& point : points) {
    for (const double x : point) EXPECT_TRUE(isFloat(x)) << "size " << Size;
  }
}

template <std::size_t... Sizes>
void expectArraysOfFloats(std::index_sequence<Sizes...>) {
  (expectArrayOfFloats<Sizes + 1>(), ...);
}

// The same where the compiler knows the size, and so unrolls.
TEST(RoundedToFloat, IsDroppedForNoElementOfAnyFixedArray) { expectArraysOfFloats(std::make_index_sequence<40>()); }

}  // namespace
}  // namespace handhold
