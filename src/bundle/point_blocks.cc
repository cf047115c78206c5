// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "bundle/point_filters.h"
#include "mgsfm/bundle/block_adjustment.h"

namespace mgsfm {

void PointBlock::Add(const Point3D& point) {
  tracks.observations.insert(tracks.observations.end(), point.track.begin(),
                             point.track.end());
  tracks.FinishGroup();
  positions.push_back(point.point_in_world);
  colors.push_back(point.color);
}

std::vector<Point3D> PointBlock::Unpack() const {
  std::vector<Point3D> points(size());
  for (size_t i = 0; i < points.size(); ++i) {
    points[i].point_in_world = positions[i];
    points[i].color = colors[i];
    points[i].track.assign(tracks.begin(i), tracks.end(i));
  }
  return points;
}

PointBlock PackPoints(const std::vector<Point3D>& points) {
  size_t num_observations = 0;
  for (const Point3D& point : points) num_observations += point.track.size();
  PointBlock block;
  block.tracks.observations.reserve(num_observations);
  block.tracks.offsets.reserve(points.size() + 1);
  block.positions.reserve(points.size());
  block.colors.reserve(points.size());
  for (const Point3D& point : points) block.Add(point);
  return block;
}

int BlockOf(const Scene& scene, const FrameBlocks& blocks,
            const Point3D& point) {
  int first = blocks[scene.images[point.track.front().image_idx].frame_idx];
  for (const Observation& o : point.track) {
    first = std::min(first, blocks[scene.images[o.image_idx].frame_idx]);
  }
  return first;
}

Reconstruction BlockedModel::Part(size_t block) const {
  Reconstruction part = poses;
  part.points = blocks[block].Unpack();
  return part;
}

size_t BlockedModel::NumPoints() const {
  size_t sum = 0;
  for (const PointBlock& block : blocks) sum += block.size();
  return sum;
}

size_t BlockedModel::NumObservations() const {
  size_t sum = 0;
  for (const PointBlock& block : blocks)
    sum += block.tracks.observations.size();
  return sum;
}

void BlockedModel::VisitPoints(
    const Scene& scene, int num_threads,
    const std::function<void(const Point3D&)>& visitor) const {
  for (size_t b = 0; b < blocks.size(); ++b) {
    Reconstruction part = Part(b);
    ComputePointErrors(scene, num_threads, &part);
    for (const Point3D& point : part.points) visitor(point);
  }
}

}  // namespace mgsfm
