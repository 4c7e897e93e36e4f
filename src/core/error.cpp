#include "core/error.h"

#include <algorithm>
#include <cctype>

namespace handhold {
namespace {

constexpr std::size_t kLongest = 1000;  // letters: more is a damaged file that is quoted

std::string oneLine(std::string message) {
  std::replace_if(
      message.begin(), message.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, ' ');
  return message.size() <= kLongest ? message : message.substr(0, kLongest) + "...";
}

}  // namespace

InputError::InputError(const std::string& message) : std::runtime_error(oneLine(message)) {}

}  // namespace handhold
