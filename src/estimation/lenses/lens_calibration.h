// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/lenses/lenses.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/view_graph/focal_length_calibration.h"

namespace mgsfm {

// The lenses of a scene, with priors of the parameters that no calibration
// gives.
struct Lenses {
  std::vector<Camera> cameras;
  CalibrationPrior prior = {};
};

struct LensOptions {
  const FocalLengthOptions& focal_lengths;
  const BundleAdjustmentOptions& bundle_adjustment;
  double max_error_px;  // of the view graph
};

// A model, and the checks of its focal lengths.
struct LensModel {
  Reconstruction reconstruction;
  std::vector<FocalLengthCheck> focal_lengths;
};

// The largest model of the pairs with these lenses, if there is one.
using LensMapper = std::function<std::optional<LensModel>(
    const Lenses& lenses, const ViewGraph& matches)>;

// Whether the scene has a lens to estimate.
[[nodiscard]] bool NeedsLenses(const Scene& scene,
                               const FocalLengthOptions& options);

struct LensInput {
  const Scene& scene;  // a LensMapper replaces its cameras
  const std::vector<Camera>& given;
  const std::vector<Camera>& start;
  const ViewGraph& matches;
};

struct LensResult {
  Lenses lenses;
  LensSummary summary;
};

// Whether the focal length is from EXIF, of which feature extraction knows that
// it is a focal length, but neither a distortion nor a principal point.
[[nodiscard]] bool HasLensOfExif(const Camera& camera);

// The cameras with those of EXIF marked as unknown.
[[nodiscard]] std::vector<Camera> WithoutExif(std::vector<Camera> cameras);

// The cameras at which estimation starts: those of image pairs, except for
// focal lengths of EXIF that are more certain, or that image pairs contradict:
// those of planar scenes do so with certainty, and wrongly.
[[nodiscard]] std::vector<Camera> StartOfLenses(
    const std::vector<Camera>& given, FocalLengthResult of_pairs);

// Estimates the lenses of cameras without calibration before a scene is mapped
// with them.
//
// A wrong lens does not only bias a model: the view graph rejects matches that
// contradict it. So the stages from the view graph to bundle adjustment are
// repeated with the refined lenses, on few frames that share many matches,
// until no lens changes by more than the view graph tolerates (LensChangePx()
// <= 1.5 ViewGraph.max_error_px), at most FocalLengths.max_num_rounds times.
// They are 12 in the first round and then 24. If they do not determine all
// focal lengths to BundleAdjustment.max_focal_length_sigma, the next round has
// twice as many.
//
// Unless its model was chosen, a camera has RADIAL, and its principal point is
// unknown. All unknowns have normal priors, so that those that the images do
// not determine stay near the values of usual lenses. It has SIMPLE_RADIAL at
// last if that has the higher evidence (marginal likelihood), which contains
// errors of the lens model. OPENCV is never selected: on recorded rigs, its
// decentering and second focal length fit delays and rolling shutters, and are
// certain and wrong.
[[nodiscard]] LensResult CalibrateLenses(const LensInput& input,
                                         const LensMapper& map,
                                         const LensOptions& options,
                                         const Context& context);

// Adopts the lenses of a model of all pairs if it changes those that it
// determines by more than 3 max_error_px. The scene is then mapped again.
[[nodiscard]] bool UpdateLenses(const Reconstruction& model,
                                const std::vector<FocalLengthCheck>& checks,
                                const LensOptions& options, LensResult* lenses);

void LogFocalLengths(const Scene& scene, const FocalLengthResult& focal_lengths,
                     const Context& context);

// `scene` has them.
void StateInitialFocalLengths(const Scene& scene,
                              std::vector<FocalLengthCheck>* checks);

// The root mean square in pixels of the displacement of rays by the change of a
// lens, over a grid in the image and without its mean, which is a rotation.
[[nodiscard]] double LensChangePx(const Camera& before, const Camera& after);

}  // namespace mgsfm
