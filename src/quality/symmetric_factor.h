#pragma once

#include <functional>
#include <memory>
#include <vector>

namespace handhold {

/// Where a symmetric matrix may have entries: its lower triangle by columns, rows ascending, diagonals always.
struct SymmetricPattern {
  int size = 0;
  std::vector<int> start;  // (size + 1) into row
  std::vector<int> row;
};

/// A Cholesky factor of matrices of one pattern, which is analysed when it is made. Not thread safe.
class SymmetricFactor {
 public:
  virtual ~SymmetricFactor() = default;
  /// @param values  one for each entry of the pattern
  /// @return false when the matrix is not positive definite to rounding
  virtual bool factorise(const std::vector<double>& values) = 0;
  /// Replaces a right side (size) by its solution.
  virtual void solve(double* rhs) = 0;
};

using MakeSymmetricFactor = std::function<std::unique_ptr<SymmetricFactor>(const SymmetricPattern&)>;

/// CHOLMOD, simplicial: its own loops, without the BLAS and the threads that one may have. Ordered by AMD alone, so
/// that equal patterns give equal bits.
std::unique_ptr<SymmetricFactor> makeSparseFactor(const SymmetricPattern& pattern);

}  // namespace handhold
