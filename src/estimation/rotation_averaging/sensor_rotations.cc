// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/sensor_rotations.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <string>
#include <utility>

#include "base/format.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "rotation_averaging/geodesic_median.h"
#include "rotation_averaging/hand_eye.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// Larger rotations are excluded from hand-eye calibration: near 180 deg, a
// small error flips the sign of the logarithm.
constexpr double kMaxMotionRad = DegToRad(150.0);
// Number of evenly spaced frames from longer sequences. Bounds the quadratic
// number of motions: 64 frames have 2016.
constexpr size_t kMaxNumHandEyeFrames = 64;

// Rotations of a sensor and of its rig in one frame, each in the world of its
// component.
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
      if (motion.alpha.norm() <= kMaxMotionRad &&
          motion.beta.norm() <= kMaxMotionRad) {
        motions->push_back(motion);
      }
    }
  }
}

struct Samples {
  std::vector<Quaterniond> rotations;
  std::vector<double> weights;
};

struct Motions {
  std::vector<MotionPair> pairs;
  int num_frames = 0;
};

// The sensors determined so far.
struct DeterminedSensors {
  SensorRotations result;
  // Per sensor: its position in the order in which sensors were determined.
  std::vector<std::optional<int>> rank;
  int num_determined = 0;
  Mask samples_disagree;  // per sensor: its median was refused

  void SetDetermined(int sensor_idx, const Quaterniond& sensor_from_rig) {
    rank[sensor_idx] = num_determined++;
    result.sensor_from_rig[sensor_idx] = sensor_from_rig;
    result.summaries[sensor_idx].is_observable = true;
  }
};

// Reference sensors come first, so that samples prefer them.
DeterminedSensors StartWithKnownSensors(const Scene& scene) {
  const size_t num_sensors = scene.sensors.size();
  DeterminedSensors sensors;
  sensors.result.sensor_from_rig.resize(num_sensors);
  sensors.result.summaries.resize(num_sensors);
  sensors.rank.resize(num_sensors);
  sensors.samples_disagree.resize(num_sensors);
  for (const bool is_reference : {true, false}) {
    for (size_t k = 0; k < num_sensors; ++k) {
      const int sensor_idx = static_cast<int>(k);
      const auto& sensor_from_rig = scene.sensors[k].sensor_from_rig;
      if (!sensor_from_rig || scene.IsReference(sensor_idx) != is_reference) {
        continue;
      }
      sensors.SetDetermined(sensor_idx,
                            ToUnitQuaternion(sensor_from_rig->rotation));
      sensors.result.summaries[k].message =
          is_reference ? "reference sensor" : "known";
    }
  }
  return sensors;
}

// The image by a sensor, if it has a rotation.
std::optional<int> FindImage(const Scene& scene, const ImageRotations& images,
                             const Frame& frame, int sensor_idx) {
  for (const int image_idx : frame.image_idxs) {
    if (scene.images[image_idx].sensor_idx == sensor_idx &&
        images.cam_from_world[image_idx]) {
      return image_idx;
    }
  }
  return std::nullopt;
}

// The image with a rotation whose sensor was determined first; only in
// `component` if given.
std::optional<int> FindDeterminedImage(const Scene& scene,
                                       const ImageRotations& images,
                                       const DeterminedSensors& sensors,
                                       const Frame& frame,
                                       std::optional<int> component) {
  std::optional<int> best;
  const auto rank = [&](int image_idx) {
    return sensors.rank[scene.images[image_idx].sensor_idx];
  };
  for (const int image_idx : frame.image_idxs) {
    if (!rank(image_idx) || !images.cam_from_world[image_idx]) continue;
    if (component && images.component[image_idx] != *component) continue;
    if (!best || *rank(image_idx) < *rank(*best)) best = image_idx;
  }
  return best;
}

Samples CollectSamples(const Scene& scene, const ImageRotations& images,
                       const DeterminedSensors& sensors, int sensor_idx) {
  Samples samples;
  for (const Frame& frame : scene.frames) {
    if (frame.rig_idx != scene.sensors[sensor_idx].rig_idx) continue;
    const std::optional<int> k = FindImage(scene, images, frame, sensor_idx);
    if (!k) continue;
    const std::optional<int> a = FindDeterminedImage(
        scene, images, sensors, frame, images.component[*k]);
    if (!a) continue;
    samples.rotations.push_back(
        *images.cam_from_world[*k] * images.cam_from_world[*a]->conjugate() *
        *sensors.result.sensor_from_rig[scene.images[*a].sensor_idx]);
    samples.weights.push_back(
        std::max(1.0, std::min(images.support[*k], images.support[*a])));
  }
  return samples;
}

bool AcceptMedian(int sensor_idx, const Samples& samples, double max_error_deg,
                  DeterminedSensors* sensors) {
  const GeodesicMedian median = FindGeodesicMedian(
      samples.rotations, samples.weights, DegToRad(max_error_deg));
  SensorRotationSummary& summary = sensors->result.summaries[sensor_idx];
  const double deviation_deg = RadToDeg(median.median_deviation_rad);
  summary.num_samples = static_cast<int>(samples.rotations.size());
  summary.median_deviation_deg = deviation_deg;
  if (!median.summary.IsUsable() || deviation_deg > max_error_deg) {
    summary.message =
        Formatted("samples disagree: %.3g deg median deviation in %d frames",
                  deviation_deg, summary.num_samples);
    return false;
  }
  sensors->SetDetermined(sensor_idx, median.rotation);
  summary.message = Formatted("median of %d frames, %.3g deg median deviation",
                              summary.num_samples, deviation_deg);
  return true;
}

// Determines the sensor with most samples among those whose samples agree.
// False if there is none.
bool DetermineBySamples(const Scene& scene, const ImageRotations& images,
                        double max_error_deg, DeterminedSensors* sensors) {
  while (true) {
    std::optional<int> best;
    Samples best_samples;
    for (size_t k = 0; k < scene.sensors.size(); ++k) {
      if (sensors->rank[k] || sensors->samples_disagree[k]) continue;
      const int sensor_idx = static_cast<int>(k);
      Samples samples = CollectSamples(scene, images, *sensors, sensor_idx);
      if (samples.rotations.size() > best_samples.rotations.size()) {
        best = sensor_idx;
        best_samples = std::move(samples);
      }
    }
    if (!best) return false;
    if (AcceptMedian(*best, best_samples, max_error_deg, sensors)) return true;
    sensors->samples_disagree[*best] = true;
  }
}

// The motions of all pairs of frames in which the sensor stays in one component
// and the rest of the rig in one component; and the number of these frames.
Motions CollectMotions(const Scene& scene, const ImageRotations& images,
                       const DeterminedSensors& sensors, int sensor_idx) {
  std::map<std::pair<int, int>, std::vector<HandEyeFrame>> frames_of_components;
  for (const Frame& frame : scene.frames) {
    if (frame.rig_idx != scene.sensors[sensor_idx].rig_idx) continue;
    const std::optional<int> k = FindImage(scene, images, frame, sensor_idx);
    const std::optional<int> a =
        FindDeterminedImage(scene, images, sensors, frame, std::nullopt);
    if (!k || !a) continue;
    const Quaterniond& S_a =
        *sensors.result.sensor_from_rig[scene.images[*a].sensor_idx];
    frames_of_components[{images.component[*k], images.component[*a]}]
        .push_back({*images.cam_from_world[*k],
                    S_a.conjugate() * *images.cam_from_world[*a]});
  }
  Motions motions;
  for (const auto& [components, frames] : frames_of_components) {
    if (frames.size() < 2) continue;
    motions.num_frames += static_cast<int>(frames.size());
    AddMotions(Thin(frames), &motions.pairs);
  }
  return motions;
}

bool AcceptHandEye(int sensor_idx, const Motions& motions,
                   const RotationAveragingOptions& options,
                   DeterminedSensors* sensors) {
  SensorRotationSummary& summary = sensors->result.summaries[sensor_idx];
  const std::string prefix =
      sensors->samples_disagree[sensor_idx] ? summary.message + "; " : "";
  if (motions.pairs.empty()) {
    summary.message = prefix +
                      "not observable: no frame has rotations both of this "
                      "sensor and of another one of its rig";
    return false;
  }
  const HandEyeResult hand_eye =
      CalibrateHandEye(motions.pairs, motions.num_frames);
  const double second_axis_deg = RadToDeg(hand_eye.second_axis_rms_rad);
  const double error_deg = RadToDeg(hand_eye.median_error_rad);
  // Pairs of the sensor stay well within max_error_deg if the standard
  // deviation is at most a fifth of it.
  if (second_axis_deg < options.min_hand_eye_rotation_deg ||
      error_deg > options.max_error_deg ||
      RadToDeg(hand_eye.uncertainty_rad) > 0.2 * options.max_error_deg) {
    summary.message =
        prefix +
        Formatted(
            "not observable: no pairs connect it with the other sensors, "
            "and the rig rotated only %.3g deg about a second axis "
            "(median error %.3g deg)",
            second_axis_deg, error_deg);
    return false;
  }
  summary.num_samples = motions.num_frames;
  summary.median_deviation_deg = error_deg;
  summary.message =
      prefix + Formatted(
                   "hand-eye calibration with rotations of %.3g deg about a "
                   "second axis, %.3g deg median error",
                   second_axis_deg, error_deg);
  sensors->SetDetermined(sensor_idx, hand_eye.a_from_b);
  return true;
}

bool DetermineByHandEye(const Scene& scene, const ImageRotations& images,
                        const RotationAveragingOptions& options,
                        DeterminedSensors* sensors) {
  for (size_t k = 0; k < scene.sensors.size(); ++k) {
    if (sensors->rank[k]) continue;
    const int sensor_idx = static_cast<int>(k);
    if (AcceptHandEye(sensor_idx,
                      CollectMotions(scene, images, *sensors, sensor_idx),
                      options, sensors)) {
      return true;
    }
  }
  return false;
}

}  // namespace

SensorRotations EstimateSensorRotations(
    const Scene& scene, const ImageRotations& images,
    const RotationAveragingOptions& options) {
  DeterminedSensors sensors = StartWithKnownSensors(scene);
  while (DetermineBySamples(scene, images, options.max_error_deg, &sensors) ||
         DetermineByHandEye(scene, images, options, &sensors)) {
  }
  return std::move(sensors.result);
}

}  // namespace mgsfm
