// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"

namespace mgsfm {

enum class SolverBackend {
  kNative,  // ours
  kCeres,   // Ceres (SPARSE_SCHUR) with the same derivatives, as reference
};

template <>
struct EnumTable<SolverBackend> {
  static constexpr std::pair<std::string_view, SolverBackend> kNames[] = {
      {"native", SolverBackend::kNative}, {"ceres", SolverBackend::kCeres}};
};

}  // namespace mgsfm
