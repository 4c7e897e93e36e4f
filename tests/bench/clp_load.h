#pragma once

#include "quality/task_program.h"

#include <cmath>

#include <coin/Clp_C_Interface.h>

namespace handhold::bench {

/// A TaskProgram by CLP's primal simplex; +infinity when unbounded, NaN when CLP gives up. Its scaling is off, as in
/// clp_margin.h; its tolerances are those that its loads need to be compared to 1e-6, and change its time little.
class ClpLoad {
 public:
  ClpLoad() : model_(Clp_newModel()) {
    Clp_setLogLevel(model_, 0);
    Clp_scaling(model_, 0);
    Clp_setPrimalTolerance(model_, 1e-9);
    Clp_setDualTolerance(model_, 1e-9);
    Clp_setOptimizationDirection(model_, -1);
  }
  ~ClpLoad() { Clp_deleteModel(model_); }
  ClpLoad(const ClpLoad&) = delete;
  ClpLoad& operator=(const ClpLoad&) = delete;

  double operator()(const testing::TaskProgram& program) {
    const std::size_t n = static_cast<std::size_t>(program.columns());
    lower_.assign(n, 0);
    upper_.assign(n, HUGE_VAL);
    cost_.assign(n, 0);
    cost_.back() = 1;
    Clp_loadProblem(model_, program.columns(), program.rows, program.start.data(), program.row.data(),
                    program.value.data(), lower_.data(), upper_.data(), cost_.data(), program.lower.data(),
                    program.upper.data());
    Clp_primal(model_, 0);
    if (Clp_status(model_) == 0) return Clp_objectiveValue(model_);
    return Clp_status(model_) == 2 ? HUGE_VAL : std::nan("");
  }

 private:
  Clp_Simplex* model_;
  std::vector<double> lower_, upper_, cost_;
};

}  // namespace handhold::bench
