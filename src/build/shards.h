#pragma once

#include "build/job.h"

#include <cstddef>
#include <string>
#include <vector>

namespace handhold {

/// One set of a job and the shard that builds it.
struct ShardedSet {
  const CatalogItem* item = nullptr;
  const Hand* hand = nullptr;
  std::size_t shard = 0;
};

/// What a set is expected to take, in trials: N*R*M and what goes into a set without any. Estimated from the job alone,
/// no mesh is read: where a pitch stands for the number of samples, every object counts as one of 1000.
std::size_t estimatedCost(const Job& job, const Hand& hand);

/// Deals the sets whose object and hand match the globs out to `shards` shards: the costliest first, equal ones in the
/// order of a hash of their names, each to the shard that has least so far. No shard is heavier than the mean and one
/// set. The same job gives the same shards on every machine; a set more or less moves others.
/// @param shards  at least 1
/// @return by object, then hand; points into `job` and `hands`
std::vector<ShardedSet> dealSets(const Job& job, const std::vector<Hand>& hands, const std::string& objectGlob,
                                 const std::string& handGlob, std::size_t shards);

}  // namespace handhold
