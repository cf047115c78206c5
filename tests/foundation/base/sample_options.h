// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/options_io.h"

namespace mgsfm {

// Options of all types in nested groups.

enum class SampleLoss { kTrivial, kCauchy };

template <>
struct EnumTable<SampleLoss> {
  static constexpr std::pair<std::string_view, SampleLoss> kNames[] = {
      {"trivial", SampleLoss::kTrivial}, {"cauchy", SampleLoss::kCauchy}};
};

struct SampleLossOptions {
  Option<SampleLoss> kind{"kind", SampleLoss::kTrivial, "Shape of the loss."};
  Option<double> scale_px{"scale_px", 1.5, GreaterThan(0.0), "px",
                          "Its scale."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(kind, scale_px);
  }
};

struct SampleSolverOptions {
  Option<int> max_num_iterations{"max_num_iterations", 50, Between(1, 100),
                                 "iterations", "Most iterations."};
  SampleLossOptions loss;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(max_num_iterations);
    visit.Group("Loss", loss);
  }
};

struct SampleOptions {
  Option<std::string> input_path{"input_path", "", Required(), "What to read."};
  Option<bool> verbose{"verbose", false, "Say more | less."};
  SampleSolverOptions solver;
  Option<std::string> title{"title", "", "Printed first."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, verbose);
    visit.Group("Solver", solver);
    visit(title);
  }
};

inline std::string SampleDump(SampleOptions options) {
  return DumpOptions(ListOptions(&options));
}

}  // namespace mgsfm
