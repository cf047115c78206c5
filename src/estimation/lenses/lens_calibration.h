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

// The lenses of a scene, with priors for parameters without calibration.
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

// The cameras, with lenses from EXIF marked as unknown.
[[nodiscard]] std::vector<Camera> WithoutExif(std::vector<Camera> cameras);

// The initial cameras of the estimation: from image pairs, except for focal
// lengths from EXIF that are more certain or that image pairs contradict,
// because planar scenes make image pairs certain and wrong.
[[nodiscard]] std::vector<Camera> StartOfLenses(
    const std::vector<Camera>& given, FocalLengthResult of_pairs);

// Estimates the lenses of cameras without calibration before the reconstruction
// of a scene.
//
// A wrong lens not only biases a model: the view graph also rejects matches
// that contradict it. The stages from the view graph to bundle adjustment are
// therefore repeated with the refined lenses, on few frames that share many
// matches, until the next round would change no lens by more than the view
// graph tolerates (LensChangePx() <= 3 ViewGraph.max_error_px), at most
// FocalLengths.max_num_rounds times. The next change is taken as a quarter of
// the last one if all focal lengths are certain to
// BundleAdjustment.max_focal_length_sigma with errors of the lens model. The
// first round has 24 frames. If the frames do not determine all focal lengths,
// the next round has twice as many, unless these are all frames, which are
// mapped after the rounds.
//
// Unless its model was chosen, a camera has RADIAL with an unknown principal
// point. All unknowns have normal priors, so undetermined ones stay near the
// values of typical lenses. The camera finally gets SIMPLE_RADIAL if this model
// has the higher evidence (marginal likelihood), which includes errors of the
// lens model. OPENCV is never selected: on recorded rigs, its decentering and
// second focal length fit delays and rolling shutters, so they appear certain
// but are wrong.
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

// Sets the initial focal lengths, which `scene` has, in the checks of the
// model.
void StateInitialFocalLengths(const Scene& scene,
                              std::vector<FocalLengthCheck>* checks);

// The root mean square displacement of rays, in pixels, by a change of lens,
// over a grid in the image and without its mean, which is a rotation.
[[nodiscard]] double LensChangePx(const Camera& before, const Camera& after);

}  // namespace mgsfm
