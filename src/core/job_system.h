#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

namespace handhold {

/// Runs loops on a fixed number of threads (the caller's among them).
class JobSystem {
 public:
  /// `threads` = 0: one for each core.
  explicit JobSystem(int threads = 0);
  int threads() const { return threads_; }

  /// Calls body(worker, index) once for every index below `count`; `worker` < threads() names the caller's scratch.
  /// Threads take chunks of `chunk` indices. Returns when all are done, or when those begun are after `cancel` became
  /// true. Of the exceptions thrown the one with the lowest index is rethrown; indices above it may be left out.
  void run(std::size_t count, std::size_t chunk, const std::function<void(int worker, std::size_t index)>& body,
           const std::atomic<bool>* cancel = nullptr) const;

 private:
  int threads_;
};

}  // namespace handhold
