// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/view_graph/focal_length_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
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

// Six times the 5 degrees of freedom of an essential matrix.
constexpr size_t kMinNumMatches = 30;
// A single pair has one equation for a focal length, and its errors are not
// checked by others.
constexpr int kMinNumPairs = 3;
// Grid of the initial search: 15 factors in geometric progression from 0.4 to
// 2.5, each 1.14 times the one before. Gauss-Newton corrects a remaining error
// of 7 %.
constexpr int kNumFactors = 15;
const double kMaxLogFactor = std::log(2.5);
// An estimate outside of the searched range by more than a fifth diverged.
constexpr double kMaxRelativeLogFactor = 1.2;
// The standard deviation of the logarithm of a guess: lenses of 30 to 120
// degrees are equally usual. A more certain estimate is a better start, though
// it is not accepted.
constexpr double kSigmaOfGuess = 0.4;
// Poses start at those of the previous focal lengths. Steps of 0.2 cross the
// whole range in ten iterations; five halvings leave 3 % of a step.
constexpr int kNumPoseIterations = 5;
constexpr int kMaxNumIterations = 20;
constexpr int kMaxNumHalvings = 5;
// Largest step of a log factor: the derivatives hold for about 20 %.
constexpr double kMaxStep = 0.2;
// A relative change of 1e-5 is 0.01 px at a focal length of 1000 px.
constexpr double kMinStep = 1e-5;
// A check of a focal length need not be accurate.
constexpr double kMinStepOfMeasurement = 3e-2;
// A pair is wrong if its median error exceeds that of most pairs by this
// factor: the medians of right pairs are about equal, as detectors have one
// accuracy.
constexpr double kOutlierFactor = 3.0;
// Lower bound of the keypoint noise; keeps exact (simulated) data from
// rejecting pairs and from zero variances.
constexpr double kMinSigmaPx = 0.05;
// Damping of poses, relative and absolute, which only acts on directions that
// no match determines.
constexpr double kPoseDamping = 1e-9;
// Damping of log factors: one that no pair determines does not change.
constexpr double kFactorDamping = 1e-6;

const char* const kReason =
    "the views of its pairs rotate too little, or their optical axes stay "
    "parallel or in one plane, so that they hardly constrain the focal length";

// The unknown log factors s: one per camera without prior focal length.
struct Unknowns {
  std::vector<int> camera_idxs;               // per unknown
  std::vector<std::optional<int>> of_camera;  // per camera

  size_t size() const { return camera_idxs.size(); }

  // Unknowns of both cameras of a pair; only the first is set if they are one
  // camera.
  std::array<std::optional<int>, 2> OfPair(const FocalPair& pair) const {
    return {of_camera[pair.camera_idx1()],
            pair.camera_idx1() == pair.camera_idx2()
                ? std::nullopt
                : of_camera[pair.camera_idx2()]};
  }
};

// The value of an unknown; zero without one, as the factor is 1.
double ValueOf(const Eigen::VectorXd& s, const std::optional<int>& unknown) {
  return unknown ? s[*unknown] : 0.0;
}

// `include_priors`: also cameras with a prior.
Unknowns FindUnknowns(const Scene& scene, bool include_priors) {
  Unknowns unknowns;
  unknowns.of_camera.resize(scene.cameras.size());
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const Camera& camera = scene.cameras[i];
    const CameraModelInfo& info =
        *FindCameraModel(static_cast<int32_t>(camera.model));
    if ((camera.has_prior_focal_length && !include_priors) ||
        info.focal_length_idxs.empty()) {
      continue;
    }
    unknowns.of_camera[i] = static_cast<int>(unknowns.size());
    unknowns.camera_idxs.push_back(static_cast<int>(i));
  }
  return unknowns;
}

// Selects at most max_num_pairs pairs of each unknown, at equal spacing.
std::vector<FocalPair> SelectPairs(const Scene& scene,
                                   const ViewGraph& view_graph,
                                   const Unknowns& unknowns,
                                   int max_num_pairs) {
  std::vector<std::vector<size_t>> candidates(unknowns.size());
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (pair.matches.size() < kMinNumMatches ||
        pair.config == TwoViewConfig::kDegenerate ||
        pair.config == TwoViewConfig::kWatermark) {
      continue;
    }
    for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
      const auto& unknown =
          unknowns.of_camera[scene.images[image_idx].camera_idx];
      if (unknown) candidates[*unknown].push_back(i);
    }
  }
  std::set<size_t> selected;
  for (std::vector<size_t>& list : candidates) {
    list.erase(std::unique(list.begin(), list.end()), list.end());
    const size_t num_used =
        std::min(list.size(), static_cast<size_t>(max_num_pairs));
    for (size_t k = 0; k < num_used; ++k) {
      selected.insert(list[k * list.size() / num_used]);
    }
  }
  std::vector<FocalPair> pairs;
  for (const size_t i : selected)
    pairs.emplace_back(scene, view_graph.pairs[i]);
  return pairs;
}

// Initializes the poses; drops pairs without.
std::vector<FocalPair> InitializePairs(std::vector<FocalPair> pairs,
                                       const Context& context) {
  Mask has_pose(pairs.size());
  ParallelFor(pairs.size(), context.num_threads, [&](size_t k) {
    Random random(context.random_seed, k);
    pairs[k].SetRays(0.0, 0.0);
    has_pose[k] = pairs[k].Initialize(&random);
    if (has_pose[k]) pairs[k].RefinePose(kNumPoseIterations);
  });
  std::vector<FocalPair> kept;
  for (size_t k = 0; k < pairs.size(); ++k) {
    if (has_pose[k]) kept.push_back(std::move(pairs[k]));
  }
  return kept;
}

// The log factor of one unknown with the lowest cost on the grid, by the pairs
// that depend on no other unknown. Factors are visited outwards from one, and
// each pose starts at that of the factor before.
double SearchLogFactor(const std::vector<FocalPair>& pairs,
                       const Unknowns& unknowns, int c, int num_threads) {
  constexpr int kMiddle = kNumFactors / 2;
  std::vector<std::vector<double>> costs(pairs.size());
  ParallelFor(pairs.size(), num_threads, [&](size_t k) {
    FocalPair pair = pairs[k];
    const std::optional<int> a = unknowns.of_camera[pair.camera_idx1()];
    const std::optional<int> b = unknowns.of_camera[pair.camera_idx2()];
    if ((a != c && b != c) || (a && b && a != b)) return;
    costs[k].resize(kNumFactors);
    for (const int direction : {1, -1}) {
      pair.set_pose(pairs[k].pose());
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
  if (!(sums[best] < sums[kMiddle])) return 0.0;
  return kMaxLogFactor * static_cast<double>(best - kMiddle) / kMiddle;
}

// Sets the rays of all pairs to the log factors and returns the total cost.
double SetLogFactors(const Eigen::VectorXd& s, const Unknowns& unknowns,
                     int num_threads, std::vector<FocalPair>* pairs) {
  std::vector<double> costs(pairs->size());
  ParallelFor(pairs->size(), num_threads, [&](size_t k) {
    FocalPair& pair = (*pairs)[k];
    pair.SetRays(ValueOf(s, unknowns.of_camera[pair.camera_idx1()]),
                 ValueOf(s, unknowns.of_camera[pair.camera_idx2()]));
    costs[k] = pair.Cost();
  });
  double sum = 0.0;
  for (const double cost : costs) sum += cost;
  return sum;
}

// Normal equations of s with the poses eliminated.
struct ReducedEquations {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd outer;                // sum of g g^T over pairs
  std::vector<FocalEquations> of_pair;  // with poses
};

ReducedEquations Reduce(const std::vector<FocalPair>& pairs,
                        const Unknowns& unknowns, int num_threads) {
  ReducedEquations reduced;
  const auto size = static_cast<Eigen::Index>(unknowns.size());
  reduced.hessian.setZero(size, size);
  reduced.outer.setZero(size, size);
  reduced.gradient.setZero(size);
  reduced.of_pair.resize(pairs.size());
  ParallelFor(pairs.size(), num_threads, [&](size_t k) {
    FocalEquations& e = reduced.of_pair[k];
    e = pairs[k].Linearize(/*with_focal_lengths=*/true);
    e.hessian.diagonal().head<5>() *= 1.0 + kPoseDamping;
    e.hessian.diagonal().head<5>().array() += kPoseDamping;
  });
  for (size_t k = 0; k < pairs.size(); ++k) {
    const FocalEquations& e = reduced.of_pair[k];
    const Eigen::Matrix<double, 5, 2> coupling =
        e.hessian.topRightCorner<5, 2>();
    const Eigen::Matrix<double, 5, 2> solved =
        e.hessian.topLeftCorner<5, 5>().ldlt().solve(coupling);
    const Eigen::Matrix2d H =
        e.hessian.bottomRightCorner<2, 2>() - coupling.transpose() * solved;
    const Eigen::Vector2d g =
        e.gradient.tail<2>() - solved.transpose() * e.gradient.head<5>();
    const auto of_pair = unknowns.OfPair(pairs[k]);
    for (int i = 0; i < 2; ++i) {
      if (!of_pair[i]) continue;
      reduced.gradient[*of_pair[i]] += g[i];
      for (int j = 0; j < 2; ++j) {
        if (!of_pair[j]) continue;
        reduced.hessian(*of_pair[i], *of_pair[j]) += H(i, j);
        reduced.outer(*of_pair[i], *of_pair[j]) += g[i] * g[j];
      }
    }
  }
  reduced.hessian.diagonal().array() += kFactorDamping;
  return reduced;
}

// Takes the step, shortened until the cost decreases. Returns false, with
// everything unchanged, if it does not.
bool TryStep(const ReducedEquations& reduced, const Eigen::VectorXd& step,
             const Unknowns& unknowns, int num_threads,
             std::vector<FocalPair>* pairs, Eigen::VectorXd* s) {
  double cost = 0.0;
  std::vector<Rigid3> poses;
  for (const FocalPair& pair : *pairs) {
    cost += pair.Cost();
    poses.push_back(pair.pose());
  }
  double scale = std::min(1.0, kMaxStep / step.cwiseAbs().maxCoeff());
  for (int i = 0; i < kMaxNumHalvings; ++i, scale *= 0.5) {
    for (size_t k = 0; k < pairs->size(); ++k) {
      const FocalEquations& e = reduced.of_pair[k];
      const auto [a, b] = unknowns.OfPair((*pairs)[k]);
      const Eigen::Vector2d ds(ValueOf(step, a), ValueOf(step, b));
      (*pairs)[k].set_pose(poses[k]);
      (*pairs)[k].MovePose(
          -scale *
          e.hessian.topLeftCorner<5, 5>().ldlt().solve(
              e.gradient.head<5>() + e.hessian.topRightCorner<5, 2>() * ds));
    }
    const Eigen::VectorXd candidate = *s + scale * step;
    if (SetLogFactors(candidate, unknowns, num_threads, pairs) < cost) {
      *s = candidate;
      return true;
    }
  }
  for (size_t k = 0; k < pairs->size(); ++k) (*pairs)[k].set_pose(poses[k]);
  SetLogFactors(*s, unknowns, num_threads, pairs);
  return false;
}

// Gauss-Newton in all unknowns, until no log factor changes by `min_step`.
void Refine(const Unknowns& unknowns, double min_step, const Context& context,
            std::vector<FocalPair>* pairs, Eigen::VectorXd* s) {
  if (pairs->empty()) return;
  SetLogFactors(*s, unknowns, context.num_threads, pairs);
  ParallelFor(pairs->size(), context.num_threads,
              [&](size_t k) { (*pairs)[k].RefinePose(kNumPoseIterations); });
  for (int i = 0; i < kMaxNumIterations; ++i) {
    context.CheckInterrupted();
    const ReducedEquations reduced =
        Reduce(*pairs, unknowns, context.num_threads);
    const Eigen::VectorXd step =
        -reduced.hessian.ldlt().solve(reduced.gradient);
    if (!step.allFinite() || step.cwiseAbs().maxCoeff() < min_step) break;
    if (!TryStep(reduced, step, unknowns, context.num_threads, pairs, s)) break;
  }
}

// Drops pairs whose median residual exceeds that of the median pair.
std::vector<FocalPair> DropOutliers(std::vector<FocalPair> pairs) {
  if (pairs.empty()) return pairs;
  std::vector<double> medians;
  for (const FocalPair& pair : pairs) {
    medians.push_back(Median(pair.Residuals()));
  }
  const double max_median =
      kOutlierFactor * std::max(Median(medians), kMinSigmaPx);
  std::vector<FocalPair> kept;
  for (size_t k = 0; k < pairs.size(); ++k) {
    if (medians[k] <= max_median) kept.push_back(std::move(pairs[k]));
  }
  return kept;
}

// Variances of s: the larger of that by the noise of residuals and the sandwich
// estimate; see the header.
Eigen::VectorXd EstimateVariances(const std::vector<FocalPair>& pairs,
                                  const Unknowns& unknowns, int num_threads) {
  std::set<int> images;
  std::vector<double> residuals;
  for (const FocalPair& pair : pairs) {
    const std::vector<double> of_pair = pair.Residuals();
    residuals.insert(residuals.end(), of_pair.begin(), of_pair.end());
    images.insert({pair.image_idx1(), pair.image_idx2()});
  }
  const ReducedEquations reduced = Reduce(pairs, unknowns, num_threads);
  const Eigen::MatrixXd inverse = reduced.hessian.inverse();
  const Eigen::MatrixXd sandwich = inverse * reduced.outer * inverse;
  const double sigma_px =
      std::max(RobustSigma<1>(std::move(residuals)), kMinSigmaPx);
  const double pairs_per_image = 2.0 * static_cast<double>(pairs.size()) /
                                 static_cast<double>(images.size());
  const double variance = sigma_px * sigma_px * std::max(1.0, pairs_per_image);
  return (variance * inverse.diagonal()).cwiseMax(sandwich.diagonal());
}

bool IsDiverged(double s) {
  return std::abs(s) > kMaxRelativeLogFactor * kMaxLogFactor;
}

// Why the estimate is not certain; empty if it is accepted.
std::string RejectionReason(int num_pairs, double s,
                            const std::optional<double>& sigma,
                            double max_sigma) {
  if (num_pairs < kMinNumPairs) {
    return "too few image pairs have a consistent epipolar geometry";
  }
  if (IsDiverged(s)) return kReason;
  if (*sigma <= max_sigma) return "";
  char numbers[96];
  std::snprintf(numbers, sizeof(numbers),
                "relative standard deviation %.3g exceeds %.3g: ", *sigma,
                max_sigma);
  return numbers + std::string(kReason);
}

// Per unknown.
std::vector<int> CountPairs(const std::vector<FocalPair>& pairs,
                            const Unknowns& unknowns) {
  std::vector<int> num_pairs(unknowns.size(), 0);
  for (const FocalPair& pair : pairs) {
    for (const std::optional<int>& unknown : unknowns.OfPair(pair)) {
      if (unknown) ++num_pairs[*unknown];
    }
  }
  return num_pairs;
}

FocalLengthResult MakeResult(const Scene& scene,
                             const std::vector<FocalPair>& pairs,
                             const Unknowns& unknowns, const Eigen::VectorXd& s,
                             double max_sigma, int num_threads) {
  FocalLengthResult result;
  result.cameras = scene.cameras;
  const std::vector<int> num_pairs = CountPairs(pairs, unknowns);
  Eigen::VectorXd variances;
  if (!pairs.empty()) {
    variances = EstimateVariances(pairs, unknowns, num_threads);
  }
  for (size_t c = 0; c < unknowns.size(); ++c) {
    const auto i = static_cast<Eigen::Index>(c);
    const int camera_idx = unknowns.camera_idxs[c];
    const Camera& camera = scene.cameras[camera_idx];
    const CameraModelInfo& info =
        *FindCameraModel(static_cast<int32_t>(camera.model));
    FocalLengthEstimate& estimate = result.estimates.emplace_back();
    estimate.camera_idx = camera_idx;
    estimate.prior_px = camera.params[info.focal_length_idxs.front()];
    estimate.num_pairs = num_pairs[c];
    if (num_pairs[c] > 0) estimate.sigma = std::sqrt(variances[i]);
    estimate.message =
        RejectionReason(num_pairs[c], s[i], estimate.sigma, max_sigma);
    const bool is_accepted = estimate.message.empty();
    if (is_accepted) {
      estimate.estimated_px = std::exp(s[i]) * estimate.prior_px;
    } else if (num_pairs[c] < kMinNumPairs || IsDiverged(s[i]) ||
               !(*estimate.sigma < kSigmaOfGuess)) {
      continue;
    }
    result.cameras[camera_idx] = internal::WithFocalFactor(camera, s[i]);
  }
  return result;
}

}  // namespace

FocalLengthResult CalibrateFocalLengths(const Scene& scene,
                                        const ViewGraph& view_graph,
                                        const FocalLengthOptions& options,
                                        const Context& context) {
  const Unknowns unknowns = FindUnknowns(scene, /*include_priors=*/false);
  if (unknowns.size() == 0) return {scene.cameras, {}};
  std::vector<FocalPair> pairs = InitializePairs(
      SelectPairs(scene, view_graph, unknowns, options.max_num_pairs), context);
  Eigen::VectorXd s(static_cast<Eigen::Index>(unknowns.size()));
  for (Eigen::Index c = 0; c < s.size(); ++c) {
    s[c] = SearchLogFactor(pairs, unknowns, static_cast<int>(c),
                           context.num_threads);
  }
  Refine(unknowns, kMinStep, context, &pairs, &s);
  pairs = DropOutliers(std::move(pairs));
  Refine(unknowns, kMinStep, context, &pairs, &s);
  return MakeResult(scene, pairs, unknowns, s, options.max_sigma,
                    context.num_threads);
}

std::vector<FocalLengthMeasurement> MeasureFocalLengths(
    const Scene& scene, const ViewGraph& view_graph, int max_num_pairs,
    const Context& context) {
  const Unknowns unknowns = FindUnknowns(scene, /*include_priors=*/true);
  if (unknowns.size() == 0) return {};
  std::vector<FocalPair> pairs = InitializePairs(
      SelectPairs(scene, view_graph, unknowns, max_num_pairs), context);
  Eigen::VectorXd s =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(unknowns.size()));
  Refine(unknowns, kMinStepOfMeasurement, context, &pairs, &s);
  pairs = DropOutliers(std::move(pairs));
  Refine(unknowns, kMinStepOfMeasurement, context, &pairs, &s);
  if (pairs.empty()) return {};
  const Eigen::VectorXd variances =
      EstimateVariances(pairs, unknowns, context.num_threads);
  const std::vector<int> num_pairs = CountPairs(pairs, unknowns);
  std::vector<FocalLengthMeasurement> measured;
  for (size_t c = 0; c < unknowns.size(); ++c) {
    const auto i = static_cast<Eigen::Index>(c);
    if (num_pairs[c] < kMinNumPairs) continue;
    measured.push_back(
        {unknowns.camera_idxs[c], s[i], std::sqrt(variances[i]), num_pairs[c]});
  }
  return measured;
}

ViewGraph DropUncalibratedGeometry(const Scene& scene,
                                   const ViewGraph& view_graph) {
  const auto is_calibrated = [&](int image_idx) {
    return scene.cameras[scene.images[image_idx].camera_idx]
        .has_prior_focal_length;
  };
  ViewGraph kept = view_graph;
  for (ImagePair& pair : kept.pairs) {
    if (is_calibrated(pair.image_idx1) && is_calibrated(pair.image_idx2)) {
      continue;
    }
    pair.E.reset();
    pair.relative_pose.reset();
  }
  return kept;
}

}  // namespace mgsfm
