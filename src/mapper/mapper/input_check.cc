// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/input_check.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "input_check/camera_checks.h"
#include "input_check/camera_motions.h"
#include "input_check/kept_matches.h"
#include "input_check/rig_checks.h"
#include "input_check/rig_samples.h"
#include "mapper/run_summary.h"
#include "mapper/weak_seams.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/view_graph_estimation.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

// One missing image in ten deserves a warning; docs/guides/warnings.md states
// the share. Half or twice as many change no verdict
// (docs/results/constants.md).
constexpr double kMinRegisteredShare = 0.9;
// A larger fraction of outliers is reported. Fewer priors do not determine a
// fraction.
constexpr double kMaxOutlierShare = 1.0 / 3.0;
constexpr int kMinNumPriors = 6;

void Append(std::vector<Finding> from, std::vector<Finding>* to) {
  to->insert(to->end(), std::make_move_iterator(from.begin()),
             std::make_move_iterator(from.end()));
}

std::string CountOf(size_t count, size_t total, const char* what) {
  return std::to_string(count) + " of " + std::to_string(total) + " " + what;
}

Finding MakeFinding(Cause cause,
                    std::vector<std::pair<std::string, double>> evidence,
                    std::string text, std::string remedy) {
  return {
      cause, {}, {}, std::move(evidence), std::move(text), std::move(remedy)};
}

// Several cameras in separate rigs: no frame has images of two of them.
std::vector<Finding> CheckSharedFrames(const Scene& scene) {
  std::vector<int> num_images(scene.sensors.size(), 0);
  for (const Image& image : scene.images) ++num_images[image.sensor_idx];
  Finding finding;
  for (const Rig& rig : scene.rigs) {
    if (rig.sensor_idxs.size() > 1) return {};
    const int sensor_idx = rig.ref_sensor_idx;
    // One or two images do not show whether a camera shares frames with others.
    if (num_images[sensor_idx] < 3) continue;
    finding.cameras.push_back(scene.sensors[sensor_idx].name);
  }
  if (finding.cameras.size() < 2) return {};
  finding.cause = Cause::kNoSharedFrames;
  finding.evidence = {
      {"num_cameras", static_cast<double>(finding.cameras.size())}};
  finding.text = std::to_string(finding.cameras.size()) +
                 " cameras share no frame, so that no rig is calibrated";
  finding.remedy =
      "if the cameras are mounted rigidly, give simultaneous images equal "
      "names, or set rig_name_rule";
  return {finding};
}

// The reason for most unregistered frames, or the problem of a sensor.
std::string LikelyCause(const Scene& scene, const MapperResult& result) {
  for (size_t k = 0; k < result.rotation.sensors.size(); ++k) {
    const SensorRotationSummary& sensor = result.rotation.sensors[k];
    if (sensor.is_observable) continue;
    return "the rotation of camera '" + scene.sensors[k].name +
           "' in its rig is unknown (" + sensor.message + ")";
  }
  std::map<std::string, size_t> num_frames;
  for (const UnregisteredFrame& frame : result.unregistered_frames) {
    ++num_frames[frame.reason];
  }
  const auto most = std::max_element(
      num_frames.begin(), num_frames.end(),
      [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most == num_frames.end()) return "their cameras have no pose in the rig";
  return "for " +
         CountOf(most->second, result.unregistered_frames.size(),
                 "missing frames, ") +
         most->first;
}

std::vector<Finding> CheckRegistration(const Scene& scene,
                                       const MapperResult& result) {
  const size_t num_registered = NumRegisteredImages(scene, result);
  const auto num_images = static_cast<double>(scene.images.size());
  if (static_cast<double>(num_registered) >= kMinRegisteredShare * num_images) {
    return {};
  }
  Finding finding;
  finding.cause =
      result.models.empty() ? Cause::kNoModel : Cause::kFewImagesRegistered;
  finding.evidence = {{"num_registered", static_cast<double>(num_registered)},
                      {"num_images", num_images}};
  finding.text = "only " +
                 CountOf(num_registered, scene.images.size(), "images") +
                 " are registered: " + LikelyCause(scene, result);
  finding.remedy =
      "match more image pairs, and check the grouping of images into rigs and "
      "the intrinsics";
  return {finding};
}

std::vector<Finding> CheckPositionPriors(const PositionPriors& priors,
                                         const MapperResult& result) {
  std::vector<Finding> findings;
  if (priors.num_null_fixes > 0) {
    findings.push_back(MakeFinding(
        Cause::kOutlierPositionPriors,
        {{"num_null_fixes", static_cast<double>(priors.num_null_fixes)}},
        std::to_string(priors.num_null_fixes) +
            " positions are latitude 0, longitude 0, which receivers write "
            "without a fix; they are ignored",
        "remove them, or give the correct positions"));
  }
  for (const MapperModel& model : result.models) {
    if (!model.position_priors) continue;
    const PositionPriorSummary& summary = *model.position_priors;
    const std::vector<std::pair<std::string, double>> evidence = {
        {"num_priors", static_cast<double>(summary.num_priors)},
        {"num_outliers", static_cast<double>(summary.outliers.size())}};
    const auto num_outliers = static_cast<double>(summary.outliers.size());
    if (!summary.is_registered) {
      findings.push_back(
          MakeFinding(Cause::kRejectedPositionPriors, evidence, summary.message,
                      "check the unit, the coordinate system and the "
                      "assignment of positions to images"));
    } else if (summary.num_priors >= kMinNumPriors &&
               num_outliers > kMaxOutlierShare * summary.num_priors) {
      findings.push_back(
          MakeFinding(Cause::kOutlierPositionPriors, evidence,
                      CountOf(summary.outliers.size(),
                              static_cast<size_t>(summary.num_priors),
                              "positions contradict the model"),
                      "check the positions and their standard deviations"));
    }
  }
  return findings;
}

// The logarithms of distances between positions relative to those in the model.
// Each position is compared with the position half of the list later.
std::vector<double> LogScales(const Scene& scene, const PositionPriors& priors,
                              const Reconstruction& model) {
  std::vector<Eigen::Vector3d> measured, estimated;
  for (size_t i = 0; i < priors.images.size(); ++i) {
    const auto cam_from_world = model.CamFromWorld(scene, static_cast<int>(i));
    if (!priors.images[i] || !cam_from_world) continue;
    measured.push_back(priors.images[i]->position);
    estimated.push_back(priors.images[i]->PointInWorld(*cam_from_world));
  }
  std::vector<double> log_scales;
  const size_t half = measured.size() / 2;
  for (size_t i = 0; i + half < measured.size(); ++i) {
    const double of_positions = (measured[i + half] - measured[i]).norm();
    const double of_model = (estimated[i + half] - estimated[i]).norm();
    if (of_positions > 0.0 && of_model > 0.0) {
      log_scales.push_back(std::log(of_positions / of_model));
    }
  }
  return log_scales;
}

std::string UnitRemedy(double scale) {
  const auto is_near = [scale](double expected) {
    // The known rig and the positions are each correct within some percent.
    return std::max(scale / expected, expected / scale) < 1.1;
  };
  if (is_near(1e-3)) return "give the rig in meters, not in millimeters";
  if (is_near(1e3)) return "give the positions in meters, not in millimeters";
  return "correct the baselines of the rig, or the unit of the positions";
}

// A model with a known rig keeps the unit of that rig. If positions have
// another unit, they cannot agree with it.
std::vector<Finding> CheckPositionUnit(const Scene& scene,
                                       const PositionPriors& priors,
                                       const MapperResult& result,
                                       double known_rig_sigma) {
  for (const MapperModel& model : result.models) {
    if (!model.IsAtPositions() || !model.translation.is_metric) continue;
    const std::vector<double> scales =
        LogScales(scene, model.PositionsOf(priors), model.reconstruction);
    if (scales.size() < static_cast<size_t>(kMinNumPriors)) continue;
    const double center = Median(scales);
    std::vector<double> deviations = Transformed(
        scales, [&](double scale) { return std::abs(scale - center); });
    // Distances that share positions are not independent: the uncertainty is
    // the deviation of a single distance, combined with that of the known rig.
    const double sigma =
        std::hypot(RobustSigma<1>(std::move(deviations)), known_rig_sigma);
    if (std::abs(center) <= kRareErrorInSigmas * sigma) continue;
    const std::string number = Formatted("%.3g", std::exp(center));
    return {MakeFinding(
        Cause::kPositionUnit,
        {{"scale", std::exp(center)}, {"relative_sigma", sigma}},
        "the unit of length according to the measured positions is " +
            std::string(number) + " times the unit of the known rig",
        UnitRemedy(std::exp(center)))};
  }
  return {};
}

std::vector<Finding> CheckGravityPriors(const MapperResult& result) {
  if (result.gravity_rejection) {
    return {MakeFinding(
        Cause::kRejectedGravityPriors, {}, *result.gravity_rejection,
        "check the axes of the directions: x right, y down, z forward in "
        "the camera frame")};
  }
  for (const MapperModel& model : result.models) {
    if (!model.gravity || model.gravity->num_priors < kMinNumPriors) continue;
    const size_t num_outliers = model.gravity->outliers.size();
    const int num_priors = model.gravity->num_priors;
    if (static_cast<double>(num_outliers) <= kMaxOutlierShare * num_priors) {
      continue;
    }
    return {MakeFinding(Cause::kOutlierGravityPriors,
                        {{"num_priors", num_priors},
                         {"num_outliers", static_cast<double>(num_outliers)}},
                        CountOf(num_outliers, static_cast<size_t>(num_priors),
                                "directions of gravity contradict the model"),
                        "check their axes and their assignment to images")};
  }
  return {};
}

bool Concerns(const Finding& finding, const std::vector<std::string>& cameras) {
  return AnyOf(cameras, [&](const auto& name) {
    return std::count(finding.cameras.begin(), finding.cameras.end(), name) > 0;
  });
}

// Keeps the first finding of each camera, and those with the same cause: images
// of a wrong size also disturb motions, and a lagging camera also rotates
// relative to its rig.
std::vector<Finding> WithoutSymptoms(const std::vector<Finding>& findings) {
  std::vector<Finding> causes;
  for (const Finding& finding : findings) {
    const bool is_explained = AnyOf(causes, [&](const Finding& f) {
      return f.cause != finding.cause && Concerns(f, finding.cameras);
    });
    if (!is_explained) causes.push_back(finding);
  }
  return causes;
}

// Per sensor: the matches with other sensors that the largest model explains.
std::vector<KeptCount> CountKeptBetweenSensors(
    const Scene& scene, const ViewGraph& verified,
    const std::vector<MapperModel>& models, double max_error_px,
    const Context& context) {
  if (models.empty()) return {};
  ViewGraph between;
  for (const ImagePair& pair : verified.pairs) {
    if (!IsOfOneSensor(scene, pair)) between.pairs.push_back(pair);
  }
  return CountKeptMatches(scene, between, models.front().reconstruction,
                          max_error_px, context)
      .sensors;
}

// Motions of cameras that contradict each other. Wrong intrinsics distort the
// rotations of pairs, so pairs are estimated again with the intrinsics of the
// largest model before a camera is reported.
std::vector<Finding> CheckMotionsTwice(
    const VerifiedPairs& pairs, const std::vector<SensorPairSamples>& samples,
    const MapperOptions& options, const Context& context,
    const std::vector<MapperModel>& models) {
  const Scene& scene = pairs.scene;
  const ViewGraph& verified = pairs.view_graph;
  if (models.empty()) return CheckMotions(scene, verified, samples, nullptr);
  const KeptMatches& kept = models.front().kept_matches;
  std::vector<Finding> findings = CheckMotions(scene, verified, samples, &kept);
  if (findings.empty()) return findings;
  Scene adjusted = scene;
  adjusted.cameras = models.front().reconstruction.cameras;
  const ViewGraph again =
      EstimateViewGraph(adjusted,
                        ComputeBearings(adjusted, context.num_threads),
                        pairs.matches(), options.view_graph, context)
          .estimate;
  return CheckMotions(adjusted, again, CollectRigSamples(adjusted, again),
                      &kept);
}

}  // namespace

void CheckInput(const VerifiedPairs& pairs, const MapperInput& input,
                const MapperOptions& options, const Context& context,
                MapperResult* result) {
  const Scene& scene = pairs.scene;
  const ViewGraph& verified = pairs.view_graph;
  for (MapperModel& model : result->models) {
    model.kept_matches =
        CountKeptMatches(scene, verified, model.reconstruction,
                         options.view_graph.max_error_px, context);
  }
  std::vector<Finding> findings;
  if (input.expects_rigs) findings = CheckSharedFrames(scene);
  std::vector<SensorPairSamples> samples = CollectRigSamples(scene, verified);
  std::vector<Finding> causes = CheckImageSizes(scene);
  Append(CheckMotionsTwice(pairs, samples, options, context, result->models),
         &causes);
  Append(FindSwappedCameras(scene, samples), &causes);
  if (causes.empty()) {  // otherwise pairs do not measure focal lengths
    causes = CheckTrustedFocalLengths(scene, pairs.matches(), context);
  }
  for (const MapperModel& model : result->models) {
    const bool is_late = model.delays && model.delays->AreCertain();
    if (is_late) Append(DescribeDelays(scene, *model.delays), &causes);
    RemoveMotions(scene, is_late ? model.delays->delayed : model.reconstruction,
                  &samples);
  }
  Append(FindRigMoves(scene, samples), &causes);
  const std::vector<KeptCount> kept_between =
      CountKeptBetweenSensors(scene, verified, result->models,
                              options.view_graph.max_error_px, context);
  Append(CheckKnownRotations(scene, samples, kept_between), &causes);
  causes = WithoutSymptoms(causes);
  for (size_t m = 0; m < result->models.size(); ++m) {
    const MapperModel& model = result->models[m];
    Append(DescribeRigDifferences(scene, m, model.reconstruction,
                                  model.rig_differences),
           &causes);
  }
  std::vector<Finding> of_unit =
      CheckPositionUnit(scene, input.position_priors, *result,
                        options.bundle_adjustment.sensor_from_rig_prior_sigma);
  Append(of_unit.empty() ? CheckPositionPriors(input.position_priors, *result)
                         : std::move(of_unit),
         &causes);
  Append(CheckGravityPriors(*result), &causes);
  for (const MapperModel& model : result->models) {
    if (!causes.empty()) break;
    Append(FindLostMatches(scene, model.kept_matches), &causes);
  }
  const bool has_causes = !causes.empty();
  Append(std::move(causes), &findings);
  for (const MapperModel& model : result->models) {
    if (has_causes) break;
    if (auto seams = DescribeSeams(scene, model.confidence)) {
      findings.push_back(std::move(*seams));
    }
  }
  Append(CheckRegistration(scene, *result), &findings);
  Append(std::move(findings), &result->findings);
}

void AddUncertainFocalLengths(const Scene& scene, double max_sigma,
                              MapperResult* result) {
  const double max_confirmed_change = 2.0 * max_sigma;
  std::vector<bool> is_named(scene.cameras.size(), false);
  for (const MapperModel& model : result->models) {
    for (const FocalLengthCheck& check : model.focal_lengths) {
      const bool is_confirmed =
          std::abs(std::log(check.estimated_px / check.prior_px)) <
              max_confirmed_change &&
          !IsAssumedFocalLength(scene.cameras[check.camera_idx],
                                check.prior_px);
      if (check.message.empty() || is_confirmed || is_named[check.camera_idx]) {
        continue;
      }
      is_named[check.camera_idx] = true;
      result->findings.push_back(
          {Cause::kUncertainFocalLength,
           SensorsOfCamera(scene, check.camera_idx),
           {},
           {{"prior_px", check.prior_px},
            {"estimated_px", check.estimated_px},
            {"relative_sigma", check.relative_sigma.value_or(0.0)}},
           check.message,
           "provide it if the model must be accurate"});
    }
  }
}

void LogFindings(const MapperResult& result, const Context& context) {
  // Further findings are in the report only.
  const size_t num_lines = std::min(size_t{5}, result.findings.size());
  for (size_t i = 0; i < num_lines; ++i) {
    const Finding& finding = result.findings[i];
    context.Warning(finding.text + "; " + finding.remedy);
  }
  if (result.findings.size() > num_lines) {
    context.Info(std::to_string(result.findings.size() - num_lines) +
                 " more warnings are in the report");
  }
}

}  // namespace mgsfm
