// SPDX-License-Identifier: BSD-3-Clause
#include "math/sparse_solver.h"

#include <cholmod.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "math/supernodal_factor.h"
#include "mgsfm/base/error.h"

// CHOLMOD uses GCC's OpenMP on Linux. The functions are declared here because
// not every compiler provides the header of OpenMP.
#ifdef __linux__
// NOLINTBEGIN(readability-identifier-naming)
extern "C" {
int omp_get_max_active_levels();
void omp_set_max_active_levels(int levels);
}
// NOLINTEND(readability-identifier-naming)
#endif

namespace mgsfm {
namespace {

// CHOLMOD starts four OpenMP threads for loops of microseconds, regardless of
// Context::num_threads, and their busy waiting competes with our own threads.
// This guard disables OpenMP threads of the calling thread.
#ifdef __linux__
class WithoutOpenMpThreads {
 public:
  WithoutOpenMpThreads() : levels_(omp_get_max_active_levels()) {
    omp_set_max_active_levels(0);
  }
  ~WithoutOpenMpThreads() { omp_set_max_active_levels(levels_); }
  WithoutOpenMpThreads(const WithoutOpenMpThreads&) = delete;
  WithoutOpenMpThreads& operator=(const WithoutOpenMpThreads&) = delete;

 private:
  const int levels_;
};
#else
class WithoutOpenMpThreads {
 public:
  WithoutOpenMpThreads() {}
};
#endif

// A CHOLMOD view of the lower triangle of a matrix, without copying.
cholmod_sparse ViewLower(const Eigen::SparseMatrix<double>& H) {
  MGSFM_CHECK_EQ(H.rows(), H.cols());
  MGSFM_CHECK(H.isCompressed());
  cholmod_sparse view{};
  view.nrow = H.rows();
  view.ncol = H.cols();
  view.nzmax = H.nonZeros();
  view.p = const_cast<int*>(H.outerIndexPtr());
  view.i = const_cast<int*>(H.innerIndexPtr());
  view.x = const_cast<double*>(H.valuePtr());
  view.stype = -1;
  view.itype = CHOLMOD_INT;
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = 1;
  view.packed = 1;
  return view;
}

cholmod_dense ViewDense(const Eigen::Ref<const Eigen::MatrixXd>& B) {
  cholmod_dense view{};
  view.nrow = B.rows();
  view.ncol = B.cols();
  view.d = std::max<Eigen::Index>(B.outerStride(), B.rows());
  view.nzmax = view.d * view.ncol;
  view.x = const_cast<double*>(B.data());
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  return view;
}

}  // namespace

EliminationOrder FindEliminationOrder(const Eigen::SparseMatrix<double>& H) {
  EliminationOrder result;
  if (H.rows() == 0) return result;
  cholmod_common common;
  cholmod_start(&common);
  common.print = 0;
  common.supernodal = CHOLMOD_SIMPLICIAL;
  // CHOLMOD's default strategy tries dissection based on scalar fill. Here, a
  // row may represent a block, and the default would hardly ever try it.
  constexpr int kMethods[] = {CHOLMOD_AMD, CHOLMOD_METIS, CHOLMOD_NESDIS};
  common.nmethods = 0;
  for (const int method : kMethods) {
    common.method[common.nmethods++].ordering = method;
  }
  cholmod_sparse view = ViewLower(H);
  cholmod_factor* factor = cholmod_analyze(&view, &common);
  if (factor != nullptr) {
    const int* order = static_cast<const int*>(factor->Perm);
    result.order.assign(order, order + H.rows());
    result.num_factor_entries = common.lnz;
    result.num_flops = common.fl;
    cholmod_free_factor(&factor, &common);
  }
  cholmod_finish(&common);
  MGSFM_CHECK_MSG(!result.order.empty(), "CHOLMOD ordering failed");
  return result;
}

struct SparseCholesky::Impl {
  explicit Impl(int count) : num_threads(count) {
    cholmod_start(&common);
    common.print = 0;
    // LL^T instead of LDL^T, which would also factorize indefinite matrices.
    common.final_ll = 1;
    common.quick_return_if_not_posdef = 1;
  }
  ~Impl() {
    FreeFactor();
    cholmod_free_dense(&solution, &common);
    cholmod_free_dense(&workspace_y, &common);
    cholmod_free_dense(&workspace_e, &common);
    cholmod_finish(&common);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void FreeFactor() {
    if (factor != nullptr) cholmod_free_factor(&factor, &common);
    supernodal.reset();
  }

  // CHOLMOD's numeric factorization is single-threaded. It is used only for
  // factors that are too sparse to benefit from supernodes.
  bool FactorizeSupernodes(const Eigen::SparseMatrix<double>& H) {
    if (factor->xtype == CHOLMOD_PATTERN &&
        !cholmod_change_factor(CHOLMOD_REAL, 1, 1, 1, 1, factor, &common)) {
      return false;
    }
    return supernodal->Factorize(H, num_threads, factor);
  }

  // CHOLMOD would call BLAS. OpenBLAS waits forever for its buffer of 128 MB if
  // the process may not have that much memory.
  void SolveSupernodes(const Eigen::Ref<const Eigen::MatrixXd>& B,
                       Eigen::Ref<Eigen::MatrixXd> X) {
    const Eigen::Map<const Eigen::VectorXi> order(
        static_cast<const int*>(factor->Perm), B.rows());
    permuted = B(order, Eigen::all);
    supernodal->Solve(static_cast<const double*>(factor->x), permuted);
    X(order, Eigen::all) = permuted;
  }

  bool FactorizeSimplicial(const Eigen::SparseMatrix<double>& H) {
    cholmod_sparse view = ViewLower(H);
    cholmod_factorize(&view, factor, &common);
    return common.status == CHOLMOD_OK && factor->minor == factor->n;
  }

  const int num_threads;

  cholmod_common common;
  cholmod_factor* factor = nullptr;
  std::optional<SupernodalFactor> supernodal;  // for supernodal factors
  Eigen::Index num_non_zeros = 0;
  bool is_factorized = false;
  // Kept between solves to avoid allocations.
  Eigen::MatrixXd permuted;
  cholmod_dense* solution = nullptr;
  cholmod_dense* workspace_y = nullptr;
  cholmod_dense* workspace_e = nullptr;
};

SparseCholesky::SparseCholesky(int num_threads)
    : impl_(std::make_unique<Impl>(num_threads)) {}
SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

void SparseCholesky::Analyze(const Eigen::SparseMatrix<double>& H,
                             Order order) {
  MGSFM_CHECK_GT(H.rows(), 0);
  cholmod_sparse view = ViewLower(H);
  impl_->FreeFactor();
  // 0 selects CHOLMOD's default strategy.
  impl_->common.nmethods = order == Order::kNatural ? 1 : 0;
  // The natural order results from FindEliminationOrder and is postordered.
  // Otherwise CHOLMOD would permute all values in every factorization.
  impl_->common.postorder = order != Order::kNatural;
  impl_->common.method[0].ordering =
      order == Order::kNatural ? CHOLMOD_NATURAL : CHOLMOD_GIVEN;
  impl_->factor = cholmod_analyze(&view, &impl_->common);
  MGSFM_CHECK_MSG(impl_->factor != nullptr,
                  "CHOLMOD symbolic factorization failed");
  if (impl_->factor->is_super) impl_->supernodal.emplace(*impl_->factor, H);
  impl_->num_non_zeros = H.nonZeros();
  impl_->is_factorized = false;
}

bool SparseCholesky::Factorize(const Eigen::SparseMatrix<double>& H) {
  MGSFM_CHECK(impl_->factor != nullptr);
  MGSFM_CHECK_EQ(H.nonZeros(), impl_->num_non_zeros);
  MGSFM_CHECK_EQ(static_cast<size_t>(H.rows()), impl_->factor->n);
  MGSFM_CHECK(H.isCompressed());
  const WithoutOpenMpThreads serial;
  impl_->is_factorized = impl_->supernodal ? impl_->FactorizeSupernodes(H)
                                           : impl_->FactorizeSimplicial(H);
  // Also detects values that are not finite.
  if (impl_->is_factorized) {
    const double condition = ReciprocalCondition();
    impl_->is_factorized = std::isfinite(condition) && condition > 0.0;
  }
  return impl_->is_factorized;
}

double SparseCholesky::ReciprocalCondition() const {
  if (!impl_->is_factorized) return 0.0;
  return cholmod_rcond(impl_->factor, &impl_->common);
}

void SparseCholesky::Solve(const Eigen::Ref<const Eigen::MatrixXd>& B,
                           Eigen::Ref<Eigen::MatrixXd> X) const {
  MGSFM_CHECK(impl_->is_factorized);
  MGSFM_CHECK_EQ(static_cast<size_t>(B.rows()), impl_->factor->n);
  MGSFM_CHECK_EQ(B.rows(), X.rows());
  MGSFM_CHECK_EQ(B.cols(), X.cols());
  if (B.size() == 0) return;
  if (impl_->supernodal) return impl_->SolveSupernodes(B, X);
  cholmod_dense view = ViewDense(B);
  const WithoutOpenMpThreads serial;
  const int ok = cholmod_solve2(CHOLMOD_A, impl_->factor, &view, nullptr,
                                &impl_->solution, nullptr, &impl_->workspace_y,
                                &impl_->workspace_e, &impl_->common);
  MGSFM_CHECK_MSG(ok, "CHOLMOD solve failed");
  X = Eigen::Map<const Eigen::MatrixXd>(
      static_cast<const double*>(impl_->solution->x), B.rows(), B.cols());
}

SparseLeastSquares::SparseLeastSquares(Eigen::SparseMatrix<double> A,
                                       int num_threads)
    : solver_(num_threads) {
  A_.swap(A);
  A_.makeCompressed();
  Eigen::SparseMatrix<double> H = A_.transpose() * A_;
  H.makeCompressed();
  solver_.Analyze(H);
  is_positive_definite_ = solver_.Factorize(H);
}

}  // namespace mgsfm
