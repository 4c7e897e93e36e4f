#pragma once

#include <chrono>
#include <ctime>

namespace handhold {

inline double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Seconds that the processor worked for this thread: unlike the wall's they do not count waiting.
inline double processorSeconds(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}
inline double threadSeconds() { return processorSeconds(CLOCK_THREAD_CPUTIME_ID); }

/// The same for all threads of the process.
inline double processSeconds() { return processorSeconds(CLOCK_PROCESS_CPUTIME_ID); }

}  // namespace handhold
