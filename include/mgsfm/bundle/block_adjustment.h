// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Bundle adjustment with the equations of one block of points at a time.
//
// A block eliminates its points, and the frames that no point of another block
// observes. Equations for the shared frames, the sensors and the cameras
// remain; those of all blocks are added and solved. The steps of the other
// frames and of the points follow block by block. Cost, steps and stopping
// criteria are those of Levenberg-Marquardt on the whole model, therefore both
// have the same minimum (docs/maths/bundle.md, Blocks). Each iteration visits
// every block once and linearises it twice.
//
// Memory: the points as below, the equations of the largest block, and twice
// the system of all shared frames with its factor.

// Points in flat arrays: about 60 bytes each, and 8 for each observation.
struct PointBlock {
  ObservationGroups tracks;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Matrix<uint8_t, 3, 1>> colors;

  size_t size() const { return positions.size(); }
  void Add(const Point3D& point);
  // The points have no errors.
  std::vector<Point3D> Unpack() const;
};

PointBlock PackPoints(const std::vector<Point3D>& points);

// Per frame of the scene, from 0.
using FrameBlocks = std::vector<int>;

// The block of a point: the first that has a frame which observes it.
int BlockOf(const Scene& scene, const FrameBlocks& blocks,
            const Point3D& point);

// A model whose points are in blocks instead of in `poses`.
struct BlockedModel {
  Reconstruction poses;
  std::vector<PointBlock> blocks;

  // The points of a block with the poses.
  Reconstruction Part(size_t block) const;
  size_t NumPoints() const;
  size_t NumObservations() const;
  // Visits all points, with their errors.
  void VisitPoints(const Scene& scene, int num_threads,
                   const std::function<void(const Point3D&)>& visitor) const;
};

// AdjustBundle() by blocks.
[[nodiscard]] BundleSummary AdjustBundleInBlocks(
    const Scene& scene, const BundleAdjustmentOptions& options,
    const Context& context, BlockedModel* model);

// RefineReconstruction() by blocks. Observations that a round removes do not
// return in the next. The summary lists solves, rounds and dropped frames.
[[nodiscard]] BundleSummary RefineInBlocks(
    const Scene& scene, const BundleAdjustmentOptions& options,
    const Context& context, BlockedModel* model);

}  // namespace mgsfm
