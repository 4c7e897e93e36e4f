#pragma once

#include "quality/force_closure.h"
#include "quality/symmetric_factor.h"

#include <memory>
#include <span>

#include <Eigen/Core>

namespace handhold {

/// How contact forces load the joints that are driven. With the twist of a contact's link when joint d moves by one
/// unit, (v; omega) at the centre of mass in the object frame, the generalised force of a contact wrench (f; tau) is
///
///     v . f + omega . tau                                                                                    (15)
///
/// A limit of a contact's normal force is a joint too, with v = n, omega = (p - c) x n at that contact alone.
struct Actuation {
  Eigen::MatrixXd motion;  // (6 nContacts, D): v [m/rad or 1], omega [1 or rad/m] of contact i in rows 6 i to 6 i + 5
  Eigen::VectorXd effort;  // (D) > 0 [N m or N]
};

/// Wrenches on the object, one a column, for each newton of load: force [1], torque about the centre of mass [m]. (6,
/// T)
using TaskWrenches = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// The object's weight in `count` directions that are spread over the sphere: z_i = 1 - (2 i + 1) / count, each turned
/// from the last by the golden angle pi (3 - sqrt 5). Deterministic.
TaskWrenches weightDirections(int count);

enum class LoadVerdict : unsigned char {
  optimal,    // the load is the margin
  zero,       // there is a task of which nothing can be resisted; the load is 0
  unbounded,  // no limit bounds the load, +infinity: all tasks are carried past the limited joints
  failed,     // rounding stopped the method; the load is NaN
};

struct LoadMargin {
  LoadVerdict verdict = LoadVerdict::failed;
  double load = 0;     // N
  int iterations = 0;  // of the interior-point method
  double gap = 0;      // N, load + gap cannot be resisted
};

/// The largest load lambda of which every task can be resisted,
///
///     max lambda:   W x_t + lambda w_t = 0,   |L x_t| <= effort,   x_t >= 0   for every task t                   (16)
///
/// W the linearised friction cones of frictionConeWrenches, not bounded in sum, L x their generalised forces (15). One
/// worker's: it keeps the analysis of each sparsity pattern (the number of tasks and which joints share contacts) and
/// its memory. A result depends on the arguments alone, to the last bit, not on what was solved before. Source:
/// src/quality/README.md, "Load margin".
class LoadMarginSolver {
 public:
  /// `makeFactor` factors the normal equations.
  explicit LoadMarginSolver(const WrenchModel& model, MakeSymmetricFactor makeFactor = makeSparseFactor);
  ~LoadMarginSolver();
  LoadMarginSolver(LoadMarginSolver&&) noexcept;

  /// Numbers that are not finite make it `failed`. No tasks, or tasks that are zero: `unbounded`.
  LoadMargin solve(std::span<const Contact> contacts, const Actuation& actuation, const TaskWrenches& tasks);

 private:
  class Method;
  std::unique_ptr<Method> method_;
};

}  // namespace handhold
