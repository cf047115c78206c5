// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/focal_length_doubts.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "input_check/focal_lengths.h"
#include "math/robust_scale.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

bool Concerns(const Scene& scene, const Finding& doubt, int camera_idx) {
  const std::vector<std::string> names = SensorsOfCamera(scene, camera_idx);
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
    return std::count(doubt.cameras.begin(), doubt.cameras.end(), name) > 0;
  });
}

// Per camera: whether points of the model observe it.
Mask FindObserved(const Scene& scene, const Reconstruction& model) {
  Mask is_observed(scene.cameras.size(), false);
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      is_observed[scene.images[o.image_idx].camera_idx] = true;
    }
  }
  return is_observed;
}

double FocalLengthOf(const Camera& camera) {
  return camera.params[FindCameraModel(static_cast<int32_t>(camera.model))
                           ->focal_length_idxs.front()];
}

// The focal lengths in doubt, released and adjusted with the model.
std::vector<FocalLengthCheck> Release(const Scene& scene,
                                      const Reconstruction& model,
                                      const std::vector<Finding>& doubts,
                                      BundleAdjustmentOptions options,
                                      const Context& context) {
  // Weak, because the known value is in doubt.
  options.focal_length_start_sigma = 1.0;
  options.refine_focal_length = RefineMode::kAuto;
  options.refine_extra_params = RefineMode::kNo;
  Scene released = scene;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const bool is_doubtful =
        std::any_of(doubts.begin(), doubts.end(), [&](const Finding& doubt) {
          return Concerns(scene, doubt, static_cast<int>(i));
        });
    released.cameras[i].has_prior_focal_length = !is_doubtful;
  }
  return CheckFocalLengths(
      released, AdjustBundle(released, model, options, context).estimate,
      options, context);
}

}  // namespace

std::vector<Finding> ConfirmedFocalLengthDoubts(
    const Scene& scene, const std::vector<MapperModel>& models,
    const BundleAdjustmentOptions& options, const Context& context,
    std::vector<Finding> doubts) {
  if (doubts.empty() || models.empty()) return doubts;
  const Reconstruction& model = models.front().reconstruction;
  const Mask is_observed = FindObserved(scene, model);
  const std::vector<FocalLengthCheck> checks =
      Release(scene, model, doubts, options, context);
  const auto is_refuted = [&](const Finding& doubt) {
    return std::any_of(
        checks.begin(), checks.end(), [&](const FocalLengthCheck& check) {
          if (!is_observed[check.camera_idx] ||
              !Concerns(scene, doubt, check.camera_idx)) {
            return false;
          }
          const double change =
              std::log(check.estimated_px /
                       FocalLengthOf(scene.cameras[check.camera_idx]));
          // On a straight road, the adjustment moves a focal length anywhere,
          // with a large standard deviation.
          return !check.relative_sigma ||
                 std::abs(change) <
                     kRareErrorInSigmas * *check.relative_sigma ||
                 !ContradictsFocalLength(doubt, change);
        });
  };
  doubts.erase(std::remove_if(doubts.begin(), doubts.end(), is_refuted),
               doubts.end());
  return doubts;
}

}  // namespace mgsfm
