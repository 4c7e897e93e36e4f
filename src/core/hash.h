#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace handhold {

/// Hexadecimal digits of a content hash.
inline constexpr std::size_t kHashLength = 32;

/// 128-bit content hash (XXH3): detects change and damage, is no defence against forgery.
class ContentHash {
 public:
  ContentHash();
  ~ContentHash();
  ContentHash(const ContentHash&) = delete;
  ContentHash& operator=(const ContentHash&) = delete;

  void addBytes(const void* data, std::size_t size);
  /// Adds the text and its length, so that ("ab", "c") and ("a", "bc") differ.
  void addText(std::string_view text);
  void addNumber(double value);
  /// The hash of all that was added, as kHashLength hexadecimal digits.
  std::string hex() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// XXH3-128 of a block of memory, as kHashLength hexadecimal digits.
std::string hashBytes(const void* data, std::size_t size);

/// XXH3-64 of a text: a key for random streams and shards, equal on every machine.
std::uint64_t hashText(std::string_view text);

}  // namespace handhold
