// SPDX-License-Identifier: BSD-3-Clause
#include "math/in_place_cholesky.h"

#include <cholmod.h>

#include "base/memory.h"
#include "math/supernodal_factor.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

InPlaceCholesky::InPlaceCholesky(int num_threads) : num_threads_(num_threads) {}
InPlaceCholesky::~InPlaceCholesky() = default;

void InPlaceCholesky::Analyze(std::vector<int> column_begin,
                              std::vector<int> rows) {
  MGSFM_CHECK_GT(column_begin.size(), size_t{1});
  cholmod_common common;
  cholmod_start(&common);
  common.print = 0;
  common.nmethods = 1;
  common.method[0].ordering = CHOLMOD_NATURAL;
  common.postorder = 0;
  common.supernodal = CHOLMOD_SUPERNODAL;
  // Supernodes of equal rows only. CHOLMOD would join more, which takes 13 %
  // more values and no less time (docs/results/constants.md).
  for (int i = 0; i < 3; ++i) {
    common.nrelax[i] = 0;
    common.zrelax[i] = 0.0;
  }
  cholmod_sparse pattern{};
  pattern.nrow = pattern.ncol = column_begin.size() - 1;
  pattern.nzmax = rows.size();
  pattern.p = column_begin.data();
  pattern.i = rows.data();
  pattern.stype = -1;
  pattern.itype = CHOLMOD_INT;
  pattern.xtype = CHOLMOD_PATTERN;
  pattern.dtype = CHOLMOD_DOUBLE;
  pattern.sorted = 1;
  pattern.packed = 1;
  cholmod_factor* symbolic = cholmod_analyze(&pattern, &common);
  if (symbolic != nullptr) {
    factor_ = std::make_unique<SupernodalFactor>(*symbolic);
    cholmod_free_factor(&symbolic, &common);
  }
  cholmod_finish(&common);
  MGSFM_CHECK_MSG(factor_ != nullptr, "CHOLMOD symbolic factorisation failed");
  column_begin = std::vector<int>();
  rows = std::vector<int>();
  ReturnFreedMemory();
  values_ = std::vector<double>(factor_->num_values());
}

InPlaceCholesky::Place InPlaceCholesky::Find(int row, int column) const {
  const auto [position, stride] = factor_->Find(row, column);
  return {position, stride};
}

bool InPlaceCholesky::Factorize() {
  return factor_->FactorizeInPlace(num_threads_, values_.data());
}

void InPlaceCholesky::Solve(const Eigen::Ref<Eigen::MatrixXd>& x) const {
  factor_->Solve(values_.data(), x);
}

}  // namespace mgsfm
