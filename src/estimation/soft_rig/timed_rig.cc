// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/timed_rig.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/retriangulation.h"
#include "bundle_adjustment/solve.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "soft_rig/deviations.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr Eigen::Index kDelayColumn = RigScores::kNumColumns - 1;

// Ten blocks of consecutive frames per rig: Student's t with nine degrees of
// freedom.
std::vector<int> BlocksOfFrames(const Scene& scene, const CaptureTimes& times,
                                const Reconstruction& model) {
  std::vector<int> blocks(scene.frames.size(), 0);
  for (const auto& of_rig : FramesOfRigs(scene, times, model)) {
    for (size_t k = 0; k < of_rig.size(); ++k) {
      blocks[of_rig[k].second] = static_cast<int>(k * 10 / of_rig.size());
    }
  }
  return blocks;
}

// The velocity of points of the world in the camera frame.
struct CameraRate {
  Vector3d angular, linear;
};

CameraRate RateInCamera(const Rigid3& sensor_from_rig,
                        const Rigid3& cam_from_world, const PoseVector& rate) {
  const Vector3d angular = sensor_from_rig.rotation * rate.head<3>();
  // The center of the rig is at sensor_from_rig.translation.
  return {angular, -angular.cross(sensor_from_rig.translation) -
                       cam_from_world.rotation * rate.tail<3>()};
}

// A point of the camera frame after this time, to second order.
Vector3d After(const Vector3d& x, const CameraRate& rate, double time) {
  const Vector3d v = rate.angular.cross(x) + rate.linear;
  return x + time * v + 0.5 * time * time * rate.angular.cross(v);
}

// The distance of each keypoint: that of its point or, without one, the median
// of the image.
std::vector<std::vector<double>> DistancesOfKeypoints(
    const Scene& scene, const Reconstruction& model) {
  std::vector<std::vector<double>> distances(scene.images.size());
  std::vector<std::vector<double>> known(scene.images.size());
  const std::vector<std::optional<Rigid3>> poses = ImagePosesOf(scene, model);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    distances[i].assign(scene.images[i].keypoints_px.size(), 0.0);
  }
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      const auto& pose = poses[o.image_idx];
      if (!pose) continue;
      const double distance = (*pose * point.point_in_world).norm();
      distances[o.image_idx][o.keypoint_idx] = distance;
      known[o.image_idx].push_back(distance);
    }
  }
  for (size_t i = 0; i < distances.size(); ++i) {
    if (known[i].empty()) continue;
    const double median = Median(std::move(known[i]));
    for (double& distance : distances[i]) {
      if (distance == 0.0) distance = median;
    }
  }
  return distances;
}

// The mean of D_i^-1 over the images of each sensor, where D_i is the motion of
// the rig since its frame.
std::vector<Rigid3> MeanInverseMotions(const Scene& scene,
                                       const Reconstruction& model) {
  std::vector<PoseVector> sums(scene.sensors.size(), PoseVector::Zero());
  std::vector<double> counts(scene.sensors.size(), 0.0);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    const auto& frame = model.rig_from_world[image.frame_idx];
    if (!frame) continue;
    const Rigid3 inverse = *frame * Move(*frame, model.motions[i]).Inverse();
    sums[image.sensor_idx].head<3>() += LogSO3(inverse.rotation);
    sums[image.sensor_idx].tail<3>() += inverse.translation;
    counts[image.sensor_idx] += 1.0;
  }
  std::vector<Rigid3> means(sums.size());
  for (size_t s = 0; s < sums.size(); ++s) {
    const PoseVector mean = sums[s] / std::max(1.0, counts[s]);
    means[s] = {ExpSO3(mean.head<3>()), mean.tail<3>()};
  }
  return means;
}

}  // namespace

TimedRig StartTimedRig(const Scene& scene, const CaptureTimes& times,
                       const Reconstruction& model) {
  const std::vector<double> zero(scene.sensors.size(), 0.0);
  TimedRig rig{model, {}, BlocksOfFrames(scene, times, model), zero, zero};
  UpdateMotions(scene, times, &rig);
  if (!model.motions.empty()) return rig;
  // The poses of sensors without motions contain their mean motion.
  const std::vector<Rigid3> means = MeanInverseMotions(scene, rig.model);
  for (size_t s = 0; s < means.size(); ++s) {
    auto& pose = rig.model.sensor_from_rig[s];
    if (pose && !scene.sensors[s].sensor_from_rig) pose = *pose * means[s];
  }
  return rig;
}

void UpdateMotions(const Scene& scene, const CaptureTimes& times,
                   TimedRig* rig) {
  ImageMotions motions =
      FindImageMotions(scene, times, rig->delays, rig->model);
  rig->model.motions = std::move(motions.since_frame);
  rig->rates = std::move(motions.rates);
}

void ApplyStep(const Scene& scene, const CaptureTimes& times,
               const RigScores& scores, const Eigen::VectorXd& step,
               TimedRig* rig) {
  Reconstruction& model = rig->model;
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    const Eigen::Index delay = scores.DelayColumn(k);
    const PoseVector change = step.segment<6>(delay - 6);
    Rigid3& pose = *model.sensor_from_rig[scores.sensor_idxs[k]];
    pose = Updated(pose, change);
    rig->delays[scores.sensor_idxs[k]] += step[delay];
  }
  for (size_t k = 0; k < scores.readout_sensor_idxs.size(); ++k) {
    rig->readouts[scores.readout_sensor_idxs[k]] +=
        step[scores.ReadoutColumn(k)];
  }
  Eigen::VectorXd all(step.size() + 1);
  all << step, 1.0;
  for (size_t f = 0; f < scores.frame_idxs.size(); ++f) {
    const PoseVector change = scores.frame_response[f] * all;
    Rigid3& pose = *model.rig_from_world[scores.frame_idxs[f]];
    pose = Rigid3::FromRotationAndCenter(
        (ExpSO3(change.head<3>()) * pose.rotation).normalized(),
        pose.Center() + change.tail<3>());
  }
  UpdateMotions(scene, times, rig);
}

void ScaleToKnownRig(const Scene& scene, Reconstruction* model) {
  double products = 0.0, squares = 0.0, count = 0.0;
  Vector3d center = Vector3d::Zero();
  for (size_t s = 0; s < scene.sensors.size(); ++s) {
    const auto& known = scene.sensors[s].sensor_from_rig;
    const auto& pose = model->sensor_from_rig[s];
    if (!known || !pose) continue;
    products += pose->translation.dot(known->translation);
    squares += pose->translation.squaredNorm();
  }
  for (const auto& pose : model->rig_from_world) {
    if (!pose) continue;
    center += pose->Center();
    count += 1.0;
  }
  if (!(products > 0.0) || count == 0.0) return;
  Sim3 known_from_model;
  known_from_model.scale = products / squares;
  known_from_model.translation =
      (1.0 - known_from_model.scale) * center / count;
  TransformWorld(known_from_model, model);
}

std::optional<Scene> WithoutReadouts(const Scene& scene, const TimedRig& rig) {
  if (!rig.estimates_readouts) return std::nullopt;
  Scene moved = scene;
  const Reconstruction& model = rig.model;
  const auto distances = DistancesOfKeypoints(scene, model);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    Image& image = moved.images[i];
    const auto pose = model.CamFromWorld(scene, static_cast<int>(i));
    if (!pose) continue;
    const CameraRate rate = RateInCamera(
        *model.sensor_from_rig[image.sensor_idx], *pose, rig.rates[i]);
    const Camera& camera = model.cameras[image.camera_idx];
    for (size_t k = 0; k < image.keypoints_px.size(); ++k) {
      const Vector2d pixel = image.keypoints_px[k].cast<double>();
      const auto ray = RayFromPixel(camera, pixel);
      if (!ray) continue;
      const double time =
          rig.readouts[image.sensor_idx] * (pixel.y() / camera.height_px - 0.5);
      const auto at_image =
          ProjectToPixel(camera, After(distances[i][k] * *ray, rate, -time));
      if (at_image) image.keypoints_px[k] = at_image->cast<float>();
    }
  }
  return moved;
}

void TriangulateAgain(const Scene& scene, const CandidateSource& candidates,
                      const BundleAdjustmentOptions& options,
                      int num_rounds_left, const Context& context,
                      Reconstruction* model) {
  const double sigma_px =
      num_rounds_left > 0 ? std::numeric_limits<double>::infinity()
                          : NoiseSigmaPx(scene, *model, context.num_threads);
  const double max_error_px = MaxErrorPx(options, sigma_px, num_rounds_left);
  Retriangulate(
      scene, *candidates.groups(*model, max_error_px),
      MakeFilterOptions(scene, *model, options, max_error_px, context),
      context.num_threads, model);
}

bool IsInsignificant(const RigScores& scores, const Eigen::VectorXd& step,
                     StepPart part) {
  const Eigen::ArrayXd sigmas = Jackknife(scores).diagonal().cwiseSqrt();
  const auto num_poses = static_cast<Eigen::Index>(scores.sensor_idxs.size()) *
                         RigScores::kNumColumns;
  for (Eigen::Index k = 0; k < step.size(); ++k) {
    const bool is_time =
        k >= num_poses || k % RigScores::kNumColumns == kDelayColumn;
    if (part == StepPart::kTimes && !is_time) continue;
    if (std::abs(step[k]) > 0.1 * sigmas[k]) return false;
  }
  return true;
}

}  // namespace mgsfm
