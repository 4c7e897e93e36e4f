#pragma once

#include "quality/force_closure.h"

#include <cmath>
#include <vector>

#include <coin/Clp_C_Interface.h>

namespace handhold::bench {

/// The linear program of glpkMargin by CLP. Its scaling is off: with it, entries of 1e-17 in a wrench give a wrong
/// optimum that is reported as optimal.
class ClpMargin {
 public:
  ClpMargin() : model_(Clp_newModel()) {
    Clp_setLogLevel(model_, 0);
    Clp_scaling(model_, 0);
    Clp_setOptimizationDirection(model_, -1);
  }
  ~ClpMargin() { Clp_deleteModel(model_); }
  ClpMargin(const ClpMargin&) = delete;
  ClpMargin& operator=(const ClpMargin&) = delete;

  double operator()(const WrenchMatrix& wrenches) {
    const int n = static_cast<int>(wrenches.cols());
    starts_.clear();
    rows_.clear();
    values_.clear();
    const Eigen::Matrix<double, 6, 1> sum = wrenches.rowwise().sum();
    for (int j = 0; j <= n; ++j) {
      starts_.push_back(7 * j);
      for (int k = 0; k < 7; ++k) rows_.push_back(k);
      for (int k = 0; k < 6; ++k) values_.push_back(j < n ? wrenches(k, j) : sum[k]);
      values_.push_back(j < n ? 1 : n);
    }
    starts_.push_back(7 * (n + 1));
    lower_.assign(n + 1, 0);
    lower_[n] = -HUGE_VAL;
    upper_.assign(n + 1, HUGE_VAL);
    cost_.assign(n + 1, 0);
    cost_[n] = 1;
    const double rhs[7] = {0, 0, 0, 0, 0, 0, 1};
    Clp_loadProblem(model_, n + 1, 7, starts_.data(), rows_.data(), values_.data(), lower_.data(), upper_.data(),
                    cost_.data(), rhs, rhs);
    Clp_primal(model_, 0);
    if (Clp_status(model_) == 0) return Clp_objectiveValue(model_);
    return Clp_status(model_) == 1 ? -HUGE_VAL : std::nan("");
  }

 private:
  Clp_Simplex* model_;
  std::vector<CoinBigIndex> starts_;
  std::vector<int> rows_;
  std::vector<double> values_, lower_, upper_, cost_;
};

}  // namespace handhold::bench
