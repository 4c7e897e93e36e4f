#pragma once

#include "build/job.h"
#include "build/keep.h"
#include "quality/load_margin.h"
#include "simulate/grasp_policy.h"

#include <cstdint>

namespace handhold {

/// What is computed of the best rows of a set alone, as it costs much: the load margin, and how robust the grasp is.
/// One a worker.
class RankedQuality {
 public:
  /// `job` and `hand` must outlive it.
  /// @param key  of the random streams: the set's own
  RankedQuality(const Job& job, const Hand& hand, const WrenchModel& model, std::uint64_t key);

  /// How many rows have any of it.
  std::size_t rows() const;

  /// Fills in what the job wants of the row.
  void compute(std::size_t row, GraspPolicy& policy, KeptGrasp& grasp);

  double loadSeconds = 0, robustnessSeconds = 0;  // of the processor, so far

 private:
  const Job& job_;
  const Hand& hand_;
  WrenchModel model_;
  TaskWrenches tasks_;
  LoadMarginSolver solver_;
  FrictionCones cones_;
  RandomStream stream_;
  std::size_t loadRows_ = 0, robustnessRows_ = 0;
};

}  // namespace handhold
