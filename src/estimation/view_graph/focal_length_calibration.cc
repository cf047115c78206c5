// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/view_graph/focal_length_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include "base/format.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "scene/observations.h"
#include "view_graph/focal_pair.h"

namespace mgsfm {
namespace {

using internal::FocalEquations;
using internal::FocalPair;
using internal::LensOffset;

// A single pair has one equation for a focal length, and no other pair checks
// its errors.
constexpr int kMinNumPairs = 3;
// Six times the 5 degrees of freedom of an essential matrix.
constexpr size_t kMinNumMatches = 30;
// Grid of the initial search: 15 factors in geometric progression from 0.4 to
// 2.5, each 1.14 times the previous one. Gauss-Newton corrects a remaining
// error of 7 %.
constexpr int kNumFactors = 15;
// Distortions of the initial search, at the corner of the image: wide lenses
// have -0.3.
constexpr std::array<double, 4> kDistortions = {0.0, -0.15, -0.3, 0.1};
// Standard deviation of distortions. Known ones are constant.
constexpr double kSigmaOfDistortion = 0.2;
constexpr double kSigmaOfConstant = 1e-6;
// An estimate that exceeds the searched range by more than a fifth has
// diverged.
constexpr double kMaxRelativeLogFactor = 1.2;
// The relative error that all pairs of a camera share: the root mean square
// error of pairs on recorded rigs whose motion determines focal lengths.
constexpr double kSharedSigma = 0.02;
// Poses start at their values for the previous focal lengths. Steps of 0.2
// cross the whole range in ten iterations; five halvings leave 3 % of a step.
constexpr int kNumPoseIterations = 5;
// Small compared with the standard deviations from pairs; the result only
// initializes reconstructions.
constexpr double kMinStep = 1e-3;
// Checking a focal length requires less accuracy.
constexpr double kMinStepOfMeasurement = 3e-2;
// A pair is wrong if its median error exceeds the median over pairs by this
// factor. Correct pairs have about equal medians, because detectors have one
// accuracy.
constexpr double kOutlierFactor = 3.0;
// Damping of poses, relative and absolute, which only acts on directions that
// no match determines.
constexpr double kPoseDamping = 1e-9;

const char* const kReason =
    "the views of its pairs rotate too little, or their optical axes stay "
    "parallel or in one plane, so that they hardly constrain the focal length";

// The unknown lenses s: four elements per camera without prior focal length.
constexpr int kLensSize = LensOffset::SizeAtCompileTime;

struct Unknowns {
  std::vector<int> camera_idxs;                 // per unknown
  std::vector<std::optional<int>> of_camera;    // per camera
  std::vector<Camera> cameras;                  // of the scene, in their model
  LensOffset information = LensOffset::Zero();  // of the prior of a lens

  size_t size() const { return camera_idxs.size(); }

  // Unknowns of both cameras of a pair; only the first is set if the pair has
  // one camera.
  std::array<std::optional<int>, 2> OfPair(const FocalPair& pair) const {
    return {of_camera[pair.camera_idx1()],
            pair.camera_idx1() == pair.camera_idx2()
                ? std::nullopt
                : of_camera[pair.camera_idx2()]};
  }
};

// The value of an unknown; zero if there is none.
LensOffset ValueOf(const Eigen::VectorXd& s,
                   const std::optional<int>& unknown) {
  return unknown ? LensOffset(s.segment<kLensSize>(kLensSize * *unknown))
                 : LensOffset::Zero();
}

// The cost of the prior.
double CostOfPrior(const Eigen::VectorXd& s, const Unknowns& unknowns) {
  double cost = 0.0;
  for (int c = 0; c < static_cast<int>(unknowns.size()); ++c) {
    cost += 0.5 * ValueOf(s, c).cwiseAbs2().dot(unknowns.information);
  }
  return cost;
}

// `include_priors`: also include cameras with a prior.
Unknowns FindUnknowns(const Scene& scene, bool include_priors) {
  Unknowns unknowns;
  unknowns.of_camera.resize(scene.cameras.size());
  unknowns.cameras = scene.cameras;
  const double sigma_of_center =
      include_priors ? kSigmaOfConstant : kSigmaOfPrincipalPoint;
  const LensOffset sigmas(
      1.0, include_priors ? kSigmaOfConstant : kSigmaOfDistortion,
      sigma_of_center, sigma_of_center);
  unknowns.information = sigmas.cwiseAbs2().cwiseInverse();
  unknowns.information[0] = 0.0;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const Camera& camera = scene.cameras[i];
    const CameraModelInfo& info = InfoOf(camera.model);
    if ((camera.has_prior_focal_length && !include_priors) ||
        info.focal_length_idxs.empty()) {
      continue;
    }
    unknowns.of_camera[i] = static_cast<int>(unknowns.size());
    unknowns.camera_idxs.push_back(static_cast<int>(i));
    if (!include_priors && camera.model == CameraModelId::kSimpleRadial &&
        camera.params[3] == 0.0) {
      unknowns.cameras[i].model = CameraModelId::kSimpleDivision;
    }
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
    pairs.emplace_back(scene, unknowns.cameras, view_graph.pairs[i]);
  return pairs;
}

// Initializes the poses; drops pairs for which this fails.
std::vector<FocalPair> InitializePairs(std::vector<FocalPair> pairs,
                                       const Context& context) {
  Mask has_pose(pairs.size());
  ParallelFor(pairs.size(), context.num_threads, [&](size_t k) {
    Random random(context.random_seed, k);
    pairs[k].SetRays(LensOffset::Zero(), LensOffset::Zero());
    has_pose[k] = pairs[k].Initialize(&random);
    if (has_pose[k]) pairs[k].RefinePose(kNumPoseIterations);
  });
  std::vector<FocalPair> kept;
  for (size_t k = 0; k < pairs.size(); ++k) {
    if (has_pose[k]) kept.push_back(std::move(pairs[k]));
  }
  return kept;
}

// The pairs that depend on no unknown other than c, at equal spacing.
std::vector<size_t> SelectSearchPairs(const std::vector<FocalPair>& pairs,
                                      const Unknowns& unknowns, int c) {
  std::vector<size_t> selected;
  for (size_t k = 0; k < pairs.size(); ++k) {
    const std::optional<int> a = unknowns.of_camera[pairs[k].camera_idx1()];
    const std::optional<int> b = unknowns.of_camera[pairs[k].camera_idx2()];
    if ((a == c || b == c) && (!a || !b || a == b)) selected.push_back(k);
  }
  // The search only has to find the basin of the minimum, so it also uses the
  // fewest matches that a pair may have.
  const size_t size = std::min(selected.size(), size_t{40});
  for (size_t i = 0; i < size; ++i) {
    selected[i] = selected[i * selected.size() / size];
  }
  selected.resize(size);
  return selected;
}

// The lens of one unknown with the lowest cost on the grid, over the pairs that
// depend on no other unknown. For each distortion, factors are visited outward
// from one, and each pose starts at its value for the previous factor.
LensOffset SearchLens(const std::vector<FocalPair>& pairs,
                      const Unknowns& unknowns, int c, int num_threads) {
  constexpr int kMiddle = kNumFactors / 2;
  constexpr size_t kSize = kDistortions.size() * kNumFactors;
  const auto lens_at = [&](size_t cell) {
    const int i = static_cast<int>(cell % kNumFactors);
    return LensOffset(kMaxLogFocalFactor * (i - kMiddle) / kMiddle,
                      kDistortions[cell / kNumFactors], 0.0, 0.0);
  };
  const bool is_distorted = unknowns.cameras[unknowns.camera_idxs[c]].model ==
                            CameraModelId::kSimpleDivision;
  const std::vector<size_t> selected = SelectSearchPairs(pairs, unknowns, c);
  std::vector<std::array<double, kSize>> costs(selected.size());
  ParallelFor(selected.size(), num_threads, [&](size_t k) {
    FocalPair pair = pairs[selected[k]];
    pair.KeepMatches(kMinNumMatches);
    const bool is_first = unknowns.of_camera[pair.camera_idx1()] == c;
    const bool is_second = unknowns.of_camera[pair.camera_idx2()] == c;
    for (size_t d = 0; d < (is_distorted ? kDistortions.size() : 1); ++d) {
      for (const int direction : {1, -1}) {
        pair.set_pose(pairs[selected[k]].pose());
        for (int i = kMiddle; i >= 0 && i < kNumFactors; i += direction) {
          const size_t cell = d * kNumFactors + static_cast<size_t>(i);
          const LensOffset lens = lens_at(cell);
          pair.SetRays(is_first ? lens : LensOffset::Zero(),
                       is_second ? lens : LensOffset::Zero());
          costs[k][cell] = pair.RefinePose(kNumPoseIterations);
        }
      }
    }
  });
  size_t best = kMiddle;
  double least = 0.0;
  for (size_t cell = 0; cell < (is_distorted ? kSize : kNumFactors); ++cell) {
    double change = 0.0;
    for (const auto& of_pair : costs)
      change += of_pair[cell] - of_pair[kMiddle];
    if (change >= least) continue;
    least = change;
    best = cell;
  }
  return lens_at(best);
}

// Sets the rays of all pairs for these lenses and returns the total cost.
double SetLenses(const Eigen::VectorXd& s, const Unknowns& unknowns,
                 int num_threads, std::vector<FocalPair>* pairs) {
  std::vector<double> costs(pairs->size());
  ParallelFor(pairs->size(), num_threads, [&](size_t k) {
    FocalPair& pair = (*pairs)[k];
    pair.SetRays(ValueOf(s, unknowns.of_camera[pair.camera_idx1()]),
                 ValueOf(s, unknowns.of_camera[pair.camera_idx2()]));
    costs[k] = pair.Cost();
  });
  double sum = CostOfPrior(s, unknowns);
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

// `variance` of the residuals weighs them against the prior.
ReducedEquations Reduce(const std::vector<FocalPair>& pairs,
                        const Unknowns& unknowns, const Eigen::VectorXd& s,
                        double variance, int num_threads) {
  ReducedEquations reduced;
  const Eigen::Index size = s.size();
  reduced.hessian.setZero(size, size);
  reduced.outer.setZero(size, size);
  reduced.gradient.setZero(size);
  reduced.of_pair.resize(pairs.size());
  ParallelFor(pairs.size(), num_threads, [&](size_t k) {
    FocalEquations& e = reduced.of_pair[k];
    e = pairs[k].Linearize();
    e.hessian.diagonal().head<5>() *= 1.0 + kPoseDamping;
    e.hessian.diagonal().head<5>().array() += kPoseDamping;
  });
  for (size_t k = 0; k < pairs.size(); ++k) {
    const FocalEquations& e = reduced.of_pair[k];
    const Eigen::Matrix<double, 5, 2 * kLensSize> coupling =
        e.hessian.topRightCorner<5, 2 * kLensSize>();
    const Eigen::Matrix<double, 5, 2 * kLensSize> solved =
        e.hessian.topLeftCorner<5, 5>().ldlt().solve(coupling);
    const Eigen::Matrix<double, 2 * kLensSize, 2 * kLensSize> H =
        e.hessian.bottomRightCorner<2 * kLensSize, 2 * kLensSize>() -
        coupling.transpose() * solved;
    const Eigen::Matrix<double, 2 * kLensSize, 1> g =
        e.gradient.tail<2 * kLensSize>() -
        solved.transpose() * e.gradient.head<5>();
    const auto of_pair = unknowns.OfPair(pairs[k]);
    for (int i = 0; i < 2; ++i) {
      if (!of_pair[i]) continue;
      const int row = kLensSize * *of_pair[i];
      const LensOffset g_i = g.segment<kLensSize>(kLensSize * i);
      reduced.gradient.segment<kLensSize>(row) += g_i;
      for (int j = 0; j < 2; ++j) {
        if (!of_pair[j]) continue;
        const int column = kLensSize * *of_pair[j];
        reduced.hessian.block<kLensSize, kLensSize>(row, column) +=
            H.block<kLensSize, kLensSize>(kLensSize * i, kLensSize * j);
        reduced.outer.block<kLensSize, kLensSize>(row, column) +=
            g_i * g.segment<kLensSize>(kLensSize * j).transpose();
      }
    }
  }
  for (int c = 0; c < static_cast<int>(unknowns.size()); ++c) {
    const LensOffset weight = variance * unknowns.information;
    reduced.hessian.diagonal().segment<kLensSize>(kLensSize * c) += weight;
    reduced.gradient.segment<kLensSize>(kLensSize * c) +=
        weight.cwiseProduct(ValueOf(s, c));
  }
  // Damps log factors: a factor that no pair determines does not change.
  reduced.hessian.diagonal().array() += 1e-6;
  return reduced;
}

// Takes the step, halved until the cost decreases. Returns false, without
// changes, if it does not decrease.
bool TryStep(const ReducedEquations& reduced, const Eigen::VectorXd& step,
             const Unknowns& unknowns, int num_threads,
             std::vector<FocalPair>* pairs, Eigen::VectorXd* s) {
  double cost = CostOfPrior(*s, unknowns);
  std::vector<Rigid3> poses;
  for (const FocalPair& pair : *pairs) {
    cost += pair.Cost();
    poses.push_back(pair.pose());
  }
  // Largest step of a log factor: derivatives are valid within about 20 %.
  double scale = std::min(1.0, 0.2 / step.cwiseAbs().maxCoeff());
  for (int i = 0; i < 5; ++i, scale *= 0.5) {
    for (size_t k = 0; k < pairs->size(); ++k) {
      const FocalEquations& e = reduced.of_pair[k];
      const auto [a, b] = unknowns.OfPair((*pairs)[k]);
      Eigen::Matrix<double, 2 * kLensSize, 1> ds;
      ds << ValueOf(step, a), ValueOf(step, b);
      (*pairs)[k].set_pose(poses[k]);
      (*pairs)[k].MovePose(
          -scale * e.hessian.topLeftCorner<5, 5>().ldlt().solve(
                       e.gradient.head<5>() +
                       e.hessian.topRightCorner<5, 2 * kLensSize>() * ds));
    }
    const Eigen::VectorXd candidate = *s + scale * step;
    if (SetLenses(candidate, unknowns, num_threads, pairs) < cost) {
      *s = candidate;
      return true;
    }
  }
  for (size_t k = 0; k < pairs->size(); ++k) (*pairs)[k].set_pose(poses[k]);
  SetLenses(*s, unknowns, num_threads, pairs);
  return false;
}

// Gauss-Newton in all unknowns, until no log factor changes by `min_step`.
void Refine(const Unknowns& unknowns, double min_step, const Context& context,
            std::vector<FocalPair>* pairs, Eigen::VectorXd* s) {
  if (pairs->empty()) return;
  SetLenses(*s, unknowns, context.num_threads, pairs);
  ParallelFor(pairs->size(), context.num_threads,
              [&](size_t k) { (*pairs)[k].RefinePose(kNumPoseIterations); });
  for (int i = 0; i < 20; ++i) {
    context.CheckInterrupted();
    const ReducedEquations reduced =
        Reduce(*pairs, unknowns, *s, 1.0, context.num_threads);
    const Eigen::VectorXd step =
        -reduced.hessian.ldlt().solve(reduced.gradient);
    if (!step.allFinite() || step.cwiseAbs().maxCoeff() < min_step) break;
    if (!TryStep(reduced, step, unknowns, context.num_threads, pairs, s)) break;
  }
}

// Drops pairs whose median residual exceeds that of the median pair.
std::vector<FocalPair> DropOutliers(std::vector<FocalPair> pairs) {
  if (pairs.empty()) return pairs;
  const std::vector<double> medians = Transformed(
      pairs, [&](const FocalPair& pair) { return Median(pair.Residuals()); });
  const double max_median =
      kOutlierFactor * std::max(Median(medians), kMinKeypointSigmaPx);
  std::vector<FocalPair> kept;
  for (size_t k = 0; k < pairs.size(); ++k) {
    if (medians[k] <= max_median) kept.push_back(std::move(pairs[k]));
  }
  return kept;
}

// Variances of the log factors: the maximum of the estimate from residual noise
// and the sandwich estimate; see the header.
Eigen::VectorXd EstimateVariances(const std::vector<FocalPair>& pairs,
                                  const Unknowns& unknowns,
                                  const Eigen::VectorXd& s, int num_threads) {
  std::set<int> images;
  std::vector<double> residuals;
  for (const FocalPair& pair : pairs) {
    const std::vector<double> of_pair = pair.Residuals();
    residuals.insert(residuals.end(), of_pair.begin(), of_pair.end());
    images.insert({pair.image_idx1(), pair.image_idx2()});
  }
  const double sigma_px =
      std::max(RobustSigma<1>(std::move(residuals)), kMinKeypointSigmaPx);
  const double pairs_per_image = 2.0 * static_cast<double>(pairs.size()) /
                                 static_cast<double>(images.size());
  const double variance = sigma_px * sigma_px * std::max(1.0, pairs_per_image);
  const ReducedEquations reduced =
      Reduce(pairs, unknowns, s, variance, num_threads);
  const Eigen::MatrixXd inverse = reduced.hessian.inverse();
  const Eigen::MatrixXd sandwich = inverse * reduced.outer * inverse;
  Eigen::VectorXd variances(s.size() / kLensSize);
  for (Eigen::Index c = 0; c < variances.size(); ++c) {
    const Eigen::Index i = kLensSize * c;
    variances[c] = std::max(variance * inverse(i, i), sandwich(i, i));
  }
  return variances;
}

bool IsDiverged(double s) {
  return std::abs(s) > kMaxRelativeLogFactor * kMaxLogFocalFactor;
}

// Why the estimate is not accepted; empty if it is accepted.
std::string RejectionReason(int num_pairs, double s,
                            const std::optional<double>& sigma,
                            double max_sigma) {
  if (num_pairs < kMinNumPairs) {
    return "too few image pairs have a consistent epipolar geometry";
  }
  if (IsDiverged(s)) return kReason;
  if (*sigma <= max_sigma) return "";
  const std::string numbers = Formatted(
      "relative standard deviation %.3g exceeds %.3g: ", *sigma, max_sigma);
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

// Converts a lens of the division model to SIMPLE_RADIAL: the k for which r + k
// r^3 best fits the radii of the image.
Camera InModelOf(const Camera& camera, Camera lens) {
  if (lens.model == camera.model) return lens;
  lens.model = camera.model;
  constexpr int kNumRadii = 20;
  const double corner =
      0.5 * std::hypot(lens.width_px, lens.height_px) / lens.params[0];
  double products = 0.0, squares = 0.0;
  for (int i = 1; i <= kNumRadii; ++i) {
    const double distorted = corner * i / kNumRadii;
    const double scale = 1.0 + lens.params[3] * distorted * distorted;
    if (scale <= 0.0) break;
    const double radius = distorted / scale;
    products += std::pow(radius, 3) * (distorted - radius);
    squares += std::pow(radius, 6);
  }
  lens.params[3] = squares > 0.0 ? products / squares : 0.0;
  return lens;
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
    variances = EstimateVariances(pairs, unknowns, s, num_threads);
  }
  for (size_t c = 0; c < unknowns.size(); ++c) {
    const auto i = static_cast<Eigen::Index>(c);
    const int camera_idx = unknowns.camera_idxs[c];
    const Camera& camera = scene.cameras[camera_idx];
    const CameraModelInfo& info = InfoOf(camera.model);
    FocalLengthEstimate& estimate = result.estimates.emplace_back();
    estimate.camera_idx = camera_idx;
    estimate.prior_px = camera.params[info.focal_length_idxs.front()];
    estimate.num_pairs = num_pairs[c];
    std::optional<double> sigma;
    if (num_pairs[c] > 0) {
      sigma = std::sqrt(variances[i]);
      if (!IsDiverged(s[kLensSize * i])) {
        estimate.sigma = std::hypot(*sigma, kSharedSigma);
      }
    }
    LensOffset lens = ValueOf(s, static_cast<int>(c));
    lens.tail<2>().setZero();  // bundle adjustment estimates it better
    estimate.message = RejectionReason(num_pairs[c], lens[0], sigma, max_sigma);
    const bool is_accepted = estimate.message.empty();
    if (is_accepted) {
      estimate.estimated_px = std::exp(lens[0]) * estimate.prior_px;
    } else if (num_pairs[c] < kMinNumPairs ||
               !(estimate.sigma.value_or(1.0) < kSigmaOfFocalLengthGuess)) {
      continue;
    }
    result.cameras[camera_idx] = InModelOf(
        camera, internal::WithLens(unknowns.cameras[camera_idx], lens));
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
  Eigen::VectorXd s(kLensSize * static_cast<Eigen::Index>(unknowns.size()));
  for (Eigen::Index c = 0; kLensSize * c < s.size(); ++c) {
    s.segment<kLensSize>(kLensSize * c) =
        SearchLens(pairs, unknowns, static_cast<int>(c), context.num_threads);
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
  Eigen::VectorXd s = Eigen::VectorXd::Zero(
      kLensSize * static_cast<Eigen::Index>(unknowns.size()));
  Refine(unknowns, kMinStepOfMeasurement, context, &pairs, &s);
  pairs = DropOutliers(std::move(pairs));
  Refine(unknowns, kMinStepOfMeasurement, context, &pairs, &s);
  if (pairs.empty()) return {};
  const Eigen::VectorXd variances =
      EstimateVariances(pairs, unknowns, s, context.num_threads);
  const std::vector<int> num_pairs = CountPairs(pairs, unknowns);
  std::vector<FocalLengthMeasurement> measured;
  for (size_t c = 0; c < unknowns.size(); ++c) {
    const auto i = static_cast<Eigen::Index>(c);
    if (num_pairs[c] < kMinNumPairs) continue;
    measured.push_back({unknowns.camera_idxs[c], s[kLensSize * i],
                        std::sqrt(variances[i]), num_pairs[c]});
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
