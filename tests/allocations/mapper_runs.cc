// SPDX-License-Identifier: BSD-3-Clause
#include "allocations/mapper_runs.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "allocations/result_bytes.h"
#include "bundle_adjustment/covariance_report.h"
#include "mapper/run_summary.h"
#include "mgsfm/base/error.h"
#include "mgsfm/mapper/report.h"
#include "mgsfm/simulator/simulation.h"
#include "support/partial_model.h"
#include "support/prior_measurement.h"

namespace mgsfm {
namespace {

SimulationOptions SmallDrive(RigPreset rig, int num_frames) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = num_frames;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 80;
  options.pixel_noise_px = 0.3;
  return options;
}

MapperRun RunOn(const std::string& name, const Simulation& simulation) {
  MapperRun run;
  run.name = name;
  run.input.scene = simulation.scene;
  run.input.view_graph = simulation.view_graph;
  return run;
}

MapperRun Defaults() {
  return RunOn("defaults", Simulate(SmallDrive(RigPreset::kStereo, 12)));
}

// Measured positions, wrong matches and pairs, and all results that
// are optional.
MapperRun AllResults() {
  SimulationOptions drive = SmallDrive(RigPreset::kStereo, 10);
  drive.num_points_per_frame = 30;
  drive.max_num_features_per_image = 50;
  drive.num_matched_frames = 2;
  drive.mismatch_ratio = 0.1;
  drive.wrong_pair_ratio = 0.05;
  drive.trigger_jitter_ms = 20.0;
  const Simulation simulation = Simulate(drive);
  MapperRun run = RunOn("all results", simulation);
  run.input.position_priors = MeasuredPositions(simulation, 0.05, 0.1);
  run.input.observer = [](const Reconstruction& /*model*/) {};
  run.options.compute_covariances = true;
  run.options.soft_rig.method = SoftRig::kSoft;
  return run;
}

MapperRun UnknownFocalLengths() {
  SimulationOptions drive = SmallDrive(RigPreset::kMono, 20);
  MapperRun run = RunOn("unknown focal lengths", Simulate(drive));
  for (Camera& camera : run.input.scene.cameras) {
    camera.has_prior_focal_length = false;
  }
  run.options.focal_lengths.max_sigma = 0.4;  // from few views
  return run;
}

// No matches between different cameras.
MapperRun SeparateCameras() {
  SimulationOptions drive = SmallDrive(RigPreset::kKitti360, 12);
  drive.match_different_sensors = false;
  drive.num_points_per_frame = 60;
  drive.max_num_features_per_image = 100;
  MapperRun run = RunOn("separate cameras", Simulate(drive));
  run.options.rotation_averaging.min_hand_eye_rotation_deg = 0.1;
  return run;
}

MapperRun TriggerDelays() {
  SimulationOptions drive = SmallDrive(RigPreset::kStereo, 10);
  drive.trigger_offset_ms = 20.0;
  const Simulation simulation = Simulate(drive);
  MapperRun run = RunOn("trigger delays", simulation);
  run.input.gravity_priors = MeasuredGravity(simulation, 0.5, 0.1);
  run.options.soft_rig.method = SoftRig::kTimeOffset;
  run.options.metric_scale = "known_baseline=cam0:cam1:0.54";
  return run;
}

// Hardly any match connects two stretches.
MapperRun WeakSeam() {
  SimulationOptions drive = SmallDrive(RigPreset::kStereo, 16);
  drive.num_points_per_frame = 100;
  drive.max_num_features_per_image = 150;
  Simulation simulation = Simulate(drive);
  const auto is_beyond = [&](int image_idx) {
    return simulation.scene.images[image_idx].frame_idx >= 7;
  };
  std::vector<ImagePair> pairs;
  int num_crossing = 0;
  for (ImagePair& pair : simulation.view_graph.pairs) {
    if (is_beyond(pair.image_idx1) != is_beyond(pair.image_idx2)) {
      if (num_crossing++ >= 2) continue;
      pair.matches.resize(std::min<size_t>(pair.matches.size(), 22));
    }
    pairs.push_back(std::move(pair));
  }
  simulation.view_graph.pairs = std::move(pairs);
  MapperRun run = RunOn("weak seam", simulation);
  run.options.weak_seams = WeakSeams::kSplit;
  run.options.confidence.min_num_ties = 2 * 22 + 1;
  return run;
}

MapperRun Extension() {
  const Simulation simulation = Simulate(SmallDrive(RigPreset::kStereo, 12));
  MapperRun run = RunOn("extension", simulation);
  run.input.existing_model =
      WithoutFrames(simulation.scene, simulation.ground_truth,
                    [](int frame_idx) { return frame_idx >= 8; });
  return run;
}

MapperRun Triangulation() {
  const Simulation simulation = Simulate(SmallDrive(RigPreset::kStereo, 8));
  MapperRun run = RunOn("triangulation", simulation);
  run.input.existing_model = simulation.ground_truth;
  run.options.bundle_adjustment.refine_rig_from_world = false;
  run.options.bundle_adjustment.refine_sensor_from_rig = RefineMode::kNo;
  run.only_triangulates = true;
  return run;
}

std::string Describe(const Scene& scene, const MapperResult& result) {
  StringSink sink;
  for (const std::string& line : DescribeRun(SummarizeRun(scene, result))) {
    WriteTo(&sink, line);
  }
  for (const Finding& finding : result.findings) WriteTo(&sink, finding.text);
  for (const UnregisteredFrame& frame : result.unregistered_frames) {
    WriteTo(&sink, frame.reason);
  }
  WriteTo(&sink, result.focal_lengths);
  WriteTo(&sink, result.view_graph);
  WriteTo(&sink, result.rotation);
  for (const MapperModel& model : result.models) {
    WriteTo(&sink, model.reconstruction);
    WriteTo(&sink, model.tracks);
    WriteTo(&sink, model.translation);
    WriteTo(&sink, model.bundle);
    WriteTo(&sink, model.gravity);
    WriteTo(&sink, model.confidence.of_frame);
    if (!model.confidence.of_frame.empty()) {
      WriteTo(&sink, FramesToCsv(scene, model));
    }
    if (model.covariances) {
      WriteTo(&sink, CovariancesToCsv(scene, *model.covariances));
    }
    if (model.soft_rig_images) {
      WriteTo(&sink, model.soft_rig_images->cam_from_world);
    }
  }
  return std::move(sink.content);
}

}  // namespace

std::vector<MapperRun> MapperRuns() {
  return {Defaults(),        AllResults(),    UnknownFocalLengths(),
          SeparateCameras(), TriggerDelays(), WeakSeam(),
          Extension(),       Triangulation()};
}

MapperResult Map(const MapperRun& run, int num_threads) {
  Context context;
  context.num_threads = num_threads;
  context.log = [](LogLevel /*level*/, const std::string& /*message*/) {};
  context.progress = [](const Progress& /*progress*/) {};
  context.is_canceled = [] { return false; };
  return run.only_triangulates
             ? TriangulatePoints(run.input, run.options, context)
             : RunMapper(run.input, run.options, context);
}

std::string ResultOf(const MapperRun& run, int num_threads) {
  return Describe(run.input.scene, Map(run, num_threads));
}

}  // namespace mgsfm
