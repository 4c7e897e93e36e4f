#include "build/time_limit.h"

#include <algorithm>
#include <chrono>

namespace handhold {

TimeLimit::TimeLimit(const std::atomic<bool>& cancel, double seconds) : cancel_(cancel) {
  if (seconds > 0) watcher_ = std::thread([this, seconds] { watch(seconds); });
}

TimeLimit::~TimeLimit() {
  if (!watcher_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_one();
  watcher_.join();
}

void TimeLimit::watch(double seconds) {
  using Clock = std::chrono::steady_clock;
  constexpr double kLongest = 1e8;  // s; beyond what a clock can add
  const auto deadline = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                           std::chrono::duration<double>(std::min(seconds, kLongest)));
  std::unique_lock lock(mutex_);
  while (!done_ && !stop_) {
    wake_.wait_until(lock, std::min(deadline, Clock::now() + std::chrono::milliseconds(50)));
    if (done_) return;
    if (Clock::now() >= deadline) expired_ = true;
    if (expired_ || cancel_) stop_ = true;
  }
}

}  // namespace handhold
