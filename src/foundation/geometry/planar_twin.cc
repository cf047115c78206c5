// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "base/ranges.h"
#include "geometry/epipolar.h"

namespace mgsfm {
namespace {

// A share of half is known to 5 % by a hundred matches. On every third EuRoC
// key frame, 50 and 1,000 give the same errors, and so do 4 iterations below.
constexpr size_t kMaxNumSamples = 100;
constexpr int kNumIterations = 8;

// The distance, along the epipolar line, between a ray of camera 2 and the
// image of its match by the plane n . x1 = 1:
//   error(n) = (offset + slope f1 . n) / |a + t (f1 . n)|,  a = R f1.
struct PlaneTerms {
  PlaneTerms(const Rigid3& pose, const Eigen::Vector3d& ray1,
             const Eigen::Vector3d& ray2)
      : f1(ray1), a(pose.rotation * ray1) {
    const Eigen::Vector3d across =
        pose.translation - ray2.dot(pose.translation) * ray2;
    slope = across.norm();
    offset = slope > 0.0 ? a.dot(across) / slope : 0.0;
  }
  double InverseLength(const Eigen::Vector3d& t,
                       const Eigen::Vector3d& plane) const {
    return 1.0 / (a + f1.dot(plane) * t).norm();
  }

  Eigen::Vector3d f1, a;
  double slope = 0.0, offset = 0.0;
};

// Matches at equal intervals, so that all regions of the image count.
std::vector<PlaneTerms> Sample(const RayMatches& matches, const Rigid3& pose) {
  const size_t num_samples = std::min(matches.size(), kMaxNumSamples);
  std::vector<PlaneTerms> samples;
  samples.reserve(num_samples);
  for (size_t k = 0; k < num_samples; ++k) {
    const size_t i = k * matches.size() / num_samples;
    samples.emplace_back(pose, matches.rays1[i], matches.rays2[i]);
  }
  return samples;
}

std::vector<double> Errors(const std::vector<PlaneTerms>& samples,
                           const Eigen::Vector3d& t,
                           const Eigen::Vector3d& plane) {
  return Transformed(samples, [&](const PlaneTerms& terms) {
    return std::abs(terms.offset + terms.slope * terms.f1.dot(plane)) *
           terms.InverseLength(t, plane);
  });
}

// The plane of most samples: re-weighted least squares with the Cauchy loss,
// whose scale follows the median error down to `min_scale`.
Eigen::Vector3d FitPlane(const std::vector<PlaneTerms>& samples,
                         const Eigen::Vector3d& t, double min_scale) {
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();
  std::vector<double> errors = Errors(samples, t, plane);
  double scale = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < kNumIterations; ++iteration) {
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (size_t k = 0; k < samples.size(); ++k) {
      const PlaneTerms& terms = samples[k];
      const double ratio = errors[k] / scale;
      const double inverse_length = terms.InverseLength(t, plane);
      const double weight =
          inverse_length * inverse_length / (1.0 + ratio * ratio);
      const Eigen::Vector3d row = terms.slope * terms.f1;
      A += weight * row * row.transpose();
      b -= weight * terms.offset * row;
    }
    plane = A.ldlt().solve(b);
    errors = Errors(samples, t, plane);
    scale = std::max(UpperMedian(errors), min_scale);
  }
  return plane;
}

}  // namespace

std::optional<Rigid3> PlanarTwin(const RayMatches& matches,
                                 const Rigid3& cam2_from_cam1,
                                 double max_error_rad) {
  if (matches.size() == 0) return std::nullopt;
  const auto& [R, t] = cam2_from_cam1;
  const std::vector<PlaneTerms> samples = Sample(matches, cam2_from_cam1);
  // A tenth of the threshold is below the noise of keypoints.
  const Eigen::Vector3d plane = FitPlane(samples, t, 0.1 * max_error_rad);
  if (!plane.allFinite()) return std::nullopt;
  const std::vector<double> errors = Errors(samples, t, plane);
  const auto num_on_plane =
      CountIf(errors, [&](double error) { return error <= max_error_rad; });
  if (2 * static_cast<size_t>(num_on_plane) <= samples.size()) {
    return std::nullopt;
  }
  std::optional<Rigid3> twin;
  double least = std::numeric_limits<double>::infinity();
  for (const PlanarMotion& motion :
       DecomposeHomography(R.toRotationMatrix() + t * plane.transpose())) {
    const Rigid3& other = motion.cam2_from_cam1;
    if (other.rotation.angularDistance(R) <= max_error_rad) continue;
    const double cost = ScoreRelativePose(matches, other, max_error_rad).cost;
    if (!(cost < least)) continue;  // or not a number
    least = cost;
    twin = {other.rotation, other.translation.normalized()};
  }
  return twin;
}

}  // namespace mgsfm
