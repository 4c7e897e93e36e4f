#pragma once

#include "core/error.h"

#include <cstdlib>
#include <string_view>

namespace handhold::fuzz {

/// A refusal that is no one line of a length that a person reads is a finding.
inline void requireOneLine(const InputError& error) {
  constexpr std::size_t kLongest = 2000;
  const std::string_view message = error.what();
  if (message.empty() || message.size() > kLongest || message.find('\n') != std::string_view::npos) std::abort();
}

}  // namespace handhold::fuzz
