#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace handhold {

/// A limit on the wall time of some work: its flag becomes true when the limit passes, and within 50 ms after `cancel`
/// became true. A thread of its own watches; without a limit the flag is `cancel` itself.
class TimeLimit {
 public:
  /// @param seconds  0: no limit
  TimeLimit(const std::atomic<bool>& cancel, double seconds);
  ~TimeLimit();
  TimeLimit(const TimeLimit&) = delete;
  TimeLimit& operator=(const TimeLimit&) = delete;

  const std::atomic<bool>& flag() const { return watcher_.joinable() ? stop_ : cancel_; }
  /// Did the limit pass?
  bool expired() const { return expired_; }

 private:
  void watch(double seconds);

  const std::atomic<bool>& cancel_;
  std::atomic<bool> stop_{false}, expired_{false};
  std::mutex mutex_;  // guards done_
  std::condition_variable wake_;
  bool done_ = false;
  std::thread watcher_;
};

}  // namespace handhold
