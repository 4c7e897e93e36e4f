#include "quality/symmetric_factor.h"

#include <algorithm>
#include <new>

#include <cholmod.h>

namespace handhold {
namespace {

class SparseFactor : public SymmetricFactor {
 public:
  explicit SparseFactor(const SymmetricPattern& pattern) : pattern_(pattern) {
    cholmod_start(&common_);
    common_.print = 0;
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_AMD;
    common_.supernodal = CHOLMOD_SIMPLICIAL;
    common_.final_ll = 1;  // L L^T stops at a pivot that is not positive, L D L^T would go on
    matrix_.nrow = matrix_.ncol = static_cast<std::size_t>(pattern_.size);
    matrix_.nzmax = pattern_.row.size();
    matrix_.p = pattern_.start.data();
    matrix_.i = pattern_.row.data();
    matrix_.stype = -1;
    matrix_.itype = CHOLMOD_INT;
    matrix_.xtype = CHOLMOD_PATTERN;
    matrix_.dtype = CHOLMOD_DOUBLE;
    matrix_.sorted = matrix_.packed = 1;
    factor_ = cholmod_analyze(&matrix_, &common_);
    if (factor_ == nullptr) {
      cholmod_finish(&common_);
      throw std::bad_alloc();
    }
  }
  ~SparseFactor() override {
    cholmod_free_dense(&solution_, &common_);
    cholmod_free_dense(&work_, &common_);
    cholmod_free_dense(&edge_, &common_);
    cholmod_free_factor(&factor_, &common_);
    cholmod_finish(&common_);
  }
  SparseFactor(const SparseFactor&) = delete;
  SparseFactor& operator=(const SparseFactor&) = delete;

  bool factorise(const std::vector<double>& values) override {
    matrix_.x = const_cast<double*>(values.data());  // CHOLMOD only reads it
    matrix_.xtype = CHOLMOD_REAL;
    const bool done = cholmod_factorize(&matrix_, factor_, &common_) != 0;
    if (common_.status == CHOLMOD_OUT_OF_MEMORY) throw std::bad_alloc();
    return done && common_.status == CHOLMOD_OK && factor_->minor == factor_->n;
  }

  void solve(double* rhs) override {
    cholmod_dense right{};
    right.nrow = right.d = right.nzmax = matrix_.nrow;
    right.ncol = 1;
    right.x = rhs;
    right.xtype = CHOLMOD_REAL;
    right.dtype = CHOLMOD_DOUBLE;
    if (!cholmod_solve2(CHOLMOD_A, factor_, &right, nullptr, &solution_, nullptr, &work_, &edge_, &common_)) {
      throw std::bad_alloc();
    }
    std::copy_n(static_cast<const double*>(solution_->x), right.nrow, rhs);
  }

 private:
  SymmetricPattern pattern_;  // matrix_ points into it
  cholmod_common common_{};
  cholmod_sparse matrix_{};
  cholmod_factor* factor_ = nullptr;
  cholmod_dense *solution_ = nullptr, *work_ = nullptr, *edge_ = nullptr;  // kept by CHOLMOD from call to call
};

}  // namespace

std::unique_ptr<SymmetricFactor> makeSparseFactor(const SymmetricPattern& pattern) {
  return std::make_unique<SparseFactor>(pattern);
}

}  // namespace handhold
