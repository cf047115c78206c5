// SPDX-License-Identifier: BSD-3-Clause
#include "lenses/lens_calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "bundle_adjustment/residual_field.h"
#include "math/robust_scale.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/view_graph/focal_length_calibration.h"
#include "scene/intrinsics_check.h"

namespace mgsfm {
namespace {

// Standard deviations of lenses about a lens without distortion. Radial
// parameters of wide perspective lenses reach -0.4 and 0.2, those of fisheyes a
// tenth, and decentering 0.001. Focal lengths in EXIF are rounded and nominal;
// they are worse for zooms and cropped videos.
constexpr double kSigmaOfExif = 0.1;
constexpr double kPerspectiveSigmas[] = {0.3, 0.15, 2e-3, 2e-3};
constexpr double kFisheyeSigmas[] = {0.1, 0.05, 0.02, 0.01};
// The lens change that a view graph tolerates, in multiples of its maximum
// error.
constexpr double kMaxChange = 3.0;
// The change of lenses by the next round, as a fraction of the change by this
// round, if errors of the lens model hardly move them: on recorded rigs 0.02 to
// 0.22. Others converge more slowly.
constexpr double kChangeByNextRound = 0.25;
// Number of frames in the first round: what a drive sees during a turn. Each
// round has twice as many until they determine the lenses.
constexpr size_t kNumFramesOfTurn = 24;

double FirstFocalLength(const Camera& camera) {
  return camera.params[InfoOf(camera.model).focal_length_idxs.front()];
}

// SIMPLE_RADIAL as RADIAL, or vice versa.
Camera WithModel(Camera camera, CameraModelId model) {
  camera.model = model;
  camera.params.resize(InfoOf(camera.model).num_params, 0.0);
  return camera;
}

bool IsFisheye(CameraModelId model) {
  return model == CameraModelId::kOpenCVFisheye ||
         model == CameraModelId::kSimpleRadialFisheye ||
         model == CameraModelId::kRadialFisheye;
}

// Whether the parameters of a model have priors.
bool IsKnownModel(CameraModelId model) {
  return IsFisheye(model) || model == CameraModelId::kSimpleRadial ||
         model == CameraModelId::kRadial || model == CameraModelId::kOpenCV ||
         model == CameraModelId::kSimplePinhole ||
         model == CameraModelId::kPinhole;
}

// The standard deviations of the unknown parameters about `start`.
std::vector<double> PriorSigmas(const Camera& camera, const Camera& start,
                                const BundleAdjustmentOptions& options) {
  const CameraModelInfo& info = InfoOf(camera.model);
  std::vector<double> sigmas(camera.params.size(), 0.0);
  if (options.refine_focal_length != RefineMode::kNo) {
    for (const int i : info.focal_length_idxs) {
      sigmas[i] = options.focal_length_start_sigma * start.params[0];
    }
  }
  if (options.refine_principal_point != RefineMode::kNo) {
    for (const int i : info.principal_point_idxs) {
      sigmas[i] =
          kSigmaOfPrincipalPoint * std::max(camera.width_px, camera.height_px);
    }
  }
  if (options.refine_extra_params != RefineMode::kNo) {
    for (size_t i = 0; i < info.extra_params_idxs.size(); ++i) {
      sigmas[info.extra_params_idxs[i]] =
          IsFisheye(camera.model) ? kFisheyeSigmas[i] : kPerspectiveSigmas[i];
    }
  }
  return sigmas;
}

// Sets the prior of a camera to `start`, in its model.
void SetPrior(int camera_idx, const Camera& start,
              const BundleAdjustmentOptions& options, Lenses* lenses) {
  const Camera& camera = lenses->cameras[camera_idx];
  lenses->prior.intrinsics[camera_idx] =
      (camera.model == start.model ? start : WithModel(start, camera.model))
          .params;
  lenses->prior.intrinsic_sigmas[camera_idx] =
      PriorSigmas(camera, start, options);
}

bool MaySelectModel(const Camera& camera, const LensOptions& options) {
  return options.focal_lengths.select_camera_model &&
         options.bundle_adjustment.refine_extra_params != RefineMode::kNo &&
         camera.model == CameraModelId::kSimpleRadial;
}

LensSource SourceOfStart(const Camera& given, const Camera& start) {
  if (given.params != start.params) return LensSource::kPairs;
  return HasLensOfExif(given) ? LensSource::kExif : LensSource::kGuess;
}

Lenses FirstLenses(const LensInput& input, const LensOptions& options,
                   LensSummary* summary) {
  const std::vector<Camera>& start = input.start;
  Lenses lenses{start};
  lenses.prior.intrinsics.resize(start.size());
  lenses.prior.intrinsic_sigmas.resize(start.size());
  for (size_t i = 0; i < start.size(); ++i) {
    if (start[i].has_prior_focal_length || !IsKnownModel(start[i].model)) {
      continue;
    }
    const int idx = static_cast<int>(i);
    if (MaySelectModel(input.given[i], options)) {
      lenses.cameras[i] = WithModel(start[i], CameraModelId::kRadial);
    }
    SetPrior(idx, start[i], options.bundle_adjustment, &lenses);
    summary->lenses.push_back({idx, lenses.cameras[i].model, "",
                               SourceOfStart(input.given[i], start[i])});
  }
  return lenses;
}

// Grows from the frame with the most matches by the frame with the most matches
// to those already selected. Square roots prefer frames that overlap many
// selected frames to frames that resemble one of them.
Mask SelectFrames(const Scene& scene, const ViewGraph& matches, size_t size) {
  std::vector<std::map<int, double>> weights(scene.frames.size());
  for (const ImagePair& pair : matches.pairs) {
    const int a = scene.images[pair.image_idx1].frame_idx;
    const int b = scene.images[pair.image_idx2].frame_idx;
    if (a == b) continue;
    const double weight = std::sqrt(static_cast<double>(pair.matches.size()));
    weights[a][b] += weight;
    weights[b][a] += weight;
  }
  std::vector<double> gains(weights.size(), 0.0);
  for (size_t i = 0; i < weights.size(); ++i) {
    for (const auto& [neighbor, weight] : weights[i]) gains[i] += weight;
  }
  Mask is_selected(weights.size(), false);
  for (size_t n = 0; n < std::min(size, weights.size()); ++n) {
    std::optional<size_t> best;
    for (size_t i = 0; i < gains.size(); ++i) {
      if (!is_selected[i] && (!best || gains[i] > gains[*best])) best = i;
    }
    if (n == 0) gains.assign(gains.size(), 0.0);
    is_selected[*best] = true;
    for (const auto& [neighbor, weight] : weights[*best]) {
      gains[neighbor] += weight;
    }
  }
  return is_selected;
}

// The pairs within the frames. Verification starts at the poses of the model,
// if it has them.
ViewGraph PairsWithin(const Scene& scene, const ViewGraph& matches,
                      const Mask& has_frame,
                      const std::optional<Reconstruction>& model) {
  ViewGraph within;
  for (const ImagePair& pair : matches.pairs) {
    if (!has_frame[scene.images[pair.image_idx1].frame_idx] ||
        !has_frame[scene.images[pair.image_idx2].frame_idx]) {
      continue;
    }
    within.pairs.push_back(pair);
    if (!model) continue;
    const auto pose1 = model->CamFromWorld(scene, pair.image_idx1);
    const auto pose2 = model->CamFromWorld(scene, pair.image_idx2);
    if (!pose1 || !pose2) continue;
    const Rigid3 relative = *pose2 * pose1->Inverse();
    if (!(relative.translation.norm() > 0.0)) continue;
    within.pairs.back().relative_pose = {relative.rotation,
                                         relative.translation.normalized()};
  }
  return within;
}

bool IsPlausible(const Camera& camera, const BundleAdjustmentOptions& options) {
  const double side = std::max(camera.width_px, camera.height_px);
  for (const int i : InfoOf(camera.model).focal_length_idxs) {
    const double ratio = camera.params[i] / side;
    if (!(ratio >= options.min_focal_length_ratio &&
          ratio <= options.max_focal_length_ratio)) {
      return false;
    }
  }
  return true;
}

// Adopts the plausible lenses of a model. Returns the largest change, of all or
// of those that the model determines.
double Adopt(const Reconstruction& model,
             const std::vector<FocalLengthCheck>& checks,
             const BundleAdjustmentOptions& options, bool of_determined,
             std::vector<Camera>* cameras) {
  double largest_px = 0.0;
  for (const FocalLengthCheck& check : checks) {
    Camera& camera = (*cameras)[check.camera_idx];
    const Camera& refined = model.cameras[check.camera_idx];
    if (!IsPlausible(refined, options)) continue;
    if (!of_determined || check.message.empty()) {
      largest_px = std::max(largest_px, LensChangePx(camera, refined));
    }
    camera.params = refined.params;
  }
  return largest_px;
}

// Whether the model determines all focal lengths, apart from errors of the lens
// model, which more frames do not reduce.
bool DeterminesAll(const LensSummary& summary, const LensModel& model) {
  const auto& checks = model.focal_lengths;
  return checks.size() >= summary.lenses.size() &&
         AllOf(checks, [](const auto& check) { return check.message.empty(); });
}

// The expected change of the lenses by the next round.
double NextChange(const LensModel& model, double change_px,
                  const BundleAdjustmentOptions& options) {
  const auto& checks = model.focal_lengths;
  const bool are_certain = AllOf(checks, [&](const auto& check) {
    return check.relative_sigma &&
           *check.relative_sigma <= options.max_focal_length_sigma;
  });
  return are_certain ? kChangeByNextRound * change_px : change_px;
}

void LogRound(const LensSummary& summary, size_t num_frames, double change_px,
              const Context& context) {
  context.Info(
      Formatted("lenses: round %d with %zu frames changes them by %.2f px",
                summary.num_rounds, num_frames, change_px));
}

// The logarithm of the evidence for a parameter with a normal prior about zero,
// relative to that for zero: the ratio of the densities of prior and posterior
// at zero (Dickey 1971).
double LogEvidence(double value, double sigma, double prior_sigma) {
  return 0.5 * value * value / (sigma * sigma) - std::log(prior_sigma / sigma);
}

// Keeps RADIAL for lenses if a model of some frames provides evidence for the
// second parameter.
void SelectModels(const LensInput& input, const Reconstruction& model,
                  const LensOptions& options, const Context& context,
                  LensResult* result) {
  Lenses& lenses = result->lenses;
  BundlePriors priors;
  priors.calibration = lenses.prior;
  const auto sigmas = ComputeAllIntrinsicSigmas(
      input.scene, model, options.bundle_adjustment, context, priors);
  if (!sigmas) return;
  for (LensChoice& lens : result->summary.lenses) {
    const int i = lens.camera_idx;
    if (!MaySelectModel(input.given[i], options) || sigmas->total[i].empty())
      continue;
    const double k2 = model.cameras[i].params.back();
    const double sigma = sigmas->total[i].back();
    lens.reason =
        Formatted("its second radial parameter is %.2g +- %.1g", k2, sigma);
    if (LogEvidence(k2, sigma, lenses.prior.intrinsic_sigmas[i].back()) > 0.0)
      continue;
    lens.model = CameraModelId::kSimpleRadial;
    lenses.cameras[i] = WithModel(lenses.cameras[i], lens.model);
    SetPrior(i, input.start[i], options.bundle_adjustment, &lenses);
  }
}

void LogLenses(const Scene& scene, const LensResult& result,
               const Context& context) {
  for (const LensChoice& lens : result.summary.lenses) {
    const Camera& camera = result.lenses.cameras[lens.camera_idx];
    std::string text = "lens of " + CameraLabel(scene, lens.camera_idx) + ": " +
                       std::string(InfoOf(camera.model).name);
    for (const double param : camera.params) text += Formatted(" %.5g", param);
    context.Info(text +
                 (lens.reason.empty() ? "" : ", because " + lens.reason));
  }
}

}  // namespace

bool NeedsLenses(const Scene& scene, const FocalLengthOptions& options) {
  return options.calibrate && AnyOf(scene.cameras, [](const Camera& camera) {
           return !camera.has_prior_focal_length || HasLensOfExif(camera);
         });
}

void LogFocalLengths(const Scene& scene, const FocalLengthResult& focal_lengths,
                     const Context& context) {
  for (const FocalLengthEstimate& estimate : focal_lengths.estimates) {
    const std::string camera =
        "focal length of " + CameraLabel(scene, estimate.camera_idx);
    context.Info(
        camera +
        (estimate.estimated_px
             ? Formatted(": %.2f px (initially %.2f) +- %.2f",
                         *estimate.estimated_px, estimate.prior_px,
                         *estimate.estimated_px * *estimate.sigma)
             : Formatted(": starts at %.2f px (initially %.2f): ",
                         focal_lengths.cameras[estimate.camera_idx].params[0],
                         estimate.prior_px) +
                   estimate.message));
  }
}

void StateInitialFocalLengths(const Scene& scene,
                              std::vector<FocalLengthCheck>* checks) {
  for (FocalLengthCheck& check : *checks) {
    check.prior_px = FirstFocalLength(scene.cameras[check.camera_idx]);
  }
}

std::vector<Camera> WithoutExif(std::vector<Camera> cameras) {
  for (Camera& camera : cameras) {
    if (HasLensOfExif(camera)) camera.has_prior_focal_length = false;
  }
  return cameras;
}

std::vector<Camera> StartOfLenses(const std::vector<Camera>& given,
                                  FocalLengthResult of_pairs) {
  for (const FocalLengthEstimate& estimate : of_pairs.estimates) {
    const Camera& camera = given[estimate.camera_idx];
    if (!HasLensOfExif(camera)) continue;
    Camera& of_camera = of_pairs.cameras[estimate.camera_idx];
    const double sigma = estimate.sigma.value_or(1.0);
    const double change =
        std::log(FirstFocalLength(of_camera) / FirstFocalLength(camera));
    if (sigma < kSigmaOfExif &&
        std::abs(change) <
            kRareErrorInSigmas * std::hypot(sigma, kSigmaOfExif)) {
      continue;
    }
    of_camera.params = camera.params;
  }
  return std::move(of_pairs.cameras);
}

LensResult CalibrateLenses(const LensInput& input, const LensMapper& map,
                           const LensOptions& options, const Context& context) {
  const Scene& scene = input.scene;
  LensResult result;
  LensSummary& summary = result.summary;
  result.lenses = FirstLenses(input, options, &summary);
  if (summary.lenses.empty()) return result;
  std::optional<Reconstruction> model;
  size_t num_frames = kNumFramesOfTurn;
  for (int i = 0; i < options.focal_lengths.max_num_rounds; ++i) {
    const auto mapped =
        map(result.lenses,
            PairsWithin(scene, input.matches,
                        SelectFrames(scene, input.matches, num_frames), model));
    if (!mapped) break;
    model = mapped->reconstruction;
    const double change_px =
        Adopt(*model, mapped->focal_lengths, options.bundle_adjustment,
              /*of_determined=*/false, &result.lenses.cameras);
    ++summary.num_rounds;
    LogRound(summary, std::min(num_frames, scene.frames.size()), change_px,
             context);
    const bool needs_frames =
        !DeterminesAll(summary, *mapped) && num_frames < scene.frames.size();
    if (!needs_frames &&
        NextChange(*mapped, change_px, options.bundle_adjustment) <=
            kMaxChange * options.max_error_px) {
      break;
    }
    if (needs_frames) num_frames *= 2;
    // All frames are mapped after the rounds.
    if (needs_frames && num_frames >= scene.frames.size()) break;
  }
  Context quiet = context;
  quiet.log = nullptr;
  if (model) SelectModels(input, *model, options, quiet, &result);
  LogLenses(scene, result, context);
  return result;
}

bool UpdateLenses(const Reconstruction& model,
                  const std::vector<FocalLengthCheck>& checks,
                  const LensOptions& options, LensResult* lenses) {
  std::vector<Camera> cameras = lenses->lenses.cameras;
  const double change_px = Adopt(model, checks, options.bundle_adjustment,
                                 /*of_determined=*/true, &cameras);
  if (change_px <= kMaxChange * options.max_error_px) return false;
  lenses->lenses.cameras = std::move(cameras);
  ++lenses->summary.num_rounds;
  return true;
}

double LensChangePx(const Camera& before, const Camera& after) {
  constexpr int kNumCells = 8;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0.0, count = 0.0;
  for (int i = 0; i <= kNumCells; ++i) {
    for (int j = 0; j <= kNumCells; ++j) {
      const Eigen::Vector2d pixel(before.width_px * i / double{kNumCells},
                                  before.height_px * j / double{kNumCells});
      const auto ray = RayFromPixel(before, pixel);
      if (!ray) continue;
      const auto moved = ProjectToPixel(after, *ray);
      if (!moved) continue;
      sum += *moved - pixel;
      squares += (*moved - pixel).squaredNorm();
      count += 1.0;
    }
  }
  if (count == 0.0) return 0.0;
  return std::sqrt(
      std::max(0.0, squares / count - (sum / count).squaredNorm()));
}

}  // namespace mgsfm
