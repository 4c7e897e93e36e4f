#pragma once

#include "build/job.h"
#include "build/keep.h"
#include "quality/load_margin.h"
#include "quality/true_cone.h"
#include "simulate/grasp_policy.h"

#include <cstdint>

namespace handhold {

/// What is computed of kept grasps alone, as it costs more than their trials: epsilon and friction on the true cone,
/// and of the best rows the load margin and how robust the grasp is. One a worker.
class KeptQuality {
 public:
  /// `job` and `hand` must outlive it.
  /// @param key  of the random streams: the set's own
  KeptQuality(const Job& job, const Hand& hand, const WrenchModel& model, std::uint64_t key);

  /// Fills in what the job wants of the row; contacts rounded as stored.
  void compute(std::size_t row, GraspPolicy& policy, KeptGrasp& grasp);

  double boundsSeconds = 0, loadSeconds = 0, robustnessSeconds = 0;  // of the processor, so far

 private:
  const Job& job_;
  const Hand& hand_;
  WrenchModel model_;
  TaskWrenches tasks_;
  TrueCones trueCones_;
  LoadMarginSolver solver_;
  FrictionCones cones_;
  RandomStream stream_;
  std::size_t loadRows_ = 0, robustnessRows_ = 0;
};

}  // namespace handhold
