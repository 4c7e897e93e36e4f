#include "core/job_system.h"

#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

TEST(JobSystem, RunsEveryIndexOnce) {
  for (const int threads : {1, 2, 7}) {
    for (const std::size_t chunk : {1U, 3U, 1000U}) {
      const JobSystem jobs(threads);
      std::vector<std::atomic<int>> count(997);
      jobs.run(count.size(), chunk, [&](int worker, std::size_t i) {
        EXPECT_LT(worker, threads);
        ++count[i];
      });
      for (const auto& c : count) EXPECT_EQ(c.load(), 1);
    }
  }
}

TEST(JobSystem, HasAtLeastOneThread) { EXPECT_GE(JobSystem().threads(), 1); }

TEST(JobSystem, DoesNothingForNothing) {
  JobSystem(3).run(0, 4, [](int, std::size_t) { FAIL(); });
}

// Scratch is per worker: no two threads may share a worker number.
TEST(JobSystem, GivesEachThreadAWorkerOfItsOwn) {
  const JobSystem jobs(4);
  std::vector<std::set<std::thread::id>> seen(4);
  std::mutex mutex;
  jobs.run(400, 1, [&](int worker, std::size_t) {
    std::this_thread::yield();
    const std::lock_guard lock(mutex);
    seen[worker].insert(std::this_thread::get_id());
  });
  for (const auto& threads : seen) EXPECT_LE(threads.size(), 1U);
}

TEST(JobSystem, RethrowsTheLowestFailingIndex) {
  for (int round = 0; round < 20; ++round) {
    const JobSystem jobs(4);
    try {
      jobs.run(1000, 1, [](int, std::size_t i) {
        if (i % 100 == 37) throw std::runtime_error(std::to_string(i));
      });
      FAIL() << "no exception";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "37");
    }
  }
}

TEST(JobSystem, StopsWhenCancelled) {
  const JobSystem jobs(2);
  std::atomic<bool> cancel{false};
  std::atomic<int> ran{0};
  jobs.run(
      100000, 1,
      [&](int, std::size_t) {
        if (++ran == 10) cancel = true;
      },
      &cancel);
  EXPECT_GE(ran.load(), 10);
  EXPECT_LT(ran.load(), 100);
}

}  // namespace
}  // namespace handhold
