// SPDX-License-Identifier: BSD-3-Clause
#include "video/motion_sampler.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/ranges.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Displacements of a few per cent are ten pixels at this size.
constexpr int kMotionSizePx = 320;
// Bounds the cost; the median of 80 displacements is accurate to 0.14 of their
// standard deviation.
constexpr int kMaxNumPatches = 80;
// Patches of 15 x 15 pixels, 5 % of the image: large enough to be distinct, and
// small enough to move as one.
constexpr int kPatchRadiusPx = 7;
// The median of ten displacements is accurate to 0.4 of their standard
// deviation.
constexpr size_t kMinNumPatches = 10;
// Correlation of the same patch in two images; unrelated patches are below 0.7.
constexpr double kMinCorrelation = 0.8;
// Motion of the last candidate, relative to that of the first. With eight
// images per min_motion, the selected one is sharper than 83 % of all, and
// neighbors are 1.25 min_motion apart on average (docs/results/constants.md).
constexpr double kWindow = 1.5;
// A camera that stops within the window is also sampled after this many
// candidates: two seconds at 30 Hz.
constexpr size_t kMaxNumCandidates = 60;

cv::Mat Reduce(const cv::Mat& gray) {
  const int larger = std::max(gray.cols, gray.rows);
  if (larger <= kMotionSizePx) return gray.clone();
  const double scale = static_cast<double>(kMotionSizePx) / larger;
  cv::Mat small;
  cv::resize(gray, small, cv::Size(), scale, scale, cv::INTER_AREA);
  return small;
}

// Mean squared gradient.
double SharpnessOf(const cv::Mat& gray) {
  cv::Mat dx, dy;
  cv::Sobel(gray, dx, CV_32F, 1, 0);
  cv::Sobel(gray, dy, CV_32F, 0, 1);
  return (dx.dot(dx) + dy.dot(dy)) / static_cast<double>(gray.total());
}

std::vector<cv::Point> FindPatches(const cv::Mat& small) {
  // Relative to the strongest corner, as in OpenCV's examples; weak corners are
  // better than none, and the correlation rejects ambiguous ones.
  constexpr double kMinQuality = 0.01;
  // Patches share at most a third of their area.
  constexpr double kMinDistancePx = 10.0;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(small, corners, kMaxNumPatches, kMinQuality,
                          kMinDistancePx);
  const cv::Rect inside(kPatchRadiusPx, kPatchRadiusPx,
                        small.cols - 2 * kPatchRadiusPx,
                        small.rows - 2 * kPatchRadiusPx);
  std::vector<cv::Point> patches;
  for (const cv::Point2f& corner : corners) {
    const cv::Point center(cvRound(corner.x), cvRound(corner.y));
    if (inside.contains(center)) patches.push_back(center);
  }
  return patches;
}

cv::Rect Around(const cv::Point& center, int radius_px) {
  return {center.x - radius_px, center.y - radius_px, 2 * radius_px + 1,
          2 * radius_px + 1};
}

// The displacement of a patch; nullopt if it is not found.
std::optional<double> DisplacementPx(const cv::Mat& from, const cv::Mat& to,
                                     const cv::Point& center, int search_px) {
  const cv::Rect window =
      Around(center, kPatchRadiusPx + search_px) & cv::Rect({0, 0}, to.size());
  const cv::Mat patch = from(Around(center, kPatchRadiusPx));
  cv::Mat correlation;
  cv::matchTemplate(to(window), patch, correlation, cv::TM_CCOEFF_NORMED);
  double best = 0.0;
  cv::Point place;
  cv::minMaxLoc(correlation, nullptr, &best, nullptr, &place);
  if (!(best >= kMinCorrelation)) return std::nullopt;
  const cv::Point moved =
      place + window.tl() + cv::Point(kPatchRadiusPx, kPatchRadiusPx) - center;
  return std::hypot(moved.x, moved.y);
}

}  // namespace

MotionSampler::MotionSampler(double min_motion) : min_motion_(min_motion) {
  MGSFM_CHECK(min_motion > 0.0);
}

void MotionSampler::Add(int idx, const cv::Mat& gray) {
  const Frame frame{idx, Reduce(gray), SharpnessOf(gray)};
  if (selected_.empty()) {
    Select(frame);
  } else {
    Process(frame);
  }
}

std::vector<int> MotionSampler::Finish() {
  while (!candidates_.empty()) SelectSharpestCandidate();
  return std::move(selected_);
}

// nullopt if most patches are lost because the motion is too large.
std::optional<double> MotionSampler::MotionOf(const Frame& frame) const {
  const bool has_patches = patches_.size() >= kMinNumPatches;
  if (!has_patches) {
    // Motion is not visible in an image without texture.
    if (FindPatches(frame.small).size() < kMinNumPatches) return 0.0;
    return std::nullopt;
  }
  const int size_px = std::max(frame.small.cols, frame.small.rows);
  const int search_px =
      static_cast<int>(std::ceil(kWindow * min_motion_ * size_px)) + 1;
  std::vector<double> moves_px;
  for (const cv::Point& patch : patches_) {
    const auto move_px =
        DisplacementPx(reference_, frame.small, patch, search_px);
    if (move_px) moves_px.push_back(*move_px);
  }
  if (2 * moves_px.size() < patches_.size()) return std::nullopt;
  return UpperMedian(moves_px) / size_px;
}

void MotionSampler::Process(const Frame& frame) {
  const std::optional<double> motion = MotionOf(frame);
  if (motion && *motion < min_motion_) return;
  const bool is_candidate = motion && *motion <= kWindow * min_motion_;
  if (is_candidate) {
    candidates_.push_back(frame);
    if (candidates_.size() < kMaxNumCandidates) return;
    SelectSharpestCandidate();
  } else if (candidates_.empty()) {
    Select(frame);
  } else {
    SelectSharpestCandidate();
    Process(frame);
  }
}

void MotionSampler::SelectSharpestCandidate() {
  const auto sharpest = std::max_element(
      candidates_.begin(), candidates_.end(),
      [](const Frame& a, const Frame& b) { return a.sharpness < b.sharpness; });
  const Frame frame = *sharpest;
  const std::vector<Frame> later(sharpest + 1, candidates_.end());
  candidates_.clear();
  Select(frame);
  for (const Frame& next : later) Process(next);
}

void MotionSampler::Select(const Frame& frame) {
  selected_.push_back(frame.idx);
  reference_ = frame.small;
  patches_ = FindPatches(reference_);
}

}  // namespace mgsfm
