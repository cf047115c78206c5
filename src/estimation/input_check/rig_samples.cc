// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/rig_samples.h"

#include <algorithm>
#include <limits>
#include <map>
#include <tuple>
#include <utility>

#include "base/ranges.h"
#include "geometry/mean_direction.h"
#include "rotation_averaging/geodesic_median.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// All samples of two sensors, by frame.
using SamplesOfFrames = std::map<int, std::vector<RigSample>>;
using SamplesOfSensors = std::map<std::pair<int, int>, SamplesOfFrames>;

class SampleCollector {
 public:
  SampleCollector(const Scene& scene, const ViewGraph& view_graph)
      : scene_(scene), view_graph_(view_graph) {}

  SamplesOfSensors Collect() {
    for (const ImagePair& pair : view_graph_.pairs) {
      if (pair.relative_pose) Add(pair);
    }
    return std::move(samples_);
  }

 private:
  void Add(const ImagePair& pair);
  std::optional<Quaterniond> Rotation(int to_image, int from_image) const;
  std::optional<int> ImageOf(int frame_idx, int sensor_idx) const;

  const Scene& scene_;
  const ViewGraph& view_graph_;
  SamplesOfSensors samples_;
};

std::optional<int> SampleCollector::ImageOf(int frame_idx,
                                            int sensor_idx) const {
  for (const int i : scene_.frames[frame_idx].image_idxs) {
    if (scene_.images[i].sensor_idx == sensor_idx) return i;
  }
  return std::nullopt;
}

std::optional<Quaterniond> SampleCollector::Rotation(int to_image,
                                                     int from_image) const {
  const auto key = std::minmax(to_image, from_image);
  const auto found = std::lower_bound(
      view_graph_.pairs.begin(), view_graph_.pairs.end(), key,
      [](const ImagePair& pair, const std::pair<int, int>& images) {
        return std::tie(pair.image_idx1, pair.image_idx2) <
               std::tie(images.first, images.second);
      });
  if (found == view_graph_.pairs.end() || found->image_idx1 != key.first ||
      found->image_idx2 != key.second || !found->relative_pose) {
    return std::nullopt;
  }
  const Quaterniond& rotation = found->relative_pose->cam2_from_cam1;
  return from_image == found->image_idx1 ? rotation : rotation.conjugate();
}

void SampleCollector::Add(const ImagePair& pair) {
  int a = pair.image_idx1, b = pair.image_idx2;
  const bool is_forward =
      scene_.images[a].sensor_idx < scene_.images[b].sensor_idx;
  if (!is_forward) std::swap(a, b);
  const Image& image_a = scene_.images[a];
  const Image& image_b = scene_.images[b];
  if (image_a.sensor_idx == image_b.sensor_idx ||
      scene_.sensors[image_a.sensor_idx].rig_idx !=
          scene_.sensors[image_b.sensor_idx].rig_idx) {
    return;
  }
  const Quaterniond& R = pair.relative_pose->cam2_from_cam1;
  const Quaterniond b_from_a = is_forward ? R : R.conjugate();
  SamplesOfFrames& frames = samples_[{image_a.sensor_idx, image_b.sensor_idx}];
  if (image_a.frame_idx == image_b.frame_idx) {
    RigSample sample{image_a.frame_idx, b_from_a,
                     pair.relative_pose->translation_direction, &pair};
    if (sample.direction && !is_forward) {
      sample.direction = -(b_from_a * *sample.direction);
    }
    frames[image_a.frame_idx].push_back(sample);
    return;
  }
  if (const auto a_in_g = ImageOf(image_b.frame_idx, image_a.sensor_idx)) {
    if (const auto motion = Rotation(a, *a_in_g)) {
      frames[image_b.frame_idx].push_back(
          {image_b.frame_idx, b_from_a * *motion, std::nullopt, nullptr});
    }
  }
  if (const auto b_in_f = ImageOf(image_a.frame_idx, image_b.sensor_idx)) {
    if (const auto motion = Rotation(*b_in_f, b)) {
      frames[image_a.frame_idx].push_back(
          {image_a.frame_idx, *motion * b_from_a, std::nullopt, nullptr});
    }
  }
}

// The medoid. The pair within the frame provides the direction.
RigSample SelectSample(const std::vector<RigSample>& samples) {
  const RigSample* best = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const RigSample& candidate : samples) {
    double sum = 0.0;
    for (const RigSample& other : samples) {
      sum += std::min(AngleBetween(candidate.b_from_a, other.b_from_a),
                      kSameRotationRad);
    }
    if (sum >= least) continue;
    least = sum;
    best = &candidate;
  }
  RigSample selected = *best;
  for (const RigSample& sample : samples) {
    if (!sample.direction) continue;
    selected.direction = sample.direction;
    selected.pair = sample.pair;
  }
  return selected;
}

}  // namespace

std::vector<int> RankFrames(const Scene& scene) {
  const std::vector<int> order = OrderOfFrames(scene);
  std::vector<int> rank(order.size());
  std::vector<int> num_of_rig(scene.rigs.size(), 0);
  for (const int frame_idx : order) {
    rank[frame_idx] = num_of_rig[scene.frames[frame_idx].rig_idx]++;
  }
  return rank;
}

std::vector<SensorPairSamples> CollectRigSamples(const Scene& scene,
                                                 const ViewGraph& view_graph) {
  const std::vector<int> rank = RankFrames(scene);
  std::vector<SensorPairSamples> result;
  for (const auto& [sensors, frames] :
       SampleCollector(scene, view_graph).Collect()) {
    SensorPairSamples& of_pair = result.emplace_back(
        SensorPairSamples{sensors.first, sensors.second, {}});
    for (const auto& [frame_idx, samples] : frames) {
      of_pair.samples.push_back(SelectSample(samples));
    }
    SortBy(&of_pair.samples,
           [&](const RigSample& x) { return rank[x.frame_idx]; });
  }
  return result;
}

std::optional<TypicalRigPose> FindTypicalPose(
    const std::vector<RigSample>& samples) {
  if (samples.empty()) return std::nullopt;
  const GeodesicMedian median = FindGeodesicMedian(
      Transformed(samples, &RigSample::b_from_a),
      std::vector<double>(samples.size(), 1.0), kSameRotationRad);
  TypicalRigPose typical{median.rotation, std::nullopt,
                         median.median_deviation_rad};
  std::vector<Vector3d> directions;
  for (const RigSample& sample : samples) {
    if (sample.direction &&
        AngleBetween(sample.b_from_a, typical.b_from_a) < kSameRotationRad) {
      directions.push_back(*sample.direction);
    }
  }
  if (!directions.empty()) typical.direction = RobustMeanDirection(directions);
  return typical;
}

}  // namespace mgsfm
