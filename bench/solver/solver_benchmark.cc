// SPDX-License-Identifier: BSD-3-Clause
// Runs the stages of the mapper up to bundle adjustment on a database or a
// simulated drive, and solves the bundle problem with the native solver, with
// Ceres and the same analytic derivatives, and with the six-block formulation
// of six_block_bundle.h. Prints a table and writes it as JSON.
#include <cstdio>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/problem_builder.h"
#include "command.h"
#include "files/file_operations.h"
#include "machine_limits.h"
#include "math/sparse_solver.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/models/scene_loading.h"
#include "rig_solver/rig_solver.h"
#include "rotation_averaging/rotation_estimation.h"
#include "simulated_run.h"
#include "solver/pass_cost.h"
#include "solver/six_block_bundle.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

struct BenchmarkOptions {
  SimulatedRunOptions run;
  Option<std::string> database_path{
      "database_path", "",
      "Database with verified matches, instead of a simulation."};
  Option<double> start_max_error_px{
      "start_max_error", 16.0, GreaterThan(0.0), "px",
      "Observations with larger errors at the start are excluded."};
  Option<double> function_tolerance{
      "function_tolerance", 1e-9, Between(0.0, 1.0),
      "A solve ends when the cost changes by less than this part."};
  Option<int> max_num_iterations{"max_num_iterations", 100, AtLeast(2),
                                 "iterations", "Most iterations of one solve."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(run, database_path, start_max_error_px, function_tolerance,
          max_num_iterations);
  }
};

struct Input {
  Scene scene;
  ViewGraph view_graph;
};

Input MakeInput(const BenchmarkOptions& options, const Context& context) {
  if (!options.database_path->empty()) {
    LoadedScene loaded =
        LoadScene(options.database_path, SceneLoadingOptions(), context);
    return {std::move(loaded.scene), std::move(loaded.view_graph)};
  }
  Simulation simulation = SimulateRun(options.run, context);
  return {std::move(simulation.scene), std::move(simulation.view_graph)};
}

// The initial state of bundle adjustment.
Reconstruction RunStages(const Input& input, const MapperOptions& options,
                         const Context& context) {
  const Scene& scene = input.scene;
  const Bearings bearings = ComputeBearings(scene, context.num_threads);
  const ViewGraphResult view_graph = EstimateViewGraph(
      scene, bearings, input.view_graph, options.view_graph, context);
  const EstimatedRotations rotation = EstimateRotations(
      {scene, view_graph.estimate, FramePairIndex(scene, view_graph.estimate)},
      {options.rotation_averaging, PairFilteringOptions()}, context);
  const TrackResult tracks = EstablishTracks(scene, view_graph.estimate,
                                             rotation.estimate.pair_is_inlier,
                                             options.tracks, context);
  const TranslationResult translation =
      AverageTranslations({scene, bearings, view_graph.estimate,
                           rotation.estimate, tracks.estimate},
                          options.translation_averaging, context);
  return JoinEstimates(scene, rotation.estimate, translation.estimate,
                       tracks.estimate);
}

// A solver: runs at most the given number of iterations and returns the
// seconds.
struct Contender {
  std::string name;
  std::function<SolveSummary(int, RigState*, double*)> solve;
};

struct Measurement {
  SolveSummary summary;
  double seconds = 0.0;
  double seconds_per_iteration = 0.0;
};

// Seconds per iteration, from the difference between a full solve and a solve
// of one iteration. This excludes the setup.
Measurement Measure(const Contender& contender, int max_num_iterations,
                    const RigState& start) {
  RigState state = start;
  double first = 0.0;
  const SolveSummary one = contender.solve(1, &state, &first);
  state = start;
  Measurement m;
  m.summary = contender.solve(max_num_iterations, &state, &m.seconds);
  const int more = m.summary.num_iterations - one.num_iterations;
  m.seconds_per_iteration = more > 0 ? (m.seconds - first) / more : 0.0;
  return m;
}

std::vector<Contender> MakeContenders(const BundleProblem& problem,
                                      const BenchmarkOptions& options,
                                      const Context& context) {
  const auto rig_solver = [&problem, &options, &context](
                              SolverBackend backend, int max_num_iterations,
                              RigState* state, double* seconds) {
    RigSolverOptions solver_options;
    solver_options.backend = backend;
    solver_options.function_tolerance = options.function_tolerance;
    solver_options.max_num_iterations = max_num_iterations;
    const Timer timer;
    const SolveSummary summary =
        SolveRigProblem(problem, solver_options, context, state);
    *seconds = timer.Seconds();
    return summary;
  };
  return {{"native",
           [rig_solver](int n, RigState* state, double* seconds) {
             return rig_solver(SolverBackend::kNative, n, state, seconds);
           }},
          {"ceres analytic",
           [rig_solver](int n, RigState* state, double* seconds) {
             return rig_solver(SolverBackend::kCeres, n, state, seconds);
           }},
          {"ceres six blocks", [&problem, &options, &context](
                                   int n, RigState* state, double* seconds) {
             return SolveSixBlockBundle(problem, n, options.function_tolerance,
                                        context.num_threads, state, seconds);
           }}};
}

Json ToJson(const Measurement& m, const Measurement& native) {
  return {{"seconds", m.seconds},
          {"num_iterations", m.summary.num_iterations},
          {"seconds_per_iteration", m.seconds_per_iteration},
          {"iteration_ratio",
           m.seconds_per_iteration / native.seconds_per_iteration},
          {"initial_cost", m.summary.initial_cost},
          {"final_cost", m.summary.final_cost},
          {"relative_cost_difference",
           m.summary.final_cost / native.summary.final_cost - 1.0},
          {"termination", EnumName(m.summary.termination)}};
}

void PrintLine(const std::string& name, const Json& line) {
  std::printf("%-18s %8.2f %6d %12.5f %8.2f %20.8f %12.2e\n", name.c_str(),
              line["seconds"].get<double>(), line["num_iterations"].get<int>(),
              line["seconds_per_iteration"].get<double>(),
              line["iteration_ratio"].get<double>(),
              line["final_cost"].get<double>(),
              line["relative_cost_difference"].get<double>());
  std::fflush(stdout);
}

// Operations and bytes per observation and iteration of the native solver, also
// as fractions of the peak throughput of the machine.
Json WorkToJson(const BundleProblem& problem, double seconds_per_iteration,
                const Context& context) {
  std::vector<int> images;
  for (const PixelObservation& o : problem.observations) {
    images.push_back(o.image);
  }
  const RigStructure structure(problem, std::move(images),
                               {ReducedSolver::kAuto}, context.num_threads);
  const PassCost cost = CountPassCost(problem, structure);
  const EliminationOrder order =
      FindEliminationOrder(structure.pattern.MakeMatrix());
  const MachineLimits& limits = MeasuredMachineLimits();
  const auto num = static_cast<double>(problem.observations.size());
  return {{"flops_per_observation", cost.Flops() / num},
          {"bytes_per_observation", cost.Bytes() / num},
          {"is_iterative", structure.is_iterative},
          {"num_unknowns", structure.num_unknowns},
          {"factor_flops", order.num_flops},
          {"factor_entries", order.num_factor_entries},
          {"copied_bytes_per_second", limits.copied_bytes_per_second},
          {"flops_per_second", limits.flops_per_second},
          {"share_of_copy", cost.Bytes() / seconds_per_iteration /
                                limits.copied_bytes_per_second},
          {"share_of_multiply_add",
           cost.Flops() / seconds_per_iteration /
               (context.num_threads * limits.flops_per_second)}};
}

void PrintWork(const Json& work) {
  std::printf(
      "native: %.0f flops and %.0f bytes an observation and iteration, %.1f %% "
      "of multiply-adds and %.1f %% of copying (%.1f Gflop/s a thread, %.1f "
      "GB/s), %d unknowns, reduced equations %s, %.3g flops for their factor\n",
      work["flops_per_observation"].get<double>(),
      work["bytes_per_observation"].get<double>(),
      100.0 * work["share_of_multiply_add"].get<double>(),
      100.0 * work["share_of_copy"].get<double>(),
      1e-9 * work["flops_per_second"].get<double>(),
      1e-9 * work["copied_bytes_per_second"].get<double>(),
      work["num_unknowns"].get<int>(),
      work["is_iterative"].get<bool>() ? "iterative" : "factorized",
      work["factor_flops"].get<double>());
}

int RunBenchmark(const BenchmarkOptions& options, const Context& context) {
  const Input input = MakeInput(options, context);
  Reconstruction start = RunStages(input, options.run.mapper, context);
  PointFilterOptions filter;
  filter.max_error_px = options.start_max_error_px;
  filter.min_angle_rad =
      options.run.mapper.bundle_adjustment.min_triangulation_angle_deg *
      (EIGEN_PI / 180.0);
  FilterPoints(input.scene, filter, context.num_threads, &start);
  const BuiltProblem built =
      BuildProblem(input.scene, start, options.run.mapper.bundle_adjustment,
                   RefinedParts::kAll);
  std::printf("%s: %zu images, %zu points, %zu observations, %d threads\n",
              options.run.name->c_str(), built.problem.images.size(),
              built.problem.num_points(), built.problem.observations.size(),
              context.num_threads);
  std::printf("%-18s %8s %6s %12s %8s %20s %12s\n", "solver", "seconds", "iter",
              "s/iter", "ratio", "final cost", "difference");
  Json json = {{"name", options.run.name},
               {"num_threads", context.num_threads},
               {"num_images", built.problem.images.size()},
               {"num_points", built.problem.num_points()},
               {"num_observations", built.problem.observations.size()},
               {"solvers", Json::object()}};
  Measurement native;
  for (const Contender& contender :
       MakeContenders(built.problem, options, context)) {
    const Measurement m =
        Measure(contender, options.max_num_iterations, built.state);
    if (contender.name == "native") native = m;
    json["solvers"][contender.name] = ToJson(m, native);
    PrintLine(contender.name, json["solvers"][contender.name]);
  }
  json["work"] =
      WorkToJson(built.problem, native.seconds_per_iteration, context);
  PrintWork(json["work"]);
  json["peak_memory_mib"] = PeakMemoryMib();
  if (!options.run.json_path->empty()) {
    WriteFile(*options.run.json_path, json.dump(2) + "\n");
  }
  return kExitSuccess;
}

SimulatedRunOptions& DriveOf(BenchmarkOptions& options) { return options.run; }

}  // namespace
}  // namespace mgsfm

int main(int argc, char** argv) {
  try {
    return mgsfm::RunOnDrive("solver_benchmark",
                             "Compares solvers of bundle adjustment.",
                             std::vector<std::string>(argv + 1, argv + argc),
                             mgsfm::DriveOf, mgsfm::RunBenchmark);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mgsfm_solver_benchmark: %s\n", error.what());
    return mgsfm::kExitBadInput;
  }
}
