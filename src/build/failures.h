#pragma once

#include "store/database.h"

#include <optional>
#include <string>

namespace handhold {

/// Why the last attempt to build a set failed: `DIR/<object>/<hand>/failed.json`.
struct FailureRecord {
  std::string object, hand, error;
  std::string command;    // repeats the attempt
  std::string inputHash;  // of what failed
  bool knownBad = false;  // false: the machine failed (disk, memory), so the next run tries again
  double timeout = 0;     // s, of the limit that was exceeded; 0: another reason
};

/// Nothing when there is none, or none of ours.
std::optional<FailureRecord> readFailure(const Database& database, const std::string& object, const std::string& hand);

/// Replaces the set's record at once. What cannot be written (the disk is full) is a warning: the run reports it too.
void writeFailure(const Database& database, const FailureRecord& record);

/// The set was built, or is as its inputs want it.
void removeFailure(const Database& database, const std::string& object, const std::string& hand);

/// Would these inputs fail again? A timeout counts while no more time is given (`timeout` 0: any).
bool isKnownBad(const FailureRecord& record, const std::string& inputHash, double timeout);

}  // namespace handhold
