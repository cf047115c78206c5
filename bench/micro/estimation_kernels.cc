// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <string>
#include <vector>

#include "base/random.h"
#include "geometry/triangulation.h"
#include "math/l1_admm.h"
#include "math/sparse_solver.h"
#include "micro/groups.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

Vector3d RandomVector(Random* random) {
  return {random->Normal(), random->Normal(), random->Normal()};
}

// Differences between each node along a drive and the next ten. The first node
// is the origin.
Eigen::SparseMatrix<double> DriveGraph(int num_nodes) {
  constexpr int kNumNext = 10;
  std::vector<Eigen::Triplet<double>> values;
  int row = 0;
  for (int i = 0; i < num_nodes; ++i) {
    for (int j = i + 1; j <= i + kNumNext && j < num_nodes; ++j, ++row) {
      if (i > 0) values.emplace_back(row, i - 1, -1.0);
      values.emplace_back(row, j - 1, 1.0);
    }
  }
  Eigen::SparseMatrix<double> A(row, num_nodes - 1);
  A.setFromTriplets(values.begin(), values.end());
  return A;
}

// Items: edges times iterations.
void RunAdmm(benchmark::State& state) {
  constexpr int kNumIterations = 50;
  const SparseLeastSquares op(DriveGraph(static_cast<int>(state.range(0))));
  Random random(1);
  Eigen::MatrixXd b(op.rows(), 3);
  for (Eigen::Index i = 0; i < b.rows(); ++i) b.row(i) = RandomVector(&random);
  const RowNorms norms{Eigen::VectorXd::Ones(op.rows())};
  AdmmOptions options;
  options.max_num_iterations = kNumIterations;
  options.relative_tolerance = 0.0;
  for (auto _ : state) {
    AdmmState admm;
    benchmark::DoNotOptimize(MinimizeByAdmm(op, b, norms, options, &admm));
  }
  state.SetItemsProcessed(state.iterations() * kNumIterations * op.rows());
  state.counters["iterations/s"] = benchmark::Counter(
      static_cast<double>(state.iterations()) * kNumIterations,
      benchmark::Counter::kIsRate);
}

// Rays to points ahead of a drive, with noise.
struct RaysOfPoint {
  std::vector<Vector3d> centers, rays;
};

std::vector<RaysOfPoint> MakeRays(int num_rays) {
  constexpr int kNumPoints = 500;
  Random random(1);
  std::vector<RaysOfPoint> points(kNumPoints);
  for (RaysOfPoint& point : points) {
    const Vector3d at = Vector3d(0.0, 0.0, 20.0) + 3.0 * RandomVector(&random);
    for (int i = 0; i < num_rays; ++i) {
      point.centers.emplace_back(0.5 * (i % 2), 0.0, 1.0 * (i / 2));
      const Vector3d ray = (at - point.centers.back()).normalized();
      point.rays.push_back((ray + 1e-3 * RandomVector(&random)).normalized());
    }
  }
  return points;
}

template <class Function>
void Triangulate(benchmark::State& state, const Function& function) {
  const int num_rays = static_cast<int>(state.range(0));
  const std::vector<RaysOfPoint> points = MakeRays(num_rays);
  for (auto _ : state) {
    for (const RaysOfPoint& point : points) {
      benchmark::DoNotOptimize(function(point.centers, point.rays));
    }
  }
  state.SetItemsProcessed(state.iterations() *
                          static_cast<int64_t>(points.size()));
}

template <class Function>
void RegisterTriangulation(const char* name, const Function& function) {
  benchmark::RegisterBenchmark(
      name,
      [function](benchmark::State& state) { Triangulate(state, function); })
      ->ArgName("rays")
      ->Arg(4)
      ->Arg(10)
      ->Unit(benchmark::kMillisecond);
}

}  // namespace

void RegisterEstimationBenchmarks() {
  benchmark::RegisterBenchmark("admm", RunAdmm)
      ->ArgName("nodes")
      ->Arg(500)
      ->Arg(5000)
      ->Unit(benchmark::kMillisecond);
  RegisterTriangulation("triangulate_midpoint", TriangulateMidpoint);
  RegisterTriangulation("triangulate_l1", TriangulateL1);
  RegisterTriangulation(
      "triangulate_robust", [](const std::vector<Vector3d>& centers,
                               const std::vector<Vector3d>& rays) {
        return TriangulateRobust(centers, rays, RobustTriangulationOptions());
      });
}

}  // namespace mgsfm
