// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/view_graph/focal_length_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>
#include <utility>

#include "base/parallel.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "view_graph/focal_pair.h"

namespace mgsfm {
namespace {

using internal::FocalEquations;
using internal::FocalPair;

constexpr size_t kMinNumMatches = 30;
constexpr int kMinNumPairs = 3;
constexpr int kNumFactors = 15;
const double kMaxLogFactor = std::log(2.5);
constexpr int kNumPoseIterations = 5;
constexpr int kMaxNumIterations = 20;
constexpr int kMaxNumHalvings = 5;
constexpr double kMaxStep = 0.2;
constexpr double kMinStep = 1e-5;
constexpr double kOutlierFactor = 3.0;
// Median of |x| of a standard normal.
constexpr double kMinSigmaPx = 0.05;

const char* const kReason =
    "the views of its pairs turn too little, or their axes stay parallel or in "
    "one plane, which tells little of the focal length";

class FocalLengthCalibrator {
 public:
  FocalLengthCalibrator(const Scene& scene, const ViewGraph& view_graph,
                        const FocalLengthOptions& options,
                        const Context& context)
      : scene_(scene),
        view_graph_(view_graph),
        options_(options),
        context_(context),
        unknown_of_camera_(scene.cameras.size(), -1) {
    result_.cameras = scene.cameras;
  }

  FocalLengthResult Run() {
    ListUnknowns();
    if (cameras_.empty()) return std::move(result_);
    SelectPairs();
    StartPairs();
    for (size_t c = 0; c < cameras_.size(); ++c) SearchFactor(c);
    Refine();
    DropOutliers();
    Refine();
    Judge();
    return std::move(result_);
  }

 private:
  // What all pairs say of s, with their poses eliminated.
  struct Reduced {
    Eigen::MatrixXd hessian;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd outer;  // sum of gradient x gradient over pairs
    std::vector<FocalEquations> of_pair;
  };

  void ListUnknowns();
  void SelectPairs();
  void StartPairs();
  void SearchFactor(size_t unknown);
  void Refine();
  void DropOutliers();
  void Judge();
  std::string Verdict(size_t unknown, double sigma) const;
  Reduced Reduce() const;
  bool TryStep(const Reduced& reduced, const Eigen::VectorXd& step);
  double SetFactors(const Eigen::VectorXd& s);
  // The unknowns of a pair, -1: known; the second is -1 if they are the same.
  std::pair<int, int> UnknownsOf(const FocalPair& pair) const {
    const int a = unknown_of_camera_[pair.camera_idx1()];
    const int b = unknown_of_camera_[pair.camera_idx2()];
    return {a, pair.camera_idx1() == pair.camera_idx2() ? -1 : b};
  }
  double FactorOf(int camera_idx) const {
    const int unknown = unknown_of_camera_[camera_idx];
    return unknown < 0 ? 0.0 : s_[unknown];
  }

  const Scene& scene_;
  const ViewGraph& view_graph_;
  const FocalLengthOptions& options_;
  const Context& context_;
  std::vector<int> cameras_;  // of the unknowns
  std::vector<int> unknown_of_camera_;
  std::vector<FocalPair> pairs_;
  Eigen::VectorXd s_;
  FocalLengthResult result_;
};

void FocalLengthCalibrator::ListUnknowns() {
  for (size_t i = 0; i < scene_.cameras.size(); ++i) {
    const Camera& camera = scene_.cameras[i];
    const CameraModelInfo& info =
        *FindCameraModel(static_cast<int32_t>(camera.model));
    if (camera.has_prior_focal_length || info.focal_length_idxs.empty()) {
      continue;
    }
    unknown_of_camera_[i] = static_cast<int>(cameras_.size());
    cameras_.push_back(static_cast<int>(i));
    FocalLengthEstimate estimate;
    estimate.camera_idx = static_cast<int>(i);
    estimate.prior_px = camera.params[info.focal_length_idxs.front()];
    result_.estimates.push_back(estimate);
  }
  s_ = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(cameras_.size()));
}

void FocalLengthCalibrator::SelectPairs() {
  std::vector<std::vector<size_t>> candidates(cameras_.size());
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    const ImagePair& pair = view_graph_.pairs[i];
    if (pair.matches.size() < kMinNumMatches ||
        pair.config == TwoViewConfig::kDegenerate ||
        pair.config == TwoViewConfig::kWatermark) {
      continue;
    }
    for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
      const int c = unknown_of_camera_[scene_.images[image_idx].camera_idx];
      if (c >= 0) candidates[c].push_back(i);
    }
  }
  std::set<size_t> selected;
  for (std::vector<size_t>& list : candidates) {
    list.erase(std::unique(list.begin(), list.end()), list.end());
    const size_t num_used =
        std::min(list.size(), static_cast<size_t>(options_.max_num_pairs));
    for (size_t k = 0; k < num_used; ++k) {
      selected.insert(list[k * list.size() / num_used]);
    }
  }
  for (const size_t i : selected) {
    pairs_.emplace_back(scene_, view_graph_.pairs[i]);
  }
}

void FocalLengthCalibrator::StartPairs() {
  Mask has_start(pairs_.size());
  ParallelFor(pairs_.size(), context_.num_threads, [&](size_t k) {
    Random random(context_.random_seed, k);
    pairs_[k].SetRays(0.0, 0.0);
    has_start[k] = pairs_[k].Start(&random);
    if (has_start[k]) pairs_[k].RefinePose(kNumPoseIterations);
  });
  std::vector<FocalPair> kept;
  for (size_t k = 0; k < pairs_.size(); ++k) {
    if (has_start[k]) kept.push_back(std::move(pairs_[k]));
  }
  pairs_ = std::move(kept);
}

// Factors are visited outwards from one, each pose going on from that before.
void FocalLengthCalibrator::SearchFactor(size_t unknown) {
  const int c = static_cast<int>(unknown);
  constexpr int kMiddle = kNumFactors / 2;
  std::vector<std::vector<double>> costs(pairs_.size());
  ParallelFor(pairs_.size(), context_.num_threads, [&](size_t k) {
    FocalPair pair = pairs_[k];
    const int a = unknown_of_camera_[pair.camera_idx1()];
    const int b = unknown_of_camera_[pair.camera_idx2()];
    if ((a != c && b != c) || (a >= 0 && b >= 0 && a != b)) return;
    costs[k].resize(kNumFactors);
    for (const int direction : {1, -1}) {
      pair.set_pose(pairs_[k].pose());
      for (int i = kMiddle; i >= 0 && i < kNumFactors; i += direction) {
        const double s = kMaxLogFactor * (i - kMiddle) / kMiddle;
        pair.SetRays(a == c ? s : 0.0, b == c ? s : 0.0);
        costs[k][i] = pair.RefinePose(kNumPoseIterations);
      }
    }
  });
  std::vector<double> sums(kNumFactors, 0.0);
  for (const std::vector<double>& of_pair : costs) {
    for (size_t i = 0; i < of_pair.size(); ++i) sums[i] += of_pair[i];
  }
  const auto best = std::min_element(sums.begin(), sums.end()) - sums.begin();
  if (sums[best] < sums[kMiddle]) {
    s_[c] = kMaxLogFactor * static_cast<double>(best - kMiddle) / kMiddle;
  }
}

double FocalLengthCalibrator::SetFactors(const Eigen::VectorXd& s) {
  s_ = s;
  std::vector<double> costs(pairs_.size());
  ParallelFor(pairs_.size(), context_.num_threads, [&](size_t k) {
    pairs_[k].SetRays(FactorOf(pairs_[k].camera_idx1()),
                      FactorOf(pairs_[k].camera_idx2()));
    costs[k] = pairs_[k].Cost();
  });
  double sum = 0.0;
  for (const double cost : costs) sum += cost;
  return sum;
}

FocalLengthCalibrator::Reduced FocalLengthCalibrator::Reduce() const {
  Reduced reduced;
  const Eigen::Index size = s_.size();
  reduced.hessian.setZero(size, size);
  reduced.outer.setZero(size, size);
  reduced.gradient.setZero(size);
  reduced.of_pair.resize(pairs_.size());
  ParallelFor(pairs_.size(), context_.num_threads, [&](size_t k) {
    FocalEquations& e = reduced.of_pair[k];
    e = pairs_[k].Linearize(/*with_focal_lengths=*/true);
    e.hessian.diagonal().head<5>() *= 1.0 + 1e-9;
    e.hessian.diagonal().head<5>().array() += 1e-9;
  });
  for (size_t k = 0; k < pairs_.size(); ++k) {
    const FocalEquations& e = reduced.of_pair[k];
    const Eigen::Matrix<double, 5, 2> coupling =
        e.hessian.topRightCorner<5, 2>();
    const Eigen::Matrix<double, 5, 2> solved =
        e.hessian.topLeftCorner<5, 5>().ldlt().solve(coupling);
    const Eigen::Matrix2d H =
        e.hessian.bottomRightCorner<2, 2>() - coupling.transpose() * solved;
    const Eigen::Vector2d g =
        e.gradient.tail<2>() - solved.transpose() * e.gradient.head<5>();
    const auto [a, b] = UnknownsOf(pairs_[k]);
    const int unknowns[2] = {a, b};
    for (int i = 0; i < 2; ++i) {
      if (unknowns[i] < 0) continue;
      reduced.gradient[unknowns[i]] += g[i];
      for (int j = 0; j < 2; ++j) {
        if (unknowns[j] < 0) continue;
        reduced.hessian(unknowns[i], unknowns[j]) += H(i, j);
        reduced.outer(unknowns[i], unknowns[j]) += g[i] * g[j];
      }
    }
  }
  // What no pair tells stays where it is.
  reduced.hessian.diagonal().array() += 1e-6;
  return reduced;
}

bool FocalLengthCalibrator::TryStep(const Reduced& reduced,
                                    const Eigen::VectorXd& step) {
  const Eigen::VectorXd before = s_;
  double cost = 0.0;
  for (const FocalPair& pair : pairs_) cost += pair.Cost();
  std::vector<Rigid3> poses;
  for (const FocalPair& pair : pairs_) poses.push_back(pair.pose());
  double scale = std::min(1.0, kMaxStep / step.cwiseAbs().maxCoeff());
  for (int i = 0; i < kMaxNumHalvings; ++i, scale *= 0.5) {
    for (size_t k = 0; k < pairs_.size(); ++k) {
      const FocalEquations& e = reduced.of_pair[k];
      const auto [a, b] = UnknownsOf(pairs_[k]);
      const Eigen::Vector2d ds(a < 0 ? 0.0 : step[a], b < 0 ? 0.0 : step[b]);
      pairs_[k].set_pose(poses[k]);
      pairs_[k].MovePose(-scale * e.hessian.topLeftCorner<5, 5>().ldlt().solve(
                                      e.gradient.head<5>() +
                                      e.hessian.topRightCorner<5, 2>() * ds));
    }
    if (SetFactors(before + scale * step) < cost) return true;
  }
  for (size_t k = 0; k < pairs_.size(); ++k) pairs_[k].set_pose(poses[k]);
  SetFactors(before);
  return false;
}

void FocalLengthCalibrator::Refine() {
  if (pairs_.empty()) return;
  SetFactors(s_);
  ParallelFor(pairs_.size(), context_.num_threads,
              [&](size_t k) { pairs_[k].RefinePose(kNumPoseIterations); });
  for (int i = 0; i < kMaxNumIterations; ++i) {
    context_.CheckInterrupted();
    const Reduced reduced = Reduce();
    const Eigen::VectorXd step =
        -reduced.hessian.ldlt().solve(reduced.gradient);
    if (!step.allFinite() || step.cwiseAbs().maxCoeff() < kMinStep) break;
    if (!TryStep(reduced, step)) break;
  }
}

void FocalLengthCalibrator::DropOutliers() {
  if (pairs_.empty()) return;
  std::vector<double> medians;
  for (const FocalPair& pair : pairs_) {
    medians.push_back(Median(pair.Residuals()));
  }
  const double most = kOutlierFactor * std::max(Median(medians), kMinSigmaPx);
  std::vector<FocalPair> kept;
  for (size_t k = 0; k < pairs_.size(); ++k) {
    if (medians[k] <= most) kept.push_back(std::move(pairs_[k]));
  }
  pairs_ = std::move(kept);
}

std::string FocalLengthCalibrator::Verdict(size_t unknown, double sigma) const {
  char numbers[96];
  if (result_.estimates[unknown].num_pairs < kMinNumPairs) {
    return "too few image pairs agree on an epipolar geometry";
  }
  if (std::abs(s_[unknown]) > 1.2 * kMaxLogFactor) {
    return kReason;
  }
  if (sigma <= options_.max_sigma) return "";
  std::snprintf(numbers, sizeof(numbers),
                "relative standard deviation %.3g, more than %.3g: ", sigma,
                options_.max_sigma);
  return numbers + std::string(kReason);
}

void FocalLengthCalibrator::Judge() {
  std::set<int> images;
  std::vector<double> residuals;
  for (const FocalPair& pair : pairs_) {
    const std::vector<double> of_pair = pair.Residuals();
    residuals.insert(residuals.end(), of_pair.begin(), of_pair.end());
    images.insert({pair.image_idx1(), pair.image_idx2()});
    const std::set<int> unknowns = {unknown_of_camera_[pair.camera_idx1()],
                                    unknown_of_camera_[pair.camera_idx2()]};
    for (const int unknown : unknowns) {
      if (unknown >= 0) ++result_.estimates[unknown].num_pairs;
    }
  }
  Eigen::MatrixXd inverse, sandwich;
  double variance = 0.0;
  if (!pairs_.empty()) {
    const Reduced reduced = Reduce();
    inverse = reduced.hessian.inverse();
    sandwich = inverse * reduced.outer * inverse;
    const double sigma_px =
        std::max(RobustSigma<1>(std::move(residuals)), kMinSigmaPx);
    const double pairs_per_image = 2.0 * static_cast<double>(pairs_.size()) /
                                   static_cast<double>(images.size());
    variance = sigma_px * sigma_px * std::max(1.0, pairs_per_image);
  }
  for (size_t c = 0; c < cameras_.size(); ++c) {
    FocalLengthEstimate& estimate = result_.estimates[c];
    if (estimate.num_pairs > 0) {
      const auto i = static_cast<Eigen::Index>(c);
      estimate.sigma =
          std::sqrt(std::max(variance * inverse(i, i), sandwich(i, i)));
    }
    estimate.message = Verdict(c, estimate.sigma);
    if (!estimate.message.empty()) continue;
    estimate.estimated_px = std::exp(s_[c]) * estimate.prior_px;
    result_.cameras[cameras_[c]] =
        internal::WithFocalFactor(scene_.cameras[cameras_[c]], s_[c]);
  }
}

}  // namespace

FocalLengthResult CalibrateFocalLengths(const Scene& scene,
                                        const ViewGraph& view_graph,
                                        const FocalLengthOptions& options,
                                        const Context& context) {
  return FocalLengthCalibrator(scene, view_graph, options, context).Run();
}

ViewGraph DropCalibratedGeometry(const Scene& scene,
                                 const FocalLengthResult& focal_lengths,
                                 const ViewGraph& view_graph) {
  Mask is_changed(scene.cameras.size(), false);
  for (const FocalLengthEstimate& estimate : focal_lengths.estimates) {
    if (estimate.estimated_px) is_changed[estimate.camera_idx] = true;
  }
  ViewGraph kept = view_graph;
  for (ImagePair& pair : kept.pairs) {
    if (!is_changed[scene.images[pair.image_idx1].camera_idx] &&
        !is_changed[scene.images[pair.image_idx2].camera_idx]) {
      continue;
    }
    pair.E.reset();
    pair.relative_pose.reset();
  }
  return kept;
}

}  // namespace mgsfm
