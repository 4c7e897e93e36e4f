#pragma once

#include "build/job.h"
#include "simulate/fast_policy.h"

#include <atomic>
#include <map>
#include <memory>
#include <string>

namespace handhold {

/// Fields of hands, each made once, for whoever runs trials of many sets again.
class HandFieldsCache {
 public:
  /// Null where the job simulates by the reference, which has none. @throws Cancelled  soon after `cancel` became true
  std::shared_ptr<const HandFields> of(const Job& job, const Hand& hand, const std::atomic<bool>& cancel);

 private:
  std::map<std::string, std::shared_ptr<const HandFields>> fields_;  // by the hand's contentHash
};

}  // namespace handhold
