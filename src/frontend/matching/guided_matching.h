// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "base/random.h"
#include "matching/descriptor_matching.h"
#include "matching/two_view_verification.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// One image of a pair to match. Refers to data that must outlive it.
struct MatchingView {
  VerificationView geometry;
  DescriptorView descriptors;
  const std::vector<uint32_t>* landmarks = nullptr;  // ascending
};

// The keypoints that show the motion of a pair: in each cell of the image, the
// tenth of the largest scale, which other images are most likely to show, too.
// Cells keep an object that fills the image with large keypoints from outvoting
// the scene. Ascending.
std::vector<uint32_t> SelectLandmarks(
    const Camera& camera, const std::vector<FeatureKeypoint>& keypoints);

// Matches two images as MatchDescriptors does, but with fewer products.
//
// Landmarks are matched and verified first. If most of their matches agree with
// one motion, other descriptors are compared only if their keypoints may lie in
// one epipolar plane: |n2 - n1| <= w1 + w2 with n the azimuth of a plane about
// the baseline, and sin(w) = max_error / sin(angle to the epipole). The
// keypoints of both images are sorted by azimuth, so that nearly all tiles of
// products are outside of the band. Landmarks are compared with all
// descriptors: without these rivals, the ratio test would accept more ambiguous
// matches. Without such a motion, all descriptors are compared.
//
// The matches are neither verified nor all in the band.
[[nodiscard]] std::vector<Match> MatchGuided(
    const MatchingView& view1, const MatchingView& view2,
    const DescriptorMatchingOptions& matching,
    const TwoViewGeometryOptions& two_view, Random random);

}  // namespace mgsfm
