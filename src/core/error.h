#pragma once

#include <atomic>
#include <stdexcept>
#include <string>

namespace handhold {

/// Wrong input from outside: a file, a job, an argument. The text names the input, the value found and the value
/// wanted. Whoever processes a batch records it for the item and goes on; a program exits with 2.
class InputError : public std::runtime_error {
 public:
  /// Messages quote files, which may hold anything: control characters become spaces, and 1000 letters are the most.
  explicit InputError(const std::string& message);
};

/// The machine refused: disk full, no permission, out of file handles. The text is one line with the path and the
/// reason.
class SystemError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Whoever called for the work has asked for its end.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled") {}
};

/// @throws Cancelled  when there is a flag and it is true
inline void throwIfCancelled(const std::atomic<bool>* cancel) {
  if (cancel != nullptr && cancel->load(std::memory_order_relaxed)) throw Cancelled();
}

}  // namespace handhold
