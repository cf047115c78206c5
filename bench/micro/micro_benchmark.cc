// SPDX-License-Identifier: BSD-3-Clause
// Benchmarks of the inner loops with Google Benchmark. --help lists the
// options, e.g.
//   mgsfm_micro_benchmark --benchmark_filter=linearize
// The same run measures the peak throughput of the machine.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <string>

#include "machine_limits.h"
#include "micro/groups.h"

namespace {

std::string Giga(double value, const char* unit) {
  char text[64];
  std::snprintf(text, sizeof(text), "%.1f %s", 1e-9 * value, unit);
  return text;
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  const mgsfm::MachineLimits& limits = mgsfm::MeasuredMachineLimits();
  benchmark::AddCustomContext("copy, one thread",
                              Giga(limits.copied_bytes_per_second, "GB/s"));
  benchmark::AddCustomContext("multiply-add, one thread",
                              Giga(limits.flops_per_second, "Gflop/s"));
  mgsfm::RegisterSolverBenchmarks();
  mgsfm::RegisterCameraBenchmarks();
  mgsfm::RegisterMatchingBenchmarks();
  mgsfm::RegisterEstimationBenchmarks();
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
