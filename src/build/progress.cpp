#include "build/progress.h"

#include "core/log.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <unistd.h>

namespace handhold {
namespace {

std::string clockText(double seconds) {
  const long total = std::lround(seconds);
  return total >= 3600 ? fmt::format("{}:{:02}:{:02}", total / 3600, total / 60 % 60, total % 60)
                       : fmt::format("{}:{:02}", total / 60, total % 60);
}

/// What a watcher needs, read once.
struct Rates {
  double share, trialsPerSecond, closedShare, secondsLeft;
};

Rates ratesOf(const BuildCounters& counters, std::size_t expected, std::chrono::steady_clock::time_point start) {
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const double trials = static_cast<double>(counters.trials),
               all = static_cast<double>(std::max<std::size_t>(expected, 1));
  const double rate = trials / std::max(seconds, 1e-3);
  return {std::min(1.0, trials / all), rate, trials > 0 ? static_cast<double>(counters.forceClosed) / trials : 0,
          rate > 0 ? std::max(0.0, all - trials) / rate : 0};
}

/// The words as a JSON key.
std::string withUnderscores(std::string words) {
  std::replace(words.begin(), words.end(), ' ', '_');
  return words;
}

}  // namespace

Progress::Progress(ProgressMode mode, std::size_t sets, std::size_t expectedTrials, ProgressWords words)
    : mode_(mode), sets_(sets), expectedTrials_(expectedTrials), words_(std::move(words)) {
  if (mode_ == ProgressMode::automatic && ::isatty(STDERR_FILENO) == 0) mode_ = ProgressMode::plain;
  if (mode_ != ProgressMode::none) watcher_ = std::thread([this] { watch(); });
}

Progress::~Progress() {
  if (!watcher_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_one();
  watcher_.join();
  if (mode_ == ProgressMode::automatic) setProgressLine("");
}

void Progress::begin(const std::string& what, std::size_t finishedSets) {
  const std::lock_guard lock(mutex_);
  what_ = what;
  finishedSets_ = finishedSets;
}

std::string Progress::line() const {
  const Rates r = ratesOf(counters_, expectedTrials_, start_);
  return fmt::format("[{}/{} sets] {:.0f} % of all, {:.0f} {}/s, {:.0f} % {}, {} left; now {}", finishedSets_, sets_,
                     100 * r.share, r.trialsPerSecond, words_.items, 100 * r.closedShare, words_.good,
                     clockText(r.secondsLeft), what_);
}

std::string Progress::json() const {
  const Rates r = ratesOf(counters_, expectedTrials_, start_);
  return fmt::format(
      R"({{"event": "progress", "sets_done": {0}, "sets": {1}, "current": "{2}", "{5}": {3}, "{5}_expected": {4}, )"
      R"("{5}_per_second": {6:.1f}, "{8}_share": {7:.4f}, "seconds_left": {9:.0f}}})",
      finishedSets_, sets_, what_, counters_.trials.load(), expectedTrials_.load(), words_.items, r.trialsPerSecond,
      r.closedShare, withUnderscores(words_.good), r.secondsLeft);
}

void Progress::watch() {
  using std::chrono::milliseconds;
  const auto interval = mode_ == ProgressMode::automatic ? milliseconds(250)
                        : mode_ == ProgressMode::json    ? milliseconds(1000)
                                                         : milliseconds(10000);
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, interval, [this] { return done_; })) {
    if (what_.empty()) continue;
    if (mode_ == ProgressMode::automatic) setProgressLine(line());
    if (mode_ == ProgressMode::plain) logInfo(line());
    if (mode_ == ProgressMode::json) logInfo(json());
  }
  if (mode_ == ProgressMode::json) logInfo(json());
}

}  // namespace handhold
