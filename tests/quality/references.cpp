#include "quality/references.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <vector>

#include <Eigen/QR>
#include <glpk.h>

extern "C" {
#include <libqhull_r/qhull_ra.h>
}

namespace handhold::testing {

bool hasFullRank(const WrenchMatrix& wrenches) {
  Eigen::ColPivHouseholderQR<WrenchMatrix> qr(wrenches);
  qr.setThreshold(1e-9);
  return qr.rank() == 6;
}

double glpkMargin(const WrenchMatrix& wrenches) {
  const int n = static_cast<int>(wrenches.cols());
  const std::unique_ptr<glp_prob, void (*)(glp_prob*)> problem(glp_create_prob(), glp_delete_prob);
  glp_prob* lp = problem.get();
  glp_set_obj_dir(lp, GLP_MAX);
  glp_add_rows(lp, 7);
  for (int row = 1; row <= 7; ++row) glp_set_row_bnds(lp, row, GLP_FX, row == 7, row == 7);
  glp_add_cols(lp, n + 1);
  const Eigen::Matrix<double, 6, 1> sum = wrenches.rowwise().sum();
  for (int j = 1; j <= n + 1; ++j) {
    int rows[8] = {0, 1, 2, 3, 4, 5, 6, 7};
    double values[8] = {};
    for (int k = 0; k < 6; ++k) values[k + 1] = j <= n ? wrenches(k, j - 1) : sum[k];
    values[7] = j <= n ? 1 : n;
    glp_set_col_bnds(lp, j, j <= n ? GLP_LO : GLP_FR, 0, 0);
    glp_set_mat_col(lp, j, 7, rows, values);
  }
  glp_set_obj_coef(lp, n + 1, 1);
  glp_smcp options;
  glp_init_smcp(&options);
  options.msg_lev = GLP_MSG_OFF;
  if (glp_simplex(lp, &options) != 0) return std::numeric_limits<double>::quiet_NaN();
  if (glp_get_status(lp) == GLP_OPT) return glp_get_obj_val(lp);
  return glp_get_status(lp) == GLP_NOFEAS ? -HUGE_VAL : std::numeric_limits<double>::quiet_NaN();
}

double glpkLoad(const TaskProgram& program) {
  const int n = program.columns();
  const std::unique_ptr<glp_prob, void (*)(glp_prob*)> problem(glp_create_prob(), glp_delete_prob);
  glp_prob* lp = problem.get();
  glp_set_obj_dir(lp, GLP_MAX);
  glp_add_rows(lp, program.rows);
  for (int row = 0; row < program.rows; ++row) {
    const bool isFixed = program.lower[row] == program.upper[row];
    glp_set_row_bnds(lp, row + 1, isFixed ? GLP_FX : GLP_DB, program.lower[row], program.upper[row]);
  }
  glp_add_cols(lp, n);
  for (int j = 0; j < n; ++j) {
    std::vector<int> rows = {0};
    std::vector<double> values = {0};
    for (int i = program.start[j]; i < program.start[j + 1]; ++i) {
      rows.push_back(program.row[i] + 1);
      values.push_back(program.value[i]);
    }
    glp_set_col_bnds(lp, j + 1, GLP_LO, 0, 0);
    glp_set_mat_col(lp, j + 1, static_cast<int>(rows.size()) - 1, rows.data(), values.data());
  }
  glp_set_obj_coef(lp, n, 1);
  glp_smcp options;
  glp_init_smcp(&options);
  options.msg_lev = GLP_MSG_OFF;
  options.tol_bnd = options.tol_dj = 1e-9;
  if (glp_simplex(lp, &options) != 0) return std::numeric_limits<double>::quiet_NaN();
  if (glp_get_status(lp) == GLP_OPT) return glp_get_obj_val(lp);
  return glp_get_status(lp) == GLP_UNBND ? HUGE_VAL : std::numeric_limits<double>::quiet_NaN();
}

double qhullEpsilon(const WrenchMatrix& wrenches) {
  WrenchMatrix points = wrenches;
  char options[] = "qhull Qt";
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> silent(std::fopen("/dev/null", "w"), std::fclose);
  const std::unique_ptr<qhT> memory = std::make_unique<qhT>();
  qhT* qh = memory.get();
  qh_zero(qh, silent.get());
  const int error =
      qh_new_qhull(qh, 6, static_cast<int>(points.cols()), points.data(), False, options, nullptr, silent.get());
  double epsilon = error ? std::numeric_limits<double>::quiet_NaN() : HUGE_VAL;
  if (!error) {
    facetT* facet = nullptr;
    FORALLfacets { epsilon = std::fmin(epsilon, -facet->offset); }
  }
  qh_freeqhull(qh, !qh_ALL);
  int current = 0;
  int total = 0;
  qh_memfreeshort(qh, &current, &total);
  return epsilon;
}

}  // namespace handhold::testing
