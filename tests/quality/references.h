#pragma once

#include "quality/force_closure.h"
#include "quality/task_program.h"

// The same questions answered by two libraries that share no code with ours.
namespace handhold::testing {

/// rank W = 6 (a pivot below 1e-9 of the largest counts as zero).
bool hasFullRank(const WrenchMatrix& wrenches);

/// The optimum of  max t: W lambda = 0, sum lambda = 1, lambda >= t,  by GLPK; -infinity when infeasible, NaN when
/// GLPK gives up. With mu = lambda - t it has 7 rows: W mu + (sum of columns) t = 0, sum mu + n t = 1, mu >= 0.
double glpkMargin(const WrenchMatrix& wrenches);

/// The load of a TaskProgram by GLPK: +infinity when unbounded, NaN when GLPK gives up.
double glpkLoad(const TaskProgram& program);

/// min over the facets of the hull of the signed distance from the origin, by Qhull with "Qt"; positive inside, NaN
/// when Qhull refuses (a flat set, or rounding).
double qhullEpsilon(const WrenchMatrix& wrenches);

}  // namespace handhold::testing
