#include "build/hand_fields_cache.h"

namespace handhold {

std::shared_ptr<const HandFields> HandFieldsCache::of(const Job& job, const Hand& hand,
                                                      const std::atomic<bool>& cancel) {
  if (job.simulation != Simulation::fast) return nullptr;
  std::shared_ptr<const HandFields>& fields = fields_[hand.contentHash];
  if (!fields) fields = makeHandFields(hand, &cancel);
  return fields;
}

}  // namespace handhold
