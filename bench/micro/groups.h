// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mgsfm {

// Each function registers a group of micro-benchmarks.
void RegisterSolverBenchmarks();      // linearization, elimination, factor
void RegisterCameraBenchmarks();      // projection and rays
void RegisterMatchingBenchmarks();    // database, inlier tests, tracks
void RegisterEstimationBenchmarks();  // ADMM, triangulation

}  // namespace mgsfm
