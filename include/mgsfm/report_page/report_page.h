// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/evaluation/evaluation.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Poses of the images of a model from another source, and their alignment.
struct PoseComparison {
  std::string label;  // e.g. the folder
  std::vector<ImagePoses> images;
  Evaluation evaluation;  // of `images`
};

struct ReportPageInput {
  std::string title;  // e.g. the folder of the model
  const Scene& scene;
  const Reconstruction& reconstruction;
  const ViewGraph* view_graph = nullptr;  // verified matches, if known
  std::string report_json = {};           // of the run; "" if unknown
  size_t model_idx = 0;                   // in that report
  std::string image_path = {};            // for thumbnails; "" for none
  // The address of that folder relative to the page, to show photos; "" if
  // unknown.
  std::string image_url = {};
  bool is_east_north_up = false;  // the axes of the world
  // Per frame, in [0, 1]; empty if unknown.
  std::vector<std::optional<double>> frame_confidence = {};
  // cam_from_model holds poses of the reconstruction, cam_from_world true ones.
  std::optional<PoseComparison> truth = {};
  // cam_from_model holds poses of another model, cam_from_world those of the
  // reconstruction.
  std::optional<PoseComparison> other = {};
  // cam_from_model holds the poses of the reconstruction, moved to the measured
  // positions of their images, cam_from_world those of the reconstruction.
  std::optional<PoseComparison> positions = {};
};

struct ReportPageOptions {
  size_t max_bytes = 10'000'000;
  // If set, points that do not fit into the page go to files beside it named
  // `side_file_stem`.points1.js, ..., which the page loads when asked to.
  std::function<void(const std::string& name, const std::string& content)>
      write_side_file = {};
  std::string side_file_stem = "report";
};

// An HTML page that shows a model and the statistics of its run: a
// self-contained file that needs no network. Tables and charts are part of the
// HTML; the 3D view and the details of cameras and points need JavaScript.
//
// Points, their tracks and thumbnails are selected so that the page has at most
// `max_bytes`, unless the page without them is larger. Points are stored such
// that each prefix of the list represents the cloud: weighted random sampling
// without replacement (Efraimidis & Spirakis 2006) with weights that increase
// with the track length and decrease with the reprojection error and the local
// density. Cost: linear in observations, O(P log P) in points.
//
// Images that cannot be read have no thumbnail. An unreadable report is
// ignored with a warning.
[[nodiscard]] std::string MakeReportPage(const ReportPageInput& input,
                                         const ReportPageOptions& options,
                                         const Context& context);

// The same page for a run in progress, without a model. Once per second it asks
// the server it came from for `state`, a JSON object:
//
//   stage, progress   text; share  of the stage that is done, in [0, 1]
//   elapsed_s         since the start of the run
//   messages          the last ones, as an array of texts
//   model_version     changes when there is another `model`
//   finished          true: the server has the page of the final model in place
//                     of this one
//
// and for `model`, which MakeLiveModel() makes.
[[nodiscard]] std::string MakeLivePage(const std::string& title);

// The contents of the page of a model as a JSON object.
[[nodiscard]] std::string MakeLiveModel(const ReportPageInput& input,
                                        const ReportPageOptions& options,
                                        const Context& context);

}  // namespace mgsfm
