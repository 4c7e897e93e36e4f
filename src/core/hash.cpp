#include "core/hash.h"

#include <new>

#include <fmt/format.h>
#include <xxhash.h>

namespace handhold {

struct ContentHash::State {
  XXH3_state_t* xxh = XXH3_createState();
  ~State() { XXH3_freeState(xxh); }
};

namespace {
std::string toHex(XXH128_hash_t hash) { return fmt::format("{:016x}{:016x}", hash.high64, hash.low64); }
}  // namespace

ContentHash::ContentHash() : state_(std::make_unique<State>()) {
  if (state_->xxh == nullptr) throw std::bad_alloc();
  XXH3_128bits_reset(state_->xxh);
}

ContentHash::~ContentHash() = default;

void ContentHash::addBytes(const void* data, std::size_t size) {
  if (size > 0) XXH3_128bits_update(state_->xxh, data, size);
}

void ContentHash::addText(std::string_view text) {
  const std::uint64_t size = text.size();
  addBytes(&size, sizeof size);
  addBytes(text.data(), text.size());
}

void ContentHash::addNumber(double value) {
  const double canonical = value + 0.0;  // -0 and +0 are the same input
  addBytes(&canonical, sizeof canonical);
}

std::string ContentHash::hex() const { return toHex(XXH3_128bits_digest(state_->xxh)); }

std::string hashBytes(const void* data, std::size_t size) { return toHex(XXH3_128bits(data, size)); }

std::uint64_t hashText(std::string_view text) { return XXH3_64bits(text.data(), text.size()); }

}  // namespace handhold
