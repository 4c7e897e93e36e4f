#pragma once

#include "build/build_set.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

namespace handhold {

enum class ProgressMode { automatic, plain, json, none };

/// What is counted: the plural, and what is said of the good ones.
struct ProgressWords {
  std::string items = "trials", good = "force closed";
};

/// Tells on stderr how far a build is: a line that is rewritten on a terminal, else a line every ten seconds (plain) or
/// every second and at the end as JSON. A thread of its own sleeps in between.
class Progress {
 public:
  Progress(ProgressMode mode, std::size_t sets, std::size_t expectedTrials, ProgressWords words = {});
  ~Progress();

  /// Names what is being built; `finishedSets` are behind us, `skippedTrials` will not be run at all.
  void begin(const std::string& what, std::size_t finishedSets);
  /// Nothing more is being built.
  void end(std::size_t finishedSets) { begin("", finishedSets); }
  void skipTrials(std::size_t trials) { expectedTrials_ -= std::min(trials, expectedTrials_.load()); }
  BuildCounters& counters() { return counters_; }

 private:
  void watch();
  std::string line() const;
  std::string json() const;

  ProgressMode mode_;
  std::size_t sets_;
  std::atomic<std::size_t> expectedTrials_;
  ProgressWords words_;
  BuildCounters counters_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();

  mutable std::mutex mutex_;  // guards what_, finishedSets_ and done_
  std::condition_variable wake_;
  std::string what_;
  std::size_t finishedSets_ = 0;
  bool done_ = false;
  std::thread watcher_;
};

}  // namespace handhold
