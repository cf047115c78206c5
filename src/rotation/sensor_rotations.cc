// SPDX-License-Identifier: BSD-3-Clause
#include "rotation/sensor_rotations.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <utility>

#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "rotation/geodesic_median.h"
#include "rotation/hand_eye.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// Turns beyond this are left out of hand-eye calibration: their logarithms are
// too close to the jump at 180 deg.
constexpr double kMaxTurnRad = DegToRad(150.0);
// Of longer sequences so many frames are taken, evenly spread.
constexpr size_t kMaxNumHandEyeFrames = 64;

std::string Format(const char* format, double a, double b) {
  char text[200];
  std::snprintf(text, sizeof(text), format, a, b);
  return text;
}

// A frame in which the sensor in question and the rig have a rotation each, in
// two parts.
struct HandEyeFrame {
  Quaterniond sensor_from_world1;
  Quaterniond rig_from_world2;
};

std::vector<HandEyeFrame> Thin(const std::vector<HandEyeFrame>& frames) {
  if (frames.size() <= kMaxNumHandEyeFrames) return frames;
  std::vector<HandEyeFrame> thinned;
  for (size_t i = 0; i < kMaxNumHandEyeFrames; ++i) {
    thinned.push_back(frames[i * frames.size() / kMaxNumHandEyeFrames]);
  }
  return thinned;
}

void AddMotions(const std::vector<HandEyeFrame>& frames,
                std::vector<MotionPair>* motions) {
  for (size_t i = 0; i < frames.size(); ++i) {
    for (size_t j = i + 1; j < frames.size(); ++j) {
      const MotionPair motion{LogSO3(frames[j].sensor_from_world1 *
                                     frames[i].sensor_from_world1.conjugate()),
                              LogSO3(frames[j].rig_from_world2 *
                                     frames[i].rig_from_world2.conjugate())};
      if (motion.alpha.norm() <= kMaxTurnRad &&
          motion.beta.norm() <= kMaxTurnRad) {
        motions->push_back(motion);
      }
    }
  }
}

class InternalRotationEstimator {
 public:
  InternalRotationEstimator(const Scene& scene, const ImageRotations& images,
                            const RotationAveragingOptions& options)
      : scene_(scene),
        images_(images),
        options_(options),
        rank_(scene.sensors.size(), -1),
        samples_disagree_(scene.sensors.size(), 0) {}

  SensorRotations Run() {
    SetKnownSensors();
    while (DetermineBySamples() || DetermineByHandEye()) {
    }
    return std::move(result_);
  }

 private:
  struct Samples {
    std::vector<Quaterniond> rotations;
    std::vector<double> weights;
  };

  struct Motions {
    std::vector<MotionPair> pairs;
    int num_frames = 0;
  };

  bool IsDetermined(int sensor_idx) const { return rank_[sensor_idx] >= 0; }
  void SetKnownSensors();
  void SetDetermined(int sensor_idx, const Quaterniond& sensor_from_rig);
  bool DetermineBySamples();
  bool DetermineByHandEye();
  Samples CollectSamples(int sensor_idx) const;
  bool TakeMedian(int sensor_idx, const Samples& samples);
  Motions CollectMotions(int sensor_idx) const;
  bool TakeHandEye(int sensor_idx);
  int FindDeterminedImage(const Frame& frame, std::optional<int> part) const;
  int ImageOf(const Frame& frame, int sensor_idx) const;

  const Scene& scene_;
  const ImageRotations& images_;
  const RotationAveragingOptions& options_;
  // Per sensor: the how manieth to be determined it was; -1: it is not.
  std::vector<int> rank_;
  int num_determined_ = 0;
  Mask samples_disagree_;
  SensorRotations result_;
};

void InternalRotationEstimator::SetDetermined(
    int sensor_idx, const Quaterniond& sensor_from_rig) {
  rank_[sensor_idx] = num_determined_++;
  result_.sensor_from_rig[sensor_idx] = sensor_from_rig;
  result_.summaries[sensor_idx].is_observable = true;
}

// Reference sensors come first, so that samples prefer them.
void InternalRotationEstimator::SetKnownSensors() {
  const int num_sensors = static_cast<int>(scene_.sensors.size());
  result_.sensor_from_rig.resize(num_sensors);
  result_.summaries.resize(num_sensors);
  for (const bool is_reference : {true, false}) {
    for (int k = 0; k < num_sensors; ++k) {
      const auto& sensor_from_rig = scene_.sensors[k].sensor_from_rig;
      if (!sensor_from_rig || scene_.IsReference(k) != is_reference) continue;
      SetDetermined(k, ToUnitQuaternion(sensor_from_rig->rotation));
      result_.summaries[k].message =
          is_reference ? "reference sensor" : "known beforehand";
    }
  }
}

// The image of a sensor with a rotation, or -1.
int InternalRotationEstimator::ImageOf(const Frame& frame,
                                       int sensor_idx) const {
  for (const int image_idx : frame.image_idxs) {
    if (scene_.images[image_idx].sensor_idx == sensor_idx &&
        images_.cam_from_world[image_idx]) {
      return image_idx;
    }
  }
  return -1;
}

// Of the frame's images with rotation (in the part, if one is given) that of
// the sensor that was determined first, or -1.
int InternalRotationEstimator::FindDeterminedImage(
    const Frame& frame, std::optional<int> part) const {
  int best = -1;
  for (const int image_idx : frame.image_idxs) {
    const int rank = rank_[scene_.images[image_idx].sensor_idx];
    if (rank < 0 || !images_.cam_from_world[image_idx]) continue;
    if (part && images_.component[image_idx] != *part) continue;
    if (best < 0 || rank < rank_[scene_.images[best].sensor_idx]) {
      best = image_idx;
    }
  }
  return best;
}

InternalRotationEstimator::Samples InternalRotationEstimator::CollectSamples(
    int sensor_idx) const {
  Samples samples;
  for (const Frame& frame : scene_.frames) {
    if (frame.rig_idx != scene_.sensors[sensor_idx].rig_idx) continue;
    const int k = ImageOf(frame, sensor_idx);
    if (k < 0) continue;
    const int a = FindDeterminedImage(frame, images_.component[k]);
    if (a < 0) continue;
    samples.rotations.push_back(
        *images_.cam_from_world[k] * images_.cam_from_world[a]->conjugate() *
        *result_.sensor_from_rig[scene_.images[a].sensor_idx]);
    samples.weights.push_back(
        std::max(1.0, std::min(images_.support[k], images_.support[a])));
  }
  return samples;
}

bool InternalRotationEstimator::DetermineBySamples() {
  while (true) {
    int best = -1;
    Samples best_samples;
    for (size_t k = 0; k < scene_.sensors.size(); ++k) {
      const int sensor_idx = static_cast<int>(k);
      if (IsDetermined(sensor_idx) || samples_disagree_[k]) continue;
      Samples samples = CollectSamples(sensor_idx);
      if (samples.rotations.size() > best_samples.rotations.size()) {
        best = sensor_idx;
        best_samples = std::move(samples);
      }
    }
    if (best < 0) return false;
    if (TakeMedian(best, best_samples)) return true;
    samples_disagree_[best] = 1;
  }
}

bool InternalRotationEstimator::TakeMedian(int sensor_idx,
                                           const Samples& samples) {
  const GeodesicMedian median = FindGeodesicMedian(
      samples.rotations, samples.weights, DegToRad(options_.max_error_deg));
  SensorRotationSummary& summary = result_.summaries[sensor_idx];
  const double deviation_deg = RadToDeg(median.median_deviation_rad);
  summary.num_samples = static_cast<int>(samples.rotations.size());
  summary.median_deviation_deg = deviation_deg;
  if (!median.summary.IsUsable() || deviation_deg > options_.max_error_deg) {
    summary.message =
        Format("samples disagree: %.3g deg median deviation in %.0f frames",
               deviation_deg, summary.num_samples);
    return false;
  }
  SetDetermined(sensor_idx, median.rotation);
  summary.message = Format("median of %.0f frames, %.3g deg median deviation",
                           summary.num_samples, deviation_deg);
  return true;
}

bool InternalRotationEstimator::DetermineByHandEye() {
  for (size_t k = 0; k < scene_.sensors.size(); ++k) {
    const int sensor_idx = static_cast<int>(k);
    if (!IsDetermined(sensor_idx) && TakeHandEye(sensor_idx)) return true;
  }
  return false;
}

// The motions of all pairs of frames that have the sensor in one part and the
// rest of the rig in one part; and the number of these frames.
InternalRotationEstimator::Motions InternalRotationEstimator::CollectMotions(
    int sensor_idx) const {
  std::map<std::pair<int, int>, std::vector<HandEyeFrame>> frames_of_parts;
  for (const Frame& frame : scene_.frames) {
    if (frame.rig_idx != scene_.sensors[sensor_idx].rig_idx) continue;
    const int k = ImageOf(frame, sensor_idx);
    const int a = FindDeterminedImage(frame, std::nullopt);
    if (k < 0 || a < 0) continue;
    const Quaterniond& S_a =
        *result_.sensor_from_rig[scene_.images[a].sensor_idx];
    frames_of_parts[{images_.component[k], images_.component[a]}].push_back(
        {*images_.cam_from_world[k],
         S_a.conjugate() * *images_.cam_from_world[a]});
  }
  Motions motions;
  for (const auto& [parts, frames] : frames_of_parts) {
    if (frames.size() < 2) continue;
    motions.num_frames += static_cast<int>(frames.size());
    AddMotions(Thin(frames), &motions.pairs);
  }
  return motions;
}

bool InternalRotationEstimator::TakeHandEye(int sensor_idx) {
  SensorRotationSummary& summary = result_.summaries[sensor_idx];
  const std::string prefix =
      samples_disagree_[sensor_idx] ? summary.message + "; " : "";
  const Motions motions = CollectMotions(sensor_idx);
  if (motions.pairs.empty()) {
    summary.message = prefix +
                      "not observable: no frame has this sensor and another "
                      "one of its rig with rotations";
    return false;
  }
  const HandEyeResult hand_eye =
      CalibrateHandEye(motions.pairs, motions.num_frames);
  const double second_axis_deg = RadToDeg(hand_eye.second_axis_rms_rad);
  const double error_deg = RadToDeg(hand_eye.median_error_rad);
  if (second_axis_deg < options_.min_hand_eye_rotation_deg ||
      error_deg > options_.max_error_deg ||
      RadToDeg(hand_eye.uncertainty_rad) > 0.2 * options_.max_error_deg) {
    summary.message =
        prefix +
        Format(
            "not observable: no pairs connect it with the other sensors, and "
            "it turned only %.3g deg about a second axis (errors %.3g deg)",
            second_axis_deg, error_deg);
    return false;
  }
  summary.num_samples = motions.num_frames;
  summary.median_deviation_deg = error_deg;
  summary.message =
      prefix + Format(
                   "hand-eye calibration with turns of %.3g deg about a "
                   "second axis, %.3g deg median error",
                   second_axis_deg, error_deg);
  SetDetermined(sensor_idx, hand_eye.a_from_b);
  return true;
}

}  // namespace

SensorRotations EstimateSensorRotations(
    const Scene& scene, const ImageRotations& images,
    const RotationAveragingOptions& options) {
  return InternalRotationEstimator(scene, images, options).Run();
}

}  // namespace mgsfm
