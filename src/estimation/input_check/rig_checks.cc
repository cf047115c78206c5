// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/rig_checks.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Steps of correct rigs reach 3.6 standard deviations; the weakest real step
// has 24 (docs/results/input_check.md).
constexpr double kMinStepInSigmas = 6.0;
// Passing vehicles disturb the pairs of a side camera for some frames.
constexpr double kMinStretchShare = 0.05;
// Steps of correct rigs reach 0.54 degrees, at 1.6 standard deviations
// (docs/results/input_check.md).
constexpr double kMinStepRad = DegToRad(0.5);
// A known rotation has an error of its own. Half or twice the value still
// detects an error of 5 degrees (docs/results/constants.md).
constexpr double kMinKnownErrorRad = 2 * kMinStepRad;
// The fraction of all samples that agree with one pose or the other: 30 % may
// be wrong pairs. Half or twice as many change no verdict
// (docs/results/constants.md).
constexpr double kMinExplainedShare = 0.7;

std::string Quoted(const std::string& name) { return "'" + name + "'"; }

Vector3d MedianVector(const std::vector<Vector3d>& vectors) {
  Vector3d median;
  for (int axis = 0; axis < 3; ++axis) {
    median[axis] = Median(
        Transformed(vectors, [&](const Vector3d& v) { return v[axis]; }));
  }
  return median;
}

// The residuals of a segment of frames.
struct Stretch {
  Vector3d median = Vector3d::Zero();
  double sigma = 0.0;  // per axis
};

Stretch Summarize(const std::vector<Vector3d>& residuals) {
  Stretch stretch{MedianVector(residuals), 0.0};
  stretch.sigma = RobustSigma<3>(Transformed(residuals, [&](const Vector3d& r) {
    return (r - stretch.median).norm();
  }));
  return stretch;
}

// The size of the first segment for which the two means differ most, in
// standard deviations of the difference.
size_t FindSplit(const std::vector<Vector3d>& residuals, size_t min_size) {
  const size_t size = residuals.size();
  Vector3d total = Vector3d::Zero();
  for (const Vector3d& r : residuals) total += r;
  Vector3d sum = Vector3d::Zero();
  double largest = -1.0;
  size_t best = 0;
  for (size_t n = 1; n < size; ++n) {
    sum += residuals[n - 1];
    if (n < min_size || size - n < min_size) continue;
    const auto n1 = static_cast<double>(n);
    const auto n2 = static_cast<double>(size - n);
    const double gain = (sum / n1 - (total - sum) / n2).squaredNorm() * n1 * n2;
    if (gain <= largest) continue;
    largest = gain;
    best = n;
  }
  return best;
}

// A significant step between two sensors.
struct RigMove {
  int sensor_a;
  int sensor_b;
  RigStep step;

  bool Concerns(int sensor) const {
    return sensor_a == sensor || sensor_b == sensor;
  }
  double Strength() const { return step.step_rad / step.sigma_rad; }
};

// The sensor in most moves. Ties go to the last sensor, because the first one
// is the reference in most rigs.
int FindCulprit(const std::vector<RigMove>& moves, int num_sensors) {
  int culprit = 0;
  std::ptrdiff_t most = 0;
  for (int sensor = 0; sensor < num_sensors; ++sensor) {
    const auto count =
        CountIf(moves, [&](const RigMove& m) { return m.Concerns(sensor); });
    if (count < most) continue;
    most = count;
    culprit = sensor;
  }
  return culprit;
}

std::string DescribeDelay(const CameraDelay& camera, bool is_in_seconds) {
  const char* direction = camera.delay > 0.0 ? "late" : "early";
  if (is_in_seconds) {
    return Formatted("is %.1f +- %.1f ms %s", 1e3 * std::abs(camera.delay),
                     1e3 * camera.sigma, direction);
  }
  // The first digit of the standard deviation is visible.
  const int num_decimals =
      camera.sigma > 0.0 && std::isfinite(camera.sigma)
          ? std::max(0, static_cast<int>(std::ceil(-std::log10(camera.sigma))))
          : 0;
  return Formatted("is %.*f +- %.*f frame intervals %s", num_decimals,
                   std::abs(camera.delay), num_decimals, camera.sigma,
                   direction);
}

Finding DescribeMove(const Scene& scene, int culprit, const RigMove& move) {
  const int other = move.sensor_a == culprit ? move.sensor_b : move.sensor_a;
  const std::string& camera = scene.sensors[culprit].name;
  const std::string& frame = scene.frames[move.step.first_frame_idx].name;
  return {Cause::kRigMoved,
          {camera, scene.sensors[other].name},
          {frame},
          {{"step_deg", RadToDeg(move.step.step_rad)},
           {"sigma_deg", RadToDeg(move.step.sigma_rad)}},
          "camera " + Quoted(camera) + " turned by " +
              Formatted("%.1f", RadToDeg(move.step.step_rad)) +
              " deg relative to camera " + Quoted(scene.sensors[other].name) +
              " at frame " + Quoted(frame),
          "set split_rig_at to " + frame +
              ", to calibrate the frames from there on separately"};
}

// Whether the frames comprise most samples between their first and last.
bool IsOneStretch(const std::vector<RigSample>& samples,
                  const std::vector<int>& frame_idxs) {
  const auto position = [&](int frame_idx) {
    return std::find_if(
        samples.begin(), samples.end(),
        [&](const RigSample& sample) { return sample.frame_idx == frame_idx; });
  };
  const auto length =
      position(frame_idxs.back()) - position(frame_idxs.front()) + 1;
  return static_cast<double>(frame_idxs.size()) >=
         kMinExplainedShare * static_cast<double>(length);
}

bool Agrees(const RigSample& sample, const Quaterniond& rotation,
            const std::optional<Vector3d>& direction) {
  if (AngleBetween(sample.b_from_a, rotation) > kSameRotationRad) return false;
  return !sample.direction || !direction ||
         AngleBetween(*sample.direction, *direction) < kSameDirectionRad;
}

}  // namespace

std::optional<RigStep> FindLargestStep(const std::vector<RigSample>& samples) {
  const auto typical = FindTypicalPose(samples);
  if (!typical) return std::nullopt;
  std::vector<Vector3d> residuals;
  std::vector<int> frame_idxs;
  for (const RigSample& sample : samples) {
    const Vector3d residual =
        LogSO3(sample.b_from_a * typical->b_from_a.conjugate());
    // Larger residuals are due to wrong pairs, not to moved cameras.
    if (residual.norm() > 2.0 * kSameRotationRad) continue;
    residuals.push_back(residual);
    frame_idxs.push_back(sample.frame_idx);
  }
  const size_t min_size =
      std::max(kMinNumRigFrames,
               static_cast<size_t>(kMinStretchShare *
                                   static_cast<double>(residuals.size())));
  if (residuals.size() < 2 * min_size) return std::nullopt;
  const auto split = residuals.begin() + static_cast<std::ptrdiff_t>(
                                             FindSplit(residuals, min_size));
  const Stretch before = Summarize({residuals.begin(), split});
  const Stretch after = Summarize({split, residuals.end()});
  return RigStep{frame_idxs[split - residuals.begin()],
                 (after.median - before.median).norm(),
                 std::max(before.sigma, after.sigma)};
}

std::vector<Finding> DescribeDelays(const Scene& scene,
                                    const RigDelays& delays) {
  std::vector<Finding> findings;
  for (const Rig& rig : scene.rigs) {
    Finding finding;
    finding.cause = Cause::kUnsynchronized;
    bool is_certain = false;
    for (const CameraDelay& camera : delays.cameras) {
      const Sensor& sensor = scene.sensors[camera.sensor_idx];
      if (&scene.rigs[sensor.rig_idx] != &rig) continue;
      is_certain |= camera.is_certain;
      finding.cameras.push_back(sensor.name);
      finding.evidence.emplace_back("delay", camera.delay);
      finding.evidence.emplace_back("sigma", camera.sigma);
      finding.text += (finding.text.empty() ? "" : ", ") + Quoted(sensor.name) +
                      " " + DescribeDelay(camera, delays.is_in_seconds);
    }
    if (!is_certain) continue;
    const std::string& reference = scene.sensors[rig.ref_sensor_idx].name;
    finding.text = "cameras do not trigger together: relative to " +
                   Quoted(reference) + ", " + finding.text +
                   "; stated standard deviations include the resulting errors";
    finding.remedy = "set SoftRig.method time_offset";
    if (!delays.is_in_seconds) finding.remedy += " and image_timestamps_path";
    finding.cameras.push_back(reference);
    findings.push_back(std::move(finding));
  }
  return findings;
}

void RemoveMotions(const Scene& scene, const Reconstruction& model,
                   std::vector<SensorPairSamples>* pairs) {
  if (model.motions.empty()) return;
  const auto turn_of = [&](int frame_idx, int sensor_idx) {
    for (const int image_idx : scene.frames[frame_idx].image_idxs) {
      if (scene.images[image_idx].sensor_idx == sensor_idx) {
        return model.motions[image_idx].rotation;
      }
    }
    return Eigen::Quaterniond::Identity();
  };
  for (SensorPairSamples& pair : *pairs) {
    const auto& a_from_rig = model.sensor_from_rig[pair.sensor_a];
    if (!a_from_rig) continue;
    for (RigSample& sample : pair.samples) {
      const Eigen::Quaterniond turn =
          turn_of(sample.frame_idx, pair.sensor_a) *
          turn_of(sample.frame_idx, pair.sensor_b).conjugate();
      sample.b_from_a = sample.b_from_a * a_from_rig->rotation * turn *
                        a_from_rig->rotation.conjugate();
    }
  }
}

std::vector<Finding> FindRigMoves(const Scene& scene,
                                  const std::vector<SensorPairSamples>& pairs) {
  std::vector<RigMove> moves;
  std::vector<int> num_pairs(scene.sensors.size(), 0);
  for (const SensorPairSamples& pair : pairs) {
    const auto step = FindLargestStep(pair.samples);
    if (!step) continue;
    ++num_pairs[pair.sensor_a];
    ++num_pairs[pair.sensor_b];
    if (step->step_rad > kMinStepRad &&
        step->step_rad > kMinStepInSigmas * step->sigma_rad) {
      moves.push_back({pair.sensor_a, pair.sensor_b, *step});
    }
  }
  std::vector<Finding> findings;
  while (!moves.empty()) {
    const int culprit = FindCulprit(moves, static_cast<int>(num_pairs.size()));
    const auto others =
        std::partition(moves.begin(), moves.end(),
                       [&](const RigMove& m) { return m.Concerns(culprit); });
    // A moved sensor moves relative to most others.
    if (2 * (others - moves.begin()) > num_pairs[culprit]) {
      findings.push_back(DescribeMove(
          scene, culprit,
          *std::max_element(moves.begin(), others,
                            [](const RigMove& a, const RigMove& b) {
                              return a.Strength() < b.Strength();
                            })));
    }
    moves.erase(moves.begin(), others);
  }
  return findings;
}

std::vector<Finding> CheckKnownRotations(
    const Scene& scene, const std::vector<SensorPairSamples>& pairs,
    const std::vector<KeptCount>& kept_between) {
  const auto is_explained = [&](int sensor_idx) {
    return !kept_between.empty() && kept_between[sensor_idx].IsMostlyKept();
  };
  std::vector<Finding> findings;
  for (const SensorPairSamples& pair : pairs) {
    const Sensor& a = scene.sensors[pair.sensor_a];
    const Sensor& b = scene.sensors[pair.sensor_b];
    if (!a.sensor_from_rig || !b.sensor_from_rig ||
        pair.samples.size() < kMinNumRigFrames) {
      continue;
    }
    const auto typical = FindTypicalPose(pair.samples);
    const double error_rad = AngleBetween(
        typical->b_from_a,
        b.sensor_from_rig->rotation * a.sensor_from_rig->rotation.conjugate());
    const double sigma_rad =
        SigmaFromMedianNorm<3>(typical->median_deviation_rad);
    if (error_rad < kMinKnownErrorRad ||
        error_rad < kRareErrorInSigmas * sigma_rad ||
        (is_explained(pair.sensor_a) && is_explained(pair.sensor_b))) {
      continue;
    }
    findings.push_back(
        {Cause::kWrongKnownRotation,
         {a.name, b.name},
         {},
         {{"error_deg", RadToDeg(error_rad)},
          {"sigma_deg", RadToDeg(sigma_rad)},
          {"num_frames", static_cast<double>(pair.samples.size())}},
         "the known rotation between the cameras " + Quoted(a.name) + " and " +
             Quoted(b.name) + " contradicts the image pairs of " +
             std::to_string(pair.samples.size()) + " frames by " +
             Formatted("%.1f", RadToDeg(error_rad)) + " deg",
         "correct the rig configuration, or remove the pose of one of the "
         "cameras to estimate it"});
  }
  return findings;
}

std::vector<Finding> FindSwappedCameras(
    const Scene& scene, const std::vector<SensorPairSamples>& pairs) {
  std::vector<Finding> findings;
  for (const SensorPairSamples& pair : pairs) {
    const auto typical = FindTypicalPose(pair.samples);
    if (!typical) continue;
    const Quaterniond inverse = typical->b_from_a.conjugate();
    std::optional<Vector3d> inverse_direction;
    if (typical->direction) {
      inverse_direction = -(inverse * *typical->direction);
    }
    // A pose that is its own inverse hides an exchange of cameras.
    const RigSample exchanged{0, inverse, inverse_direction};
    if (Agrees(exchanged, typical->b_from_a, typical->direction)) continue;
    std::vector<int> swapped, regular;
    for (const RigSample& sample : pair.samples) {
      const bool can_tell =
          sample.direction ||
          AngleBetween(inverse, typical->b_from_a) > 2.0 * kSameRotationRad;
      if (!can_tell) continue;
      if (Agrees(sample, inverse, inverse_direction)) {
        swapped.push_back(sample.frame_idx);
      } else if (Agrees(sample, typical->b_from_a, typical->direction)) {
        regular.push_back(sample.frame_idx);
      }
    }
    // Report the smaller group.
    if (swapped.size() > regular.size()) std::swap(swapped, regular);
    if (swapped.size() < kMinNumRigFrames ||
        !IsOneStretch(pair.samples, swapped) ||
        static_cast<double>(swapped.size() + regular.size()) <
            kMinExplainedShare * static_cast<double>(pair.samples.size())) {
      continue;
    }
    const std::string& a = scene.sensors[pair.sensor_a].name;
    const std::string& b = scene.sensors[pair.sensor_b].name;
    const std::string& first = scene.frames[swapped.front()].name;
    const std::string& last = scene.frames[swapped.back()].name;
    findings.push_back(
        {Cause::kSwappedCameras,
         {a, b},
         {first, last},
         {{"num_frames_swapped", static_cast<double>(swapped.size())},
          {"num_frames_regular", static_cast<double>(regular.size())}},
         "the images of cameras " + Quoted(a) + " and " + Quoted(b) +
             " seem to be exchanged in " + std::to_string(swapped.size()) +
             " frames, " + Quoted(first) + " to " + Quoted(last),
         "exchange the names of these images"});
  }
  return findings;
}

std::vector<Finding> DescribeRigDifferences(
    const Scene& scene, size_t model_idx, const Reconstruction& model,
    const std::vector<RigDifference>& differences) {
  std::vector<std::string> frames;  // the first and the last one
  for (size_t f = 0; f < model.rig_from_world.size(); ++f) {
    if (!model.rig_from_world[f]) continue;
    frames.resize(std::min<size_t>(frames.size() + 1, 2));
    frames.back() = scene.frames[f].name;
  }
  const std::string name = "model " + std::to_string(model_idx);
  std::vector<Finding> findings;
  for (const RigDifference& d : differences) {
    const std::string& camera = scene.sensors[d.sensor_idx].name;
    std::string size =
        Formatted("%.3g +- %.2g deg", d.rotation_deg, d.sigma_rotation_deg);
    if (d.distance) {
      size += Formatted(" and %.3g +- %.2g units of length", *d.distance,
                        d.sigma_distance);
    }
    std::string text = "the pose of camera '" + camera + "' in the rig of ";
    text += name + " differs from that in a larger model by ";
    text += size;
    text += ", so that " + name + " has a rig of its own";
    findings.push_back(
        {Cause::kRigDiffers,
         {camera},
         frames,
         {{"model", static_cast<double>(model_idx)},
          {"rotation_deg", d.rotation_deg},
          {"sigma_rotation_deg", d.sigma_rotation_deg},
          {"distance", d.distance.value_or(0.0)},
          {"sigma_distance", d.sigma_distance}},
         std::move(text),
         "check whether the rig changed, and whether the images of the model "
         "match rightly"});
  }
  return findings;
}

}  // namespace mgsfm
