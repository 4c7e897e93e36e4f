#include "core/job_system.h"

#include <algorithm>
#include <exception>
#include <limits>
#include <mutex>
#include <thread>
#include <vector>

namespace handhold {

JobSystem::JobSystem(int threads) : threads_(threads) {
  if (threads_ <= 0) threads_ = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void JobSystem::run(std::size_t count, std::size_t chunk, const std::function<void(int, std::size_t)>& body,
                    const std::atomic<bool>* cancel) const {
  std::atomic<std::size_t> next{0};
  // No index at or above this one needs to run: an exception below it will be thrown anyway.
  std::atomic<std::size_t> failedIndex{std::numeric_limits<std::size_t>::max()};
  std::exception_ptr failure;  // of failedIndex
  std::mutex failureMutex;     // guards failure, and failedIndex against lost minima

  const auto work = [&](int worker) {
    for (;;) {
      const std::size_t begin = next.fetch_add(chunk);
      if (begin >= count) return;
      const std::size_t end = std::min(count, begin + chunk);
      for (std::size_t i = begin; i < end && i < failedIndex.load(); ++i) {
        if (cancel != nullptr && cancel->load()) return;
        try {
          body(worker, i);
        } catch (...) {
          const std::lock_guard lock(failureMutex);
          if (i < failedIndex.load()) {
            failedIndex = i;
            failure = std::current_exception();
          }
        }
      }
    }
  };

  {
    std::vector<std::jthread> helpers;
    const std::size_t chunks = (count + chunk - 1) / chunk;
    for (int worker = 1; worker < threads_ && static_cast<std::size_t>(worker) < chunks; ++worker) {
      helpers.emplace_back(work, worker);
    }
    work(0);
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace handhold
