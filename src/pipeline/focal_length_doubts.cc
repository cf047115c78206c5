// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/focal_length_doubts.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "health/focal_lengths.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle/bundle_adjustment.h"
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

// The cameras of the model, adjusted with all focal lengths in doubt free.
std::vector<Camera> Release(const Scene& scene, const Reconstruction& model,
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
  return AdjustBundle(released, model, options, context).estimate.cameras;
}

}  // namespace

std::vector<Finding> ConfirmedFocalLengthDoubts(
    const Scene& scene, const std::vector<MapperModel>& models,
    const BundleAdjustmentOptions& options, const Context& context,
    std::vector<Finding> doubts) {
  if (doubts.empty() || models.empty()) return doubts;
  const Reconstruction& model = models.front().reconstruction;
  const Mask is_observed = FindObserved(scene, model);
  const std::vector<Camera> cameras =
      Release(scene, model, doubts, options, context);
  const auto is_refuted = [&](const Finding& doubt) {
    for (size_t i = 0; i < cameras.size(); ++i) {
      if (!is_observed[i] || !Concerns(scene, doubt, static_cast<int>(i))) {
        continue;
      }
      const double change =
          std::log(FocalLengthOf(cameras[i]) / FocalLengthOf(scene.cameras[i]));
      if (!ContradictsFocalLength(doubt, change)) return true;
    }
    return false;
  };
  doubts.erase(std::remove_if(doubts.begin(), doubts.end(), is_refuted),
               doubts.end());
  return doubts;
}

}  // namespace mgsfm
