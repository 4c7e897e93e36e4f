#include "build/shards.h"

#include "core/file.h"
#include "core/hash.h"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <queue>
#include <tuple>
#include <utility>

namespace handhold {
namespace {

constexpr std::size_t kSamplesOfPitch = 1000;
// Loading, sampling and preparing the sample catalog's meshes takes 0.1 s, a trial 0.25 ms (jobs/demo.yaml).
constexpr std::size_t kTrialsOfSet = 400;

}  // namespace

std::size_t estimatedCost(const Job& job, const Hand& hand) {
  const std::size_t samples = job.samples > 0 ? job.samples : kSamplesOfPitch;
  return samples * job.rolls * hand.preshapes.size() + kTrialsOfSet;
}

std::vector<ShardedSet> dealSets(const Job& job, const std::vector<Hand>& hands, const std::string& objectGlob,
                                 const std::string& handGlob, std::size_t shards) {
  std::vector<ShardedSet> sets;
  for (const CatalogItem& item : job.catalog) {
    if (!matchesGlob(item.name, objectGlob)) continue;
    for (const Hand& hand : hands) {
      if (matchesGlob(hand.name, handGlob)) sets.push_back({&item, &hand, 0});
    }
  }
  struct Share {
    std::size_t cost;
    std::uint64_t hash;
    std::size_t set;
  };
  std::vector<Share> order;
  for (std::size_t i = 0; i < sets.size(); ++i) {
    order.push_back({estimatedCost(job, *sets[i].hand), hashText(sets[i].item->name + "/" + sets[i].hand->name), i});
  }
  std::sort(order.begin(), order.end(), [](const Share& a, const Share& b) {
    return std::tuple(b.cost, a.hash, a.set) < std::tuple(a.cost, b.hash, b.set);
  });
  using Load = std::pair<std::size_t, std::size_t>;  // cost so far, shard
  std::priority_queue<Load, std::vector<Load>, std::greater<>> loads;
  for (std::size_t shard = 0; shard < shards; ++shard) loads.emplace(0, shard);
  for (const Share& share : order) {
    const auto [cost, shard] = loads.top();
    loads.pop();
    sets[share.set].shard = shard;
    loads.emplace(cost + share.cost, shard);
  }
  return sets;
}

}  // namespace handhold
