// SPDX-License-Identifier: BSD-3-Clause
#include "colmap_names.h"

#include <map>

namespace mgsfm {
namespace {

using Table = std::map<std::string, std::string>;

const Table& Commands() {
  static const char* const kDense =
      "use image_undistorter, then this command of COLMAP";
  static const Table kTable = {
      {"color_extractor", "use mapper or point_triangulator with --image_path"},
      {"database_creator", "feature_extractor creates the database"},
      {"delaunay_mesher", kDense},
      {"global_mapper", "use mapper"},
      {"gui", "use report, which makes a page to open in a browser"},
      {"hierarchical_mapper", "use mapper, for large drives with --partition"},
      {"image_registrator", "use mapper --input_path MODEL"},
      {"model_comparer", "use report --compare_path MODEL"},
      {"patch_match_stereo", kDense},
      {"point_filtering", "bundle_adjuster removes inaccurate points"},
      {"poisson_mesher", kDense},
      {"pose_prior_mapper", "use mapper --use_prior_position"},
      {"reconstruct", "use automatic_reconstructor"},
      {"rig_bundle_adjuster", "use bundle_adjuster"},
      {"rotation_averager", "use mapper"},
      {"stereo_fusion", kDense},
      {"transitive_matcher", "use exhaustive_matcher or vocab_tree_matcher"},
      {"view_graph_calibrator", "mapper calibrates focal lengths itself"}};
  return kTable;
}

// Names without sections, which differ between the versions of COLMAP.
const Table& ReplacedOptions() {
  static const Table kTable = {
      {"ba_global_function_tolerance", "BundleAdjustment.function_tolerance"},
      {"ba_global_max_num_iterations", "BundleAdjustment.max_num_iterations"},
      {"ba_refine_extra_params", "BundleAdjustment.refine_extra_params"},
      {"ba_refine_focal_length", "BundleAdjustment.refine_focal_length"},
      {"ba_refine_principal_point", "BundleAdjustment.refine_principal_point"},
      {"ba_refine_sensor_from_rig", "BundleAdjustment.refine_sensor_from_rig"},
      {"database", "database_path"},
      {"image_folder", "image_path"},
      {"images", "image_path"},
      {"jobs", "num_threads"},
      {"num_threads", "num_threads"},
      {"output_type", "output_format"},
      {"robust_alignment_max_error", "alignment_max_error"},
      {"seed", "random_seed"},
      {"threads", "num_threads"}};
  return kTable;
}

const Table& NeedlessOptions() {
  static const char* const kNoGpu = "leave it out: the processor does the work";
  static const Table kTable = {
      {"domain_size_pooling", "leave it out: features are not pooled"},
      {"estimate_affine_shape", "leave it out: features are not affine"},
      {"gpu_index", kNoGpu},
      {"log_to_stderr", "leave it out: messages go to the error stream"},
      {"project_path", "use --config_path"},
      {"use_gpu", kNoGpu}};
  return kTable;
}

std::optional<std::string> Find(const Table& table, const std::string& name) {
  const auto found = table.find(name);
  if (found == table.end()) return std::nullopt;
  return found->second;
}

}  // namespace

std::optional<std::string> AdviceOnCommand(const std::string& name) {
  return Find(Commands(), name);
}

std::optional<std::string> AdviceOnOption(const std::string& name,
                                          const OptionList& options) {
  const std::string key = name.substr(name.rfind('.') + 1);
  const auto replacement = Find(ReplacedOptions(), key);
  if (!replacement) return Find(NeedlessOptions(), key);
  for (const OptionEntry& option : options) {
    if (option.name == *replacement) return "use --" + *replacement;
  }
  return std::nullopt;
}

}  // namespace mgsfm
