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

// Names without sections, which differ between the versions of COLMAP. The
// first replacement that the command has counts.
const std::multimap<std::string, std::string>& ReplacedOptions() {
  static const std::multimap<std::string, std::string> kTable = {
      {"ba_global_function_tolerance", "BundleAdjustment.function_tolerance"},
      {"ba_global_max_num_iterations", "BundleAdjustment.max_num_iterations"},
      {"ba_refine_extra_params", "BundleAdjustment.refine_extra_params"},
      {"ba_refine_focal_length", "BundleAdjustment.refine_focal_length"},
      {"ba_refine_principal_point", "BundleAdjustment.refine_principal_point"},
      {"ba_refine_sensor_from_rig", "BundleAdjustment.refine_sensor_from_rig"},
      {"camera_mode", "ImageReader.single_camera_per_folder"},
      {"camera_model", "ImageReader.camera_model"},
      {"camera_params", "ImageReader.camera_params"},
      {"confidence", "TwoViewGeometry.confidence"},
      {"database", "database_path"},
      {"extract_colors", "image_path"},
      {"filter_max_reproj_error", "BundleAdjustment.max_max_error"},
      {"filter_min_tri_angle", "BundleAdjustment.min_triangulation_angle_deg"},
      {"fix_existing_images", "Mapper.fix_existing_frames"},
      {"ignore_watermarks", "TwoViewGeometry.detect_watermark"},
      {"image_folder", "image_path"},
      {"images", "image_path"},
      {"input_path", "path"},
      {"jobs", "num_threads"},
      {"mask_path", "ImageReader.mask_path"},
      {"match_list_path", "match_list_path"},
      {"max_error", "TwoViewGeometry.max_error"},
      {"max_num_matches", "SiftMatching.max_num_matches"},
      {"max_num_trials", "TwoViewGeometry.max_num_trials"},
      {"max_reproj_error", "BundleAdjustment.max_max_error"},
      {"min_inlier_ratio", "TwoViewGeometry.min_inlier_ratio"},
      {"min_num_inliers", "TwoViewGeometry.min_num_inliers"},
      {"min_num_matches", "ViewGraph.min_num_inliers"},
      {"min_num_matches", "TwoViewGeometry.min_num_inliers"},
      {"min_track_length", "Tracks.min_track_length"},
      {"num_threads", "num_threads"},
      {"output_type", "output_format"},
      {"overlap_ratio", "num_overlap_frames"},
      {"refine_extrinsics", "BundleAdjustment.refine_rig_from_world"},
      {"robust_alignment_max_error", "alignment_max_error"},
      {"seed", "random_seed"},
      {"single_camera", "ImageReader.single_camera"},
      {"threads", "num_threads"},
      {"tri_min_angle", "BundleAdjustment.min_triangulation_angle_deg"},
      {"vocab_tree_path", "VocabTree.vocab_tree_path"}};
  return kTable;
}

// Names without sections, or starts of names that end with '_'.
const Table& NeedlessOptions() {
  static const char* const kNoGpu = "leave it out: the processor does the work";
  static const char* const kGlobal =
      "leave it out: all images are placed at once, not one after the other";
  static const char* const kDense =
      "leave it out: COLMAP makes dense models of what image_undistorter "
      "writes";
  static const char* const kCriteria =
      "leave it out: function_tolerance and max_num_iterations end a solve";
  static const char* const kPlausible =
      "leave it out: the report names implausible focal lengths and distortion";
  static const char* const kNotPooled = "leave it out: features are not pooled";
  static const Table kTable = {
      {"abs_pose_", kGlobal},
      {"ba_global_", kGlobal},
      {"ba_local_", kGlobal},
      {"ba_min_num_", kGlobal},
      {"compute_relative_pose",
       "leave it out: the mapper computes relative poses"},
      {"copy_policy", "leave it out: unchanged images are copied"},
      {"dense", kDense},
      {"descriptor_normalization", "leave it out: descriptors are RootSIFT"},
      {"domain_size_pooling", kNotPooled},
      {"dsp_", kNotPooled},
      {"estimate_affine_shape", "leave it out: features are not affine"},
      {"existing_camera_id",
       "leave it out, or give intrinsics with --ImageReader.camera_params"},
      {"first_octave", "leave it out: images are not enlarged"},
      {"gpu_index", kNoGpu},
      {"gradient_tolerance", kCriteria},
      {"guided_matching", "leave it out: matching is not repeated"},
      {"init_", kGlobal},
      {"local_ba_", kGlobal},
      {"log_to_stderr", "leave it out: messages go to the error stream"},
      {"loop_detection_num_", "leave it out: the search is exhaustive"},
      {"max_extra_param", kPlausible},
      {"max_focal_length_ratio", kPlausible},
      {"max_linear_solver_iterations", kCriteria},
      {"max_model_overlap", kGlobal},
      {"max_num_models", "leave it out: each connected part is a model"},
      {"max_reg_trials", kGlobal},
      {"mesher", kDense},
      {"min_focal_length_ratio", kPlausible},
      {"multiple_models", "leave it out: each connected part is a model"},
      {"num_checks", "leave it out: the search is exhaustive"},
      {"num_nearest_neighbors", "leave it out: the search is exhaustive"},
      {"num_patch_match_src_images", kDense},
      {"parameter_tolerance", kCriteria},
      {"planar_scene", "leave it out: planes are detected"},
      {"project_path",
       "use --config_path, a file with the options of this command, as "
       "--dump_config prints it"},
      {"quality",
       "leave it out, or set --SiftExtraction.max_image_size and "
       "--SiftExtraction.max_num_features"},
      {"skip_distortion", "leave it out: distortion is kept"},
      {"snapshot_", kGlobal},
      {"sparse", "leave it out: it is always made"},
      {"split_params", "use --num_clusters"},
      {"split_type", "use --num_clusters"},
      {"tri_", kGlobal},
      {"upright", "leave it out: features have orientations"},
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
  const auto [begin, end] = ReplacedOptions().equal_range(key);
  for (auto replacement = begin; replacement != end; ++replacement) {
    for (const OptionEntry& option : options) {
      if (option.name == replacement->second) return "use --" + option.name;
    }
  }
  for (const OptionEntry& option : options) {
    // The section is missing.
    if (option.name.substr(option.name.rfind('.') + 1) == key) {
      return std::nullopt;
    }
  }
  for (const auto& [start, advice] : NeedlessOptions()) {
    const bool fits = start.back() == '_'
                          ? key.compare(0, start.size(), start) == 0
                          : key == start;
    if (fits) return advice;
  }
  return std::nullopt;
}

}  // namespace mgsfm
