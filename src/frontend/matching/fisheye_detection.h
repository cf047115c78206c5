// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Cameras with a perspective model whose images are better explained by a
// fisheye.
struct FisheyeFinding {
  std::vector<std::string> cameras;  // names of sensors
  std::vector<int> camera_idxs;
  double field_of_view_deg = 0.0;       // across the larger image side
  int num_pairs = 0;                    // image pairs that were compared
  double unexplained_by_fisheye = 0.0;  // share of the matches
  double unexplained_by_pinhole = 0.0;
};

// Compares, for each camera with unknown intrinsics and a perspective model,
// how many matches between its images two lenses do not explain: a pinhole of
// any focal length (a fundamental matrix) and an equidistant fisheye of the
// best of several fields of view (a relative pose). The camera is a fisheye if
// the fisheye leaves less than 40 % as many matches unexplained, which moderate
// distortion of a perspective lens does not cause. For a camera with the image
// size of a detected fisheye, probably of the same make, a significant
// difference suffices. Cameras with the same result are listed together.
//
// Pairs with SIFT descriptors are matched again in whole, because guided
// matches lie near the epipolar lines of a pinhole.
//
// Cost: a matching and six verifications of up to 20 image pairs per camera.
[[nodiscard]] std::vector<FisheyeFinding> FindFisheyes(
    const FeatureDatabase& database, const Scene& scene,
    const PairMatchingOptions& options, const Context& context);

// One line for users: the finding and its evidence, and what to do about it.
std::string DescribeEvidence(const FisheyeFinding& finding);
std::string Describe(const FisheyeFinding& finding);

// Sets the model OPENCV_FISHEYE without prior focal length, and removes all
// two-view geometries, which were verified with the former models.
void AdoptFisheyes(const std::vector<FisheyeFinding>& findings,
                   const Scene& scene, FeatureDatabase* database);

}  // namespace mgsfm
