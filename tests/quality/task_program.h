#pragma once

#include "quality/load_margin.h"

#include <cmath>
#include <span>
#include <vector>

namespace handhold::testing {

/// The linear program of LoadMarginSolver, written for other solvers: max of the last column, rows within [lower,
/// upper], columns >= 0. For each task six rows that balance and one for each joint, |L x| / effort <= 1; one load for
/// all.
struct TaskProgram {
  int rows = 0;
  std::vector<int> start{0}, row;  // by columns
  std::vector<double> value, lower, upper;
  int columns() const { return static_cast<int>(start.size()) - 1; }
};

inline TaskProgram taskProgram(std::span<const Contact> contacts, const Actuation& actuation, const TaskWrenches& tasks,
                               const WrenchModel& model) {
  constexpr double kNoise = 1e-13;  // CLP's scaling is misled by smaller ones
  const WrenchMatrix wrenches = frictionConeWrenches(contacts, model);
  const int D = static_cast<int>(actuation.effort.size()), T = static_cast<int>(tasks.cols()), block = 6 + D;
  TaskProgram program;
  program.rows = block * T;
  const auto add = [&](int row, double value) {
    if (std::abs(value) <= kNoise) return;
    program.row.push_back(row);
    program.value.push_back(value);
  };
  const auto endColumn = [&] { program.start.push_back(static_cast<int>(program.row.size())); };
  for (int t = 0; t < T; ++t) {
    for (int j = 0; j < wrenches.cols(); ++j) {
      const Eigen::Matrix<double, 6, 1> w = wrenches.col(j);
      for (int k = 0; k < 6; ++k) add(block * t + k, w[k]);
      for (int d = 0; d < D; ++d) {
        const auto motion = actuation.motion.col(d).segment<6>(6 * (j / model.coneEdges));
        const double torque = motion.head<3>().dot(w.head<3>()) + model.torqueScale * motion.tail<3>().dot(w.tail<3>());
        add(block * t + 6 + d, torque / actuation.effort[d]);
      }
      endColumn();
    }
    for (int row = 0; row < block; ++row) {
      program.lower.push_back(row < 6 ? 0 : -1);
      program.upper.push_back(row < 6 ? 0 : 1);
    }
  }
  for (int t = 0; t < T; ++t) {
    for (int k = 0; k < 6; ++k) add(block * t + k, tasks(k, t) / (k < 3 ? 1 : model.torqueScale));
  }
  endColumn();
  return program;
}

}  // namespace handhold::testing
