// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>

#include <string>
#include <vector>

#include "estimation/rig_solver/rig_fixtures.h"
#include "machine_limits.h"
#include "math/sparse_solver.h"
#include "micro/camera_of_model.h"
#include "micro/groups.h"
#include "rig_solver/residuals.h"
#include "rig_solver/rig_equations.h"
#include "solver/pass_cost.h"

namespace mgsfm {
namespace {

constexpr double kLambda = 1e-4;

enum class Kernel {
  kLinearize,           // points held: residuals, derivatives, their products
  kLinearizeEliminate,  // points free
  kSolve,               // factorization and solution of the frame system
  kStep,                // steps of points, and the cost after
};

struct Case {
  std::string name;
  Kernel kernel = Kernel::kLinearize;
  RigSceneOptions scene;
  int num_threads = 1;
};

// Two cameras; each point is observed in six frames.
RigSceneOptions SceneOptions(const TestCamera& camera) {
  RigSceneOptions options;
  options.cameras = {camera, camera};
  options.num_frames = 200;
  options.num_points = 10000;
  options.num_frames_of_point = 6;
  options.noise_px = 0.5;
  return options;
}

void RunKernel(Kernel kernel, RigEquationsBase* equations) {
  if (kernel == Kernel::kSolve) {
    benchmark::DoNotOptimize(equations->Solve());
  } else if (kernel == Kernel::kStep) {
    benchmark::DoNotOptimize(equations->TryStep());
  } else {
    benchmark::DoNotOptimize(equations->Linearize(kLambda));
  }
}

// Operations and bytes per run.
struct Work {
  double flops = 0.0;
  double bytes = 0.0;
};

Work WorkOf(Kernel kernel, const PassCost& cost,
            const RigStructure& structure) {
  switch (kernel) {
    case Kernel::kLinearize:
      return {cost.linearize_flops, cost.linearize_bytes};
    case Kernel::kLinearizeEliminate:
      return {cost.linearize_flops + cost.eliminate_flops,
              cost.linearize_bytes};
    case Kernel::kStep:
      return {cost.step_flops, cost.step_bytes};
    default: {
      const EliminationOrder order =
          FindEliminationOrder(structure.pattern.MakeMatrix());
      return {order.num_flops, 8.0 * order.num_factor_entries};
    }
  }
}

void Report(const Case& c, const Work& work, double num_items, const char* item,
            benchmark::State* state) {
  const double runs = static_cast<double>(state->iterations());
  const MachineLimits& limits = MeasuredMachineLimits();
  const auto rate = benchmark::Counter::kIsRate;
  state->SetItemsProcessed(static_cast<int64_t>(runs * num_items));
  state->counters[std::string("flops/") + item] = work.flops / num_items;
  state->counters[std::string("bytes/") + item] = work.bytes / num_items;
  state->counters["flop/s"] = benchmark::Counter(runs * work.flops, rate);
  state->counters["of_multiply_add"] = benchmark::Counter(
      runs * work.flops / (c.num_threads * limits.flops_per_second), rate);
  state->counters["of_copy"] = benchmark::Counter(
      runs * work.bytes / limits.copied_bytes_per_second, rate);
}

template <class R, class Scene>
void BenchmarkScene(const Case& c, const Scene& scene,
                    benchmark::State* state) {
  RigEquations<R> equations(scene.problem, {ReducedSolver::kDirect},
                            Threads(c.num_threads));
  equations.SetState(scene.truth);
  if (!equations.Linearize(kLambda) || !equations.Solve()) {
    state->SkipWithError("the equations cannot be solved");
    return;
  }
  for (auto _ : *state) RunKernel(c.kernel, &equations);
  const Work work =
      WorkOf(c.kernel, CountPassCost(scene.problem, equations.structure()),
             equations.structure());
  if (c.kernel == Kernel::kSolve) {
    Report(c, work, equations.structure().num_unknowns, "unknown", state);
  } else {
    Report(c, work, static_cast<double>(scene.problem.observations.size()),
           "observation", state);
  }
}

// Single-threaded benchmarks report CPU time, which other processes do not
// affect.
void Register(const Case& c) {
  auto* registered =
      benchmark::RegisterBenchmark(
          (c.name + "/threads:" + std::to_string(c.num_threads)).c_str(),
          [c](benchmark::State& state) {
            BenchmarkScene<PixelResidual>(c, MakePixelScene(c.scene), &state);
          })
          ->Unit(benchmark::kMillisecond);
  if (c.num_threads > 1) registered->UseRealTime();
}

void RegisterOfCamera(const TestCamera& camera) {
  const std::string model = ModelName(camera);
  Case c;
  c.scene = SceneOptions(camera);
  c.name = "linearize_eliminate/" + model;
  c.kernel = Kernel::kLinearizeEliminate;
  Register(c);
  c.name = "linearize_eliminate_refined/" + model;
  c.scene.params_are_free = true;
  Register(c);
  c.scene.params_are_free = false;
  c.name = "linearize/" + model;
  c.kernel = Kernel::kLinearize;
  c.scene.points_are_free = false;
  Register(c);
  c.scene.points_are_free = true;
  c.name = "step/" + model;
  c.kernel = Kernel::kStep;
  Register(c);
}

}  // namespace

void RegisterSolverBenchmarks() {
  for (const TestCamera& camera : CameraOfEachModel()) RegisterOfCamera(camera);
  Case c;
  c.scene = SceneOptions(CameraOfEachModel()[1]);
  c.name = "linearize_eliminate/" + ModelName(CameraOfEachModel()[1]);
  c.kernel = Kernel::kLinearizeEliminate;
  c.num_threads = 2;
  Register(c);
  c.num_threads = 1;
  c.kernel = Kernel::kSolve;
  for (const int num_frames : {200, 1000, 4000}) {
    c.name = "frame_system/frames:" + std::to_string(num_frames);
    c.scene.num_frames = num_frames;
    c.scene.num_points = 20 * num_frames;
    c.scene.num_frames_of_point = 12;
    Register(c);
  }
}

}  // namespace mgsfm
