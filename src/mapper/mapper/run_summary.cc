// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/run_summary.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/covariance_report.h"
#include "geometry/so3.h"
#include "input_check/kept_matches.h"
#include "mgsfm/base/mask.h"
#include "scene/observations.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

// The report lists further lenses.
constexpr size_t kMaxNumLenses = 6;

std::string Count(size_t count, const char* one, const char* many) {
  return std::to_string(count) + " " + (count == 1 ? one : many);
}

// How precisely the known lengths of the rig determine the unit. The additional
// information of positions is ignored.
std::string MetricWithin(const MapperModel& model) {
  if (model.IsAtPositions() || !model.delays || !model.delays->unit) {
    return "metric";
  }
  const UnitError& unit = *model.delays->unit;
  std::string text = Formatted("metric within %.2g %%",
                               100.0 * std::expm1(unit.RelativeSigma()));
  if (unit.is_certain) {
    text += Formatted(" (the residuals suggest lengths %.3f times as long)",
                      std::exp(unit.log_factor));
  }
  return text;
}

std::string UnitOfLength(const Scene& scene, const MapperResult& result,
                         const MapperModel& model) {
  // Registration to positions keeps the unit of a known rig.
  if (model.translation.is_metric) {
    return (WhyRigsAreNotMetric(scene) ? "no meter" : MetricWithin(model)) +
           ", that of the known rig";
  }
  if (model.IsAtPositions()) {
    return "metric, that of the measured positions";
  }
  if (model.meters_per_unit) {
    return MetricWithin(model) + ", by the known baseline";
  }
  if (model.extension) return "that of the extended model";
  for (size_t m = 0; model.has_shared_unit && m < result.models.size(); ++m) {
    const MapperModel& first = result.models[m];
    if (&first == &model) break;
    if (!first.has_shared_unit) continue;
    const bool is_metric =
        UnitOfLength(scene, result, first).compare(0, 6, "metric") == 0;
    return (is_metric ? "metric, that of model " : "that of model ") +
           std::to_string(m) + ", by the baselines of their rig";
  }
  return "arbitrary scale; to define it, set metric_scale, use_prior_position, "
         "or known poses of cameras (rig_config_path, calibration_path)";
}

bool IsCalibrated(const Scene& scene, const Reconstruction& model, size_t k) {
  return !scene.sensors[k].sensor_from_rig && model.sensor_from_rig[k];
}

LensValue LensOf(const Scene& scene, const MapperResult& result,
                 const MapperModel& model, int camera_idx) {
  const Camera& before = scene.cameras[camera_idx];
  const Camera& camera = model.reconstruction.cameras[camera_idx];
  const auto focal_length = [](const Camera& c) {
    const auto& idxs = InfoOf(c.model).focal_length_idxs;
    return idxs.empty() ? 0.0 : c.params[idxs.front()];
  };
  LensValue lens;
  lens.camera_idx = camera_idx;
  lens.label = CameraLabel(scene, camera_idx);
  lens.model = camera.model;
  lens.prior_px = focal_length(before);
  lens.focal_length_px = focal_length(camera);
  if (!before.has_prior_focal_length) {
    lens.source = LensSource::kGuess;
    lens.message = "it was guessed and is not refined";
  }
  if (result.lenses) {
    for (const LensChoice& choice : result.lenses->lenses) {
      if (choice.camera_idx == camera_idx) lens.source = choice.start;
    }
  }
  for (const FocalLengthCheck& check : model.focal_lengths) {
    if (check.camera_idx != camera_idx) continue;
    lens.relative_sigma = check.relative_sigma;
    lens.message = check.message;
    if (check.message.empty()) lens.source = LensSource::kAdjustment;
  }
  return lens;
}

std::vector<LensValue> LensesOf(const Scene& scene, const MapperResult& result,
                                const MapperModel& model) {
  Mask is_used(scene.cameras.size(), false);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (model.reconstruction.IsRegistered(scene, static_cast<int>(i))) {
      is_used[scene.images[i].camera_idx] = true;
    }
  }
  std::vector<LensValue> lenses;
  for (size_t i = 0; i < is_used.size(); ++i) {
    if (is_used[i]) {
      lenses.push_back(LensOf(scene, result, model, static_cast<int>(i)));
    }
  }
  return lenses;
}

std::vector<SensorAccuracy> Accuracies(const Scene& scene,
                                       const MapperModel& model) {
  std::vector<SensorAccuracy> accuracies;
  if (!model.covariances || !model.covariances->is_usable) return accuracies;
  for (size_t k = 0; k < scene.sensors.size(); ++k) {
    const auto& covariance = model.covariances->sensors[k];
    if (!covariance || !IsCalibrated(scene, model.reconstruction, k)) continue;
    const auto variances = covariance->diagonal();
    accuracies.push_back(
        {scene.sensors[k].name,
         RadToDeg(std::sqrt(variances.head<3>().maxCoeff())),
         std::sqrt(variances.tail<3>().maxCoeff()),
         IsPlaceDetermined(model.reconstruction, *model.covariances,
                           static_cast<int>(k))});
  }
  return accuracies;
}

void CountObservations(const Scene& scene, const Reconstruction& model,
                       ModelSummary* summary) {
  std::vector<size_t> of_image(scene.images.size(), 0);
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) ++of_image[o.image_idx];
  }
  std::vector<size_t> of_sensor(scene.sensors.size(), 0);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    of_sensor[scene.images[i].sensor_idx] += of_image[i];
    summary->num_observations += of_image[i];
    summary->num_images_without_points +=
        of_image[i] == 0 && model.IsRegistered(scene, static_cast<int>(i));
  }
  for (size_t k = 0; k < scene.sensors.size(); ++k) {
    if (!IsCalibrated(scene, model, k)) continue;
    if (summary->num_calibrated_sensors == 0 ||
        of_sensor[k] < summary->min_num_sensor_observations) {
      summary->weakest_sensor = scene.sensors[k].name;
      summary->min_num_sensor_observations = of_sensor[k];
    }
    ++summary->num_calibrated_sensors;
  }
}

ModelSummary SummarizeModel(const Scene& scene, const MapperResult& result,
                            const MapperModel& model) {
  const Reconstruction& reconstruction = model.reconstruction;
  ModelSummary summary;
  for (const auto& pose : reconstruction.rig_from_world) {
    summary.num_frames += pose.has_value();
  }
  summary.num_images = reconstruction.NumRegisteredImages(scene);
  summary.num_points = reconstruction.points.size();
  summary.mean_reprojection_error_px = MeanReprojectionErrorPx(reconstruction);
  CountObservations(scene, reconstruction, &summary);
  if (model.kept_matches.total.num_matches > 0) {
    summary.kept_share = model.kept_matches.total.Share();
  }
  if (!model.bundle.rounds.empty()) {
    summary.share_at_rest = ShareAtRest(
        scene, reconstruction, model.bundle.rounds.back().max_error_px);
  }
  summary.unit_of_length = UnitOfLength(scene, result, model);
  summary.lenses = LensesOf(scene, result, model);
  summary.accuracies = Accuracies(scene, model);
  return summary;
}

// The estimated lenses; empty if none were estimated.
std::string DescribeLenses(const ModelSummary& model) {
  std::vector<LensValue> lenses;
  for (const LensValue& lens : model.lenses) {
    if (lens.source != LensSource::kGiven) lenses.push_back(lens);
  }
  if (lenses.empty()) return "";
  const auto first_known = std::stable_partition(
      lenses.begin(), lenses.end(),
      [](const LensValue& lens) { return lens.IsGuess(); });
  const auto num_guesses = static_cast<size_t>(first_known - lenses.begin());
  std::string line =
      num_guesses == 0
          ? "lenses: estimated"
          : "lenses: " +
                Count(num_guesses, "focal length is", "focal lengths are") +
                " a guess that the images do not determine";
  for (size_t i = 0; i < std::min(lenses.size(), kMaxNumLenses); ++i) {
    const LensValue& lens = lenses[i];
    line += (i == 0 ? ": " : ", ") + lens.label + " " +
            Formatted("%.1f px", lens.focal_length_px);
    if (lens.relative_sigma) {
      line += Formatted(" +- %.2g %%", 100.0 * *lens.relative_sigma);
    }
    if (lens.IsGuess()) {
      line += " (start: " + std::string(EnumName(lens.source)) + ")";
    }
  }
  return line + (lenses.size() > kMaxNumLenses ? ", ..." : "");
}

std::string DescribeRig(const ModelSummary& model) {
  if (model.num_calibrated_sensors == 0) return "";
  std::string line =
      "rig: " +
      Count(static_cast<size_t>(model.num_calibrated_sensors), "camera pose",
            "camera poses") +
      " calibrated, that of '" + model.weakest_sensor + "' by " +
      Count(model.min_num_sensor_observations, "observation", "observations") +
      (model.num_calibrated_sensors > 1 ? ", the fewest" : "");
  if (model.accuracies.empty()) {
    return line + "; compute_covariances tells how accurately";
  }
  for (const SensorAccuracy& sensor : model.accuracies) {
    line += ", '" + sensor.name + "' within " +
            Formatted("%.2g", sensor.sigma_rotation_deg) + " deg" +
            (sensor.place_is_determined
                 ? " and " + Formatted("%.2g", sensor.sigma_translation)
                 : ", its place not determined");
  }
  return line + " (one standard deviation)";
}

}  // namespace

size_t NumRegisteredImages(const Scene& scene, const MapperResult& result) {
  size_t count = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    count += AnyOf(result.models, [&](const MapperModel& model) {
      return model.reconstruction.IsRegistered(scene, static_cast<int>(i));
    });
  }
  return count;
}

RunSummary SummarizeRun(const Scene& scene, const MapperResult& result) {
  RunSummary summary;
  summary.num_images = scene.images.size();
  summary.num_registered_images = NumRegisteredImages(scene, result);
  std::map<std::string, size_t> num_frames;
  for (const UnregisteredFrame& frame : result.unregistered_frames) {
    ++num_frames[frame.reason];
  }
  for (const auto& [reason, number] : num_frames) {
    summary.missing_frames.push_back({number, reason});
  }
  StableSortDescendingBy(&summary.missing_frames,
                         [](const auto& a) { return a.num_frames; });
  for (const MapperModel& model : result.models) {
    summary.models.push_back(SummarizeModel(scene, result, model));
  }
  return summary;
}

std::vector<std::string> DescribeRun(const RunSummary& summary) {
  std::vector<std::string> lines = {
      "images: " + std::to_string(summary.num_registered_images) + " of " +
      std::to_string(summary.num_images) + " registered, in " +
      Count(summary.models.size(), "model", "models")};
  // The report lists further reasons and models.
  for (size_t i = 0; i < summary.missing_frames.size() && i < 2; ++i) {
    const auto& [count, reason] = summary.missing_frames[i];
    lines.push_back("missing: " + Count(count, "frame", "frames") + ", " +
                    reason);
  }
  for (size_t i = 0; i < summary.models.size() && i < 3; ++i) {
    const ModelSummary& model = summary.models[i];
    std::string line =
        "model " + std::to_string(i) + ": " +
        Count(static_cast<size_t>(model.num_images), "image", "images") + ", " +
        Count(model.num_points, "point", "points");
    if (model.mean_reprojection_error_px) {
      line += ", mean reprojection error " +
              Formatted("%.2f", *model.mean_reprojection_error_px) + " px";
    }
    if (model.num_images_without_points > 0) {
      line += "; " + std::to_string(model.num_images_without_points) +
              " of the images have no points and follow from their rig";
    }
    lines.push_back(line);
    if (IsAtRest(model.share_at_rest)) {
      lines.push_back(Formatted(
          "motion: the rig stands still; %.0f %% of the observations lie where "
          "the first image of the same camera shows the point. If the rig "
          "moved, mask what moves along with it (camera_mask_path), and take "
          "images at shorter intervals",
          100.0 * model.share_at_rest));
    }
    for (std::string text : {DescribeLenses(model), DescribeRig(model)}) {
      if (!text.empty()) lines.push_back(std::move(text));
    }
    lines.push_back("unit of length: " + model.unit_of_length);
  }
  return lines;
}

}  // namespace mgsfm
