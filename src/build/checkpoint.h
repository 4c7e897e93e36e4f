#pragma once

#include "build/evaluate.h"
#include "build/keep.h"

#include <atomic>
#include <filesystem>
#include <mutex>
#include <span>
#include <string>
#include <vector>

namespace handhold {

/// What the trials of a sample came to.
struct SampleResults {
  std::vector<std::uint8_t> outcome;  // of each trial
  std::vector<float> epsilon;         // of each trial
  std::vector<KeptGrasp> grasps;
  std::uint32_t byReference = 0;  // trials that the reference ran
  StageSeconds seconds;           // of the processor
};

/// The finished chunks of a set that is being built, one file each, so that a build that is killed loses little. They
/// belong to one input hash: whoever has the same inputs makes the same chunks, so several builders may share them.
/// A chunk's file is complete or absent; a damaged one, or one of another program version, counts as absent.
/// @note Safe from many threads and processes.
class Checkpoint {
 public:
  /// `FOLDER/.chunks-HASH`; nothing is made before the first chunk is written.
  /// @param trialsPerChunk  about; by default some seconds on one core
  Checkpoint(const std::filesystem::path& folder, const std::string& inputHash, std::size_t trialsPerChunk = 4096);
  std::size_t trialsPerChunk() const { return trialsPerChunk_; }

  /// False when there is no such chunk with as many samples, of so many trials each; `samples` are then what they were.
  bool read(std::size_t chunk, std::size_t trialsPerSample, std::span<SampleResults> samples) const;
  /// A chunk that cannot be written (disk full) is told once as a warning: the build goes on without.
  void write(std::size_t chunk, std::span<SampleResults> samples) const;
  /// Removes every chunk; to be called when the set is written.
  void remove() const;

 private:
  std::filesystem::path path(std::size_t chunk) const;

  std::filesystem::path folder_;
  std::size_t trialsPerChunk_;
  mutable std::once_flag made_;
  mutable std::atomic<bool> warned_ = false;
};

}  // namespace handhold
