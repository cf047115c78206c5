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

// The keypoints that are to show the motion of a pair: in each cell of the
// image, the tenth of the keypoints with the largest scale, which other images
// are most likely to show, too. Cells keep an object with large keypoints in a
// part of the image from outvoting the scene. The indices are ascending.
std::vector<uint32_t> SelectLandmarks(
    const Camera& camera, const std::vector<FeatureKeypoint>& keypoints);

// Matches two images as MatchDescriptors does, but with fewer products.
//
// Landmarks are matched and verified first. If they determine epipolar planes
// (CALIBRATED or UNCALIBRATED pairs), and 80 % of their matches agree, other
// descriptors are compared only if their keypoints may lie in one plane:
// |n2 - n1| <= w1 + w2 with n the azimuth of a plane about the baseline, and
// sin(w) = max_error / sin(angle to the epipole); w1 of uncalibrated pairs is
// stretched as their azimuths are. The keypoints of both images are sorted by
// half-width and azimuth, so that most tiles of products are outside of the
// band. Landmarks are compared with all descriptors: without these rivals, the
// ratio test would accept more ambiguous matches. Otherwise all descriptors are
// compared with all.
//
// The matches are neither verified nor all in the band.
[[nodiscard]] std::vector<Match> MatchGuided(
    const MatchingView& view1, const MatchingView& view2,
    const DescriptorMatchingOptions& matching,
    const TwoViewGeometryOptions& two_view, Random random);

}  // namespace mgsfm
