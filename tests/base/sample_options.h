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
  SampleLoss kind = SampleLoss::kTrivial;
  double scale_px = 1.5;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("kind", self.kind, AnyValue(), "", "Shape of the loss.");
    visit("scale_px", self.scale_px, GreaterThan(0.0), "px", "Its scale.");
  }
};

struct SampleSolverOptions {
  int max_num_iterations = 50;
  SampleLossOptions loss;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("max_num_iterations", self.max_num_iterations, Between(1, 100),
          "iterations", "Most iterations.");
    visit.Group("Loss", self.loss);
  }
};

struct SampleOptions {
  std::string input_path;
  bool verbose = false;
  SampleSolverOptions solver;
  std::string title;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("input_path", self.input_path, Required(), "", "What to read.");
    visit("verbose", self.verbose, AnyValue(), "", "Say more | less.");
    visit.Group("Solver", self.solver);
    visit("title", self.title, AnyValue(), "", "Printed first.");
  }
};

inline std::string SampleDump(SampleOptions options) {
  return DumpOptions(ListOptions(&options));
}

}  // namespace mgsfm
