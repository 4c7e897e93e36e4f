// The split of a job into shards: the same everywhere, balanced by cost.
#include "build/shards.h"

#include <algorithm>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using ::testing::ElementsAre;

Job jobWith(std::size_t objects, std::size_t samples = 200) {
  Job job;
  job.samples = samples;
  job.rolls = 8;
  for (std::size_t i = 0; i < objects; ++i) {
    job.catalog.emplace_back();
    job.catalog.back().name = "object_" + std::to_string(1000 + i);
  }
  return job;
}

Hand handOf(const std::string& name, std::size_t preshapes) {
  Hand hand;
  hand.name = name;
  hand.preshapes.resize(preshapes);
  return hand;
}

std::vector<std::size_t> loads(const Job& job, const std::vector<ShardedSet>& sets, std::size_t shards) {
  std::vector<std::size_t> result(shards, 0);
  for (const ShardedSet& set : sets) result.at(set.shard) += estimatedCost(job, *set.hand);
  return result;
}

// Balanced: no shard is above the mean by more than a tenth, or by more than one set where sets are few.
TEST(Shards, AreBalancedByCost) {
  const std::vector<Hand> hands = {handOf("five", 5), handOf("one", 1), handOf("twelve", 12)};
  for (const std::size_t objects : {1U, 7U, 500U}) {
    const Job job = jobWith(objects);
    for (std::size_t shards = 1; shards <= 64; shards = shards < 9 ? shards + 1 : shards + 11) {
      const auto sets = dealSets(job, hands, "*", "*", shards);
      ASSERT_EQ(sets.size(), 3 * objects);
      const auto load = loads(job, sets, shards);
      const auto total = static_cast<double>(std::accumulate(load.begin(), load.end(), std::size_t{0}));
      const double mean = total / static_cast<double>(shards);
      const auto heaviest = static_cast<double>(*std::max_element(load.begin(), load.end()));
      EXPECT_LE(heaviest, mean + static_cast<double>(estimatedCost(job, hands[2]))) << objects << " / " << shards;
      if (objects == 500) {
        EXPECT_LE(heaviest, 1.1 * mean) << shards;
      }
    }
  }
}

// Every task of an array computes the split by itself: these are the shards on every machine, in every run.
TEST(Shards, AreTheSameEverywhere) {
  const Job job = jobWith(4);
  const std::vector<Hand> hands = {handOf("five", 5), handOf("one", 1)};
  std::vector<std::size_t> shards;
  for (const ShardedSet& set : dealSets(job, hands, "*", "*", 3)) shards.push_back(set.shard);
  EXPECT_THAT(shards, ElementsAre(0, 1, 1, 1, 2, 2, 0, 2));
}

TEST(Shards, ComeByObjectAndHandAndFollowTheGlobs) {
  const Job job = jobWith(12);
  const std::vector<Hand> hands = {handOf("five", 5), handOf("one", 1)};
  std::vector<std::string> names;
  for (const ShardedSet& set : dealSets(job, hands, "object_100[12]", "*", 2)) {
    names.push_back(set.item->name + "/" + set.hand->name);
  }
  EXPECT_THAT(names, ElementsAre("object_1001/five", "object_1001/one", "object_1002/five", "object_1002/one"));
  const auto chosen = dealSets(job, hands, "*", "one", 4);
  EXPECT_THAT(loads(job, chosen, 4), ::testing::Each(3 * estimatedCost(job, hands[1])));  // only what is chosen counts
  EXPECT_TRUE(dealSets(job, hands, "none", "*", 4).empty());
}

TEST(Shards, CostGrowsWithTrialsAndIsKnownForAPitch) {
  const Hand five = handOf("five", 5), one = handOf("one", 1);
  EXPECT_GT(estimatedCost(jobWith(1), five), estimatedCost(jobWith(1), one));
  EXPECT_GT(estimatedCost(jobWith(1, 400), one), estimatedCost(jobWith(1, 200), one));
  EXPECT_GT(estimatedCost(jobWith(1, 0), five), estimatedCost(jobWith(1, 0), one));  // samples = 0: a pitch
}

}  // namespace
}  // namespace handhold
