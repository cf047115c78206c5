// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "incremental/growing_model.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// Starts models, as mgsfm/incremental/incremental_mapping.h describes.
class StartFinder {
 public:
  // Weighs all pairs. Cost: linear in the matches.
  explicit StartFinder(const GrowthInput& input);

  // A model of the heaviest candidate that has enough points, without frames of
  // the mask; null if there is none. Frames of candidates that fail, and those
  // of the model, never start a model again.
  std::unique_ptr<GrowingModel> Start(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Mask& frame_is_taken);

 private:
  // A pair of frames, or two images of one frame.
  struct Candidate {
    int frame_idx1 = 0;
    int frame_idx2 = 0;
    double weight = 0.0;
    std::vector<size_t> pair_idxs;  // the heaviest first
  };
  std::vector<Candidate> ListCandidates(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Mask& frame_is_taken) const;
  std::unique_ptr<GrowingModel> Try(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Candidate& candidate) const;
  std::optional<Rigid3> PoseOf(
      const std::vector<std::optional<Rigid3>>& sensors,
      const Candidate& candidate) const;

  const GrowthInput& input_;
  std::vector<double> weights_;  // per pair
  Mask frame_is_tried_;
};

}  // namespace mgsfm
