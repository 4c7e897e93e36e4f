#pragma once

#include "build/build_job.h"

#include <string>
#include <vector>

namespace handhold {

/// What a set of a hand costs: core seconds and bytes.
struct CostRates {
  std::size_t sets = 0;  // of the database that they are measured on; 0: none, they are constants
  double secondsPerSet = 0, secondsPerTrial = 0;
  double secondsPerGrasp = 0;   // that is kept
  double secondsOnce = 0;       // the hand's fields, once a run
  double shareForceClosed = 0;  // of the trials
  double bytesPerSet = 0, bytesPerSample = 0, bytesPerTrial = 0, bytesPerGrasp = 0;
  double samples = 0;  // mean N of sets with the job's pitch; 0: unknown
};

/// What is to be done for one hand, and what it would cost.
struct HandEstimate {
  std::string hand;
  CostRates rates;
  std::size_t missing = 0, changed = 0, done = 0, failed = 0, unreadable = 0;
  double trials = 0;            // to run
  std::size_t unknownSets = 0;  // to build, but with a number of samples that only sampling tells: not counted
  double coreHours = 0, gigabytes = 0;
};

/// An entry a hand, in the plan's order. Rates are measured on up to 20 newest sets of that hand that the job's kind of
/// simulation made, spread over the database; a hand without any has those of jobs/demo.yaml (estimate.cpp).
std::vector<HandEstimate> estimateCost(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                       const std::vector<PlannedSet>& plan);

}  // namespace handhold
