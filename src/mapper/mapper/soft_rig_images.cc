// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/soft_rig_images.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "geometry/so3.h"
#include "input_check/rig_samples.h"
#include "mapper/candidates.h"
#include "mapper/stage.h"

namespace mgsfm {
namespace {

void LogSensor(const Scene& scene, const SoftRigSensor& sensor,
               const Context& context) {
  const std::string text = Formatted(
      "': deviations of images: rms %.4g deg and %.4g, max %.4g deg "
      "and %.4g%s; "
      "reprojection errors %.3f px, before %.3f px",
      RadToDeg(sensor.rms_rotation_rad), sensor.rms_position,
      RadToDeg(sensor.max_rotation_rad), sensor.max_position,
      sensor.is_rigid ? " (rigid)" : "", sensor.mean_error_after_px,
      sensor.mean_error_before_px);
  std::string line = "camera '" + scene.sensors[sensor.sensor_idx].name + text;
  if (sensor.time_offset_s) {
    line += Formatted("; time offset %.6f s +- %.6f s", *sensor.time_offset_s,
                      *sensor.time_offset_sigma_s);
  }
  context.Info(line);
  if (!sensor.message.empty()) {
    context.Warning("camera '" + scene.sensors[sensor.sensor_idx].name +
                    "': " + sensor.message);
  }
}

}  // namespace

FrameTimes TimesOfFrames(const Scene& scene) {
  const std::vector<int> rank = RankFrames(scene);
  FrameTimes times{{rank.begin(), rank.end()}, false};
  times.are_seconds =
      std::all_of(scene.images.begin(), scene.images.end(),
                  [](const Image& i) { return i.timestamp_s.has_value(); });
  for (size_t f = 0; f < rank.size() && times.are_seconds; ++f) {
    times.times[f] = TimeOfFrame(scene, static_cast<int>(f));
  }
  return times;
}

void EstimateSoftRigOfModel(const AdjustmentInput& input, BundlePriors priors,
                            const MapperOptions& options,
                            const Context& context, MapperModel* model) {
  const Scene& scene = input.scene;
  const RunningStage stage("soft rig", context);
  const Scene separate = SeparateImages(scene);
  priors.calibration.sensors.clear();  // each image is a sensor
  SoftRigResult result = EstimateSoftRig(
      {scene, separate,
       MakeCandidateSource(separate, input.view_graph, input.matches,
                           input.pair_is_used, options, context),
       model->reconstruction, priors},
      options.soft_rig, options.bundle_adjustment, context);
  const SoftRigSummary& summary = result.images.summary;
  for (const SoftRigSensor& sensor : summary.sensors) {
    LogSensor(scene, sensor, context);
  }
  if (!summary.is_usable) {
    context.Warning("images keep the poses of their rig: " + summary.message);
  } else if (!summary.has_converged) {
    context.Warning(
        "the deviations of images from their rig have not converged; increase "
        "SoftRig.max_num_rounds");
  }
  model->reconstruction = std::move(result.estimate);
  model->soft_rig_images = std::move(result.images);
  stage.Finish(&model->times);
}

}  // namespace mgsfm
