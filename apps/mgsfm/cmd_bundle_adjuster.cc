// SPDX-License-Identifier: BSD-3-Clause
#include <numeric>
#include <string>
#include <vector>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/ranges.h"
#include "bundle_adjustment/covariance_report.h"
#include "command.h"
#include "commands.h"
#include "files/file_operations.h"
#include "files/staged_output.h"
#include "math/statistics.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/model_scene.h"
#include "model_file.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

struct BundleAdjusterOptions {
  Option<std::string> input_path{
      "input_path", "", Required(),
      "Adjust the model in this folder, with or without rigs and frames. "
      "Intrinsics are fixed unless refine_focal_length or refine_extra_params "
      "is yes; rig extrinsics are fixed if --rig_config_path gives them."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write the adjusted model into this folder. An earlier model is replaced "
      "when the new one is complete; other files stay. May be the input."};
  Option<ModelFormat> output_format = ModelFormatOption();
  Option<bool> retriangulate{
      "retriangulate", false,
      "Reject outliers and retriangulate all points in rounds, as the mapper "
      "does. 0: solve once over all observations."};
  Option<bool> compute_covariances{
      "compute_covariances", false,
      "Write the covariances of rig extrinsics and frame poses to "
      "covariances.csv beside the model."};
  Option<bool> refine_points{"refine_points", true, "Refine 3D points."};
  SceneLoadingOptions loading;
  BundleAdjustmentOptions bundle_adjustment;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, output_format, retriangulate,
          compute_covariances, loading);
    visit.Group("BundleAdjustment", bundle_adjustment);
    visit.Group("BundleAdjustment", refine_points);
  }
};

// Statistics of all observations whose points project into the images.
struct ReprojectionErrors {
  size_t num_observations = 0;
  double mean_px = 0.0;
  double median_px = 0.0;
};

ReprojectionErrors ComputeErrors(const Scene& scene,
                                 const Reconstruction& model) {
  std::vector<double> errors_px;
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      const auto residual_px =
          ResidualPx(scene, model, o, point.point_in_world);
      if (residual_px) errors_px.push_back(residual_px->norm());
    }
  }
  ReprojectionErrors errors;
  errors.num_observations = errors_px.size();
  if (errors_px.empty()) return errors;
  errors.mean_px = std::accumulate(errors_px.begin(), errors_px.end(), 0.0) /
                   static_cast<double>(errors_px.size());
  errors.median_px = Median(std::move(errors_px));
  return errors;
}

// The reason why nothing can be adjusted; empty if something can be.
std::string WhyNotAdjustable(const ModelScene& input,
                             const BundleAdjustmentOptions& options) {
  const Scene& scene = input.scene;
  const auto& points = input.reconstruction.points;
  if (NoneOf(points,
             [](const Point3D& point) { return point.track.size() >= 2; })) {
    return "no point is observed in two images";
  }
  // Intrinsics of a model count as known (MakeModelScene).
  const bool refines_cameras =
      options.refine_focal_length == RefineMode::kYes ||
      options.refine_extra_params == RefineMode::kYes ||
      options.refine_principal_point == RefineMode::kYes;
  bool refines_sensors = false;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    refines_sensors |= !scene.IsReference(static_cast<int>(i)) &&
                       (options.refine_sensor_from_rig == RefineMode::kYes ||
                        (options.refine_sensor_from_rig == RefineMode::kAuto &&
                         !scene.sensors[i].sensor_from_rig));
  }
  if (options.refine_rig_from_world || options.refine_points ||
      refines_sensors || refines_cameras) {
    return "";
  }
  return "the options fix all parameters";
}

BundleResult Adjust(const ModelScene& input,
                    const BundleAdjusterOptions& options,
                    const Context& context) {
  if (!options.retriangulate) {
    return AdjustBundle(input.scene, input.reconstruction,
                        options.bundle_adjustment, context);
  }
  return RefineReconstruction(
      input.scene, FixedCandidates(GroupTracks(input.reconstruction.points)),
      input.reconstruction, options.bundle_adjustment, context);
}

std::string Describe(const ModelScene& input, const BundleResult& result) {
  const Reconstruction& before = input.reconstruction;
  const Reconstruction& after = result.estimate;
  const auto errors_before = ComputeErrors(input.scene, before);
  const auto errors_after = ComputeErrors(input.scene, after);
  const std::vector<SolveSummary>& solves = result.summary.solves;
  int num_iterations = 0;
  for (const SolveSummary& solve : solves) {
    num_iterations += solve.num_iterations;
  }
  std::string text;
  const auto add_row = [&](const char* format, auto... values) {
    text += Formatted(format, values...);
  };
  add_row("%-22s %14s %14s\n", "", "before", "after");
  add_row("%-22s %14.6g %14.6g\n", "cost", solves.front().initial_cost,
          solves.back().final_cost);
  add_row("%-22s %11.4f px %11.4f px\n", "reprojection, mean",
          errors_before.mean_px, errors_after.mean_px);
  add_row("%-22s %11.4f px %11.4f px\n", "reprojection, median",
          errors_before.median_px, errors_after.median_px);
  add_row("%-22s %14zu %14zu\n", "observations", errors_before.num_observations,
          errors_after.num_observations);
  add_row("%-22s %14zu %14zu\n", "points", before.points.size(),
          after.points.size());
  add_row("%-22s %14d in %zu solve%s, ", "iterations", num_iterations,
          solves.size(), solves.size() == 1 ? "" : "s");
  return text.append(EnumName(solves.back().termination)) + "\n";
}

void LogInput(const ModelScene& input, const Context& context) {
  const Scene& scene = input.scene;
  context.Info(Formatted(
      "rigs from %s: %zu rigs, %zu frames, %zu images, %zu points",
      input.rig_source.c_str(), scene.rigs.size(), scene.frames.size(),
      scene.images.size(), input.reconstruction.points.size()));
}

void WarnOfLosses(const ModelScene& input, const BundleSummary& summary,
                  const Context& context) {
  GroupedWarnings warnings;
  for (const DroppedFrame& dropped : summary.dropped_frames) {
    warnings.Add("frame '" + input.scene.frames[dropped.frame_idx].name +
                 "' is dropped: " + dropped.reason);
  }
  warnings.Log(context);
  if (summary.num_invisible_observations > 0) {
    context.Warning(
        Formatted("%zu observations are ignored, as their points do not "
                  "project into the images",
                  summary.num_invisible_observations));
  }
}

void WriteCovariances(const ModelScene& input, const Reconstruction& model,
                      const BundleAdjusterOptions& options,
                      const Context& context, const StagedOutput& output) {
  const CovarianceResult covariances = ComputeCovariances(
      input.scene, model, options.bundle_adjustment, context);
  if (!covariances.is_usable) {
    context.Warning("the covariances cannot be computed");
    return;
  }
  const std::string message =
      DescribeUnobservable(input.scene, model, covariances);
  if (!message.empty()) context.Warning(message);
  WriteFile(output.StagingDir() / "covariances.csv",
            CovariancesToCsv(input.scene, covariances));
}

void WriteResult(const ModelScene& input, const Reconstruction& model,
                 const BundleAdjusterOptions& options, const Context& context,
                 StagedOutput* output) {
  WriteModelAndRig(output->StagingDir(), input.scene, model,
                   options.output_format, context);
  if (options.compute_covariances) {
    WriteCovariances(input, model, options, context, *output);
  }
  context.CheckInterrupted();
  output->Commit();
}

CommandResult RunBundleAdjuster(const BundleAdjusterOptions& given,
                                const Context& context) {
  BundleAdjusterOptions options = given;
  options.bundle_adjustment.refine_points = options.refine_points;
  const auto give_up = [&](const std::string& reason) -> CommandResult {
    context.log(LogLevel::kError, "nothing was adjusted: " + reason);
    return kExitNotSolvable;
  };
  StagedOutput output(*options.output_path, OutputKind::kModel);
  const ModelScene input =
      LoadModelScene(*options.input_path, options.loading, context);
  CheckFormat(input.scene, options.output_format);
  LogInput(input, context);
  const std::string reason = WhyNotAdjustable(input, options.bundle_adjustment);
  if (!reason.empty()) return give_up(reason);

  const BundleResult result = Adjust(input, options, context);
  const SolveSummary& last = result.summary.solves.back();
  if (!last.IsUsable()) return give_up("the solve failed, " + last.message);
  if (result.estimate.points.empty()) return give_up("all points are outliers");
  WarnOfLosses(input, result.summary, context);
  GroupedWarnings warnings;
  for (const FocalLengthCheck& check : CheckFocalLengths(
           input.scene, result.estimate, options.bundle_adjustment, context)) {
    if (check.message.empty()) continue;
    warnings.Add(check.message + "; provide a prior focal length");
  }
  warnings.Log(context);
  WriteResult(input, result.estimate, options, context, &output);
  CommandResult done(kExitSuccess, Describe(input, result));
  done.has_files = true;
  return done;
}

}  // namespace

Command BundleAdjusterCommand() {
  return MakeCommand("bundle_adjuster",
                     "Refines a model: frame poses, rig extrinsics, points.",
                     RunBundleAdjuster);
}

}  // namespace mgsfm
