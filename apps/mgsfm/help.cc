// SPDX-License-Identifier: BSD-3-Clause
#include "help.h"

#include <algorithm>
#include <iterator>
#include <string_view>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "base/text_streams.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// The answer to option names of other programs.
struct Advice {
  const char* text;
  const char* names;  // separated by blanks
};

constexpr Advice kReplacedCommands[] = {
    {"use mapper or point_triangulator with --image_path", "color_extractor"},
    {"feature_extractor creates the database", "database_creator"},
    {"use image_undistorter, then this command of COLMAP",
     "delaunay_mesher patch_match_stereo poisson_mesher stereo_fusion"},
    {"use mapper", "global_mapper rotation_averager"},
    {"use report, which makes a page to open in a browser", "gui"},
    {"use mapper, for large drives with --partition", "hierarchical_mapper"},
    {"use mapper --input_path MODEL", "image_registrator"},
    {"use report --compare_path MODEL", "model_comparer"},
    {"bundle_adjuster removes inaccurate points", "point_filtering"},
    {"use mapper --use_prior_position", "pose_prior_mapper"},
    {"use automatic_reconstructor", "reconstruct"},
    {"use bundle_adjuster", "rig_bundle_adjuster"},
    {"use exhaustive_matcher or vocab_tree_matcher", "transitive_matcher"},
    {"mapper calibrates focal lengths itself", "view_graph_calibrator"},
};

// Options and what they replace: names without sections, which differ between
// the versions of COLMAP. The first one that the command has is used.
constexpr Advice kReplacements[] = {
    {"BundleAdjustment.function_tolerance", "ba_global_function_tolerance"},
    {"BundleAdjustment.max_max_error",
     "filter_max_reproj_error max_reproj_error"},
    {"BundleAdjustment.max_num_iterations", "ba_global_max_num_iterations"},
    {"BundleAdjustment.min_triangulation_angle_deg",
     "filter_min_tri_angle tri_min_angle"},
    {"BundleAdjustment.refine_extra_params", "ba_refine_extra_params"},
    {"BundleAdjustment.refine_focal_length", "ba_refine_focal_length"},
    {"BundleAdjustment.refine_principal_point", "ba_refine_principal_point"},
    {"BundleAdjustment.refine_rig_from_world", "refine_extrinsics"},
    {"BundleAdjustment.refine_sensor_from_rig", "ba_refine_sensor_from_rig"},
    {"ImageReader.camera_model", "camera_model"},
    {"ImageReader.camera_params", "camera_params"},
    {"ImageReader.mask_path", "mask_path"},
    {"ImageReader.single_camera", "single_camera"},
    {"ImageReader.single_camera_per_folder", "camera_mode"},
    {"Mapper.fix_existing_frames", "fix_existing_images"},
    {"SiftMatching.max_num_matches", "max_num_matches"},
    {"Tracks.min_track_length", "min_track_length"},
    {"TwoViewGeometry.confidence", "confidence"},
    {"TwoViewGeometry.detect_watermark", "ignore_watermarks"},
    {"TwoViewGeometry.max_error", "max_error"},
    {"TwoViewGeometry.max_num_trials", "max_num_trials"},
    {"TwoViewGeometry.min_inlier_ratio", "min_inlier_ratio"},
    {"ViewGraph.min_num_inliers", "min_num_matches"},
    {"TwoViewGeometry.min_num_inliers", "min_num_inliers min_num_matches"},
    {"VocabTree.vocab_tree_path", "vocab_tree_path"},
    {"alignment_max_error", "robust_alignment_max_error"},
    {"database_path", "database"},
    {"image_path", "extract_colors image_folder images"},
    {"match_list_path", "match_list_path"},
    {"num_overlap_frames", "overlap_ratio"},
    {"num_threads", "jobs num_threads threads"},
    {"output_format", "output_type"},
    {"path", "input_path"},
    {"random_seed", "seed"},
};

// Names without sections, or starts of names that end with '_'.
constexpr Advice kNeedlessOptions[] = {
    {"leave it out: all images are placed at once, not one after the other",
     "abs_pose_ ba_global_ ba_local_ ba_min_num_ init_ local_ba_ "
     "max_model_overlap max_reg_trials snapshot_ tri_"},
    {"leave it out: the mapper computes relative poses",
     "compute_relative_pose"},
    {"leave it out: unchanged images are copied", "copy_policy"},
    {"leave it out: COLMAP makes dense models of what image_undistorter writes",
     "dense mesher num_patch_match_src_images"},
    {"leave it out: descriptors are RootSIFT", "descriptor_normalization"},
    {"leave it out: features are not pooled", "domain_size_pooling dsp_"},
    {"leave it out: features are not affine", "estimate_affine_shape"},
    {"leave it out, or give intrinsics with --ImageReader.camera_params",
     "existing_camera_id"},
    {"leave it out: images are not enlarged", "first_octave"},
    {"leave it out: the processor does the work", "gpu_index use_gpu"},
    {"leave it out: function_tolerance and max_num_iterations end a solve",
     "gradient_tolerance max_linear_solver_iterations parameter_tolerance"},
    {"leave it out: messages go to the error stream", "log_to_stderr"},
    {"leave it out: the search is exhaustive",
     "loop_detection_num_ num_checks num_nearest_neighbors"},
    {"leave it out: the report names implausible focal lengths and distortion",
     "max_extra_param max_focal_length_ratio min_focal_length_ratio"},
    {"leave it out: each connected part is a model",
     "max_num_models multiple_models"},
    {"leave it out: planes are detected", "planar_scene"},
    {"use --config_path, a file with the options of this command, as "
     "--dump_config prints it",
     "project_path"},
    {"leave it out, or set --SiftExtraction.max_image_size and "
     "--SiftExtraction.max_num_features",
     "quality"},
    {"leave it out: distortion is kept", "skip_distortion"},
    {"leave it out: it is always made", "sparse"},
    {"use --num_clusters", "split_params split_type"},
    {"leave it out: features have orientations", "upright"},
    {"leave it out: loops at turns need no rule", "use_turning_loops"},
};

bool HasWord(const char* words_text, const std::string& wanted) {
  TextInput words(words_text);
  for (std::string word; words >> word;) {
    if (word == wanted) return true;
  }
  return false;
}

}  // namespace

std::optional<std::string> AdviceOnCommand(const std::string& name) {
  for (const auto& [advice, names] : kReplacedCommands) {
    if (HasWord(names, name)) return advice;
  }
  return std::nullopt;
}

std::optional<std::string> AdviceOnOption(const std::string& name,
                                          const OptionList& options) {
  const std::string key = name.substr(name.rfind('.') + 1);
  for (const auto& [replacement, names] : kReplacements) {
    if (!HasWord(names, key)) continue;
    for (const OptionEntry& option : options) {
      if (option.name == replacement) return "use --" + option.name;
    }
  }
  for (const OptionEntry& option : options) {
    // The section is missing.
    if (option.name.substr(option.name.rfind('.') + 1) == key) {
      return std::nullopt;
    }
  }
  for (const auto& [advice, starts] : kNeedlessOptions) {
    TextInput words(starts);
    for (std::string start; words >> start;) {
      const bool fits = start.back() == '_'
                            ? key.compare(0, start.size(), start) == 0
                            : key == start;
      if (fits) return advice;
    }
  }
  return std::nullopt;
}

namespace {

// The only list that separates basic from advanced options.
struct BasicHelp {
  std::string_view command;
  const char* example;  // what follows the command
  const char* options;  // separated by blanks; empty: all are basic
};

constexpr BasicHelp kBasicHelps[] = {
    {"automatic_reconstructor", "--image_path images --workspace_path work",
     "workspace_path image_path video_path recording_path data_type "
     "rig_config_path calibration_path rig_name_rule "
     "frame_max_time_difference_s use_prior_position write_report live_port"},
    {"mapper",
     "--database_path database.db --image_path images --output_path sparse",
     "database_path output_path image_path input_path output_format "
     "rig_config_path calibration_path rig_name_rule "
     "frame_max_time_difference_s use_prior_position use_prior_gravity "
     "image_timestamps_path compute_covariances SoftRig.method live_port"},
    {"bundle_adjuster", "--input_path sparse/0 --output_path adjusted",
     "input_path output_path output_format retriangulate compute_covariances "
     "rig_config_path rig_name_rule BundleAdjustment.refine_rig_from_world "
     "BundleAdjustment.refine_sensor_from_rig "
     "BundleAdjustment.refine_focal_length "
     "BundleAdjustment.refine_extra_params"},
    {"point_triangulator",
     "--database_path database.db --input_path poses --output_path model",
     "database_path input_path output_path image_path clear_points "
     "output_format rig_config_path rig_name_rule"},
    {"report",
     "--input_path sparse/0 --image_path images --output_path report.html",
     "input_path output_path database_path image_path compare_path gt_path "
     "gt_format max_size side_files figures"},
    {"image_undistorter",
     "--image_path images --input_path sparse/0 --output_path undistorted",
     "image_path input_path output_path output_type projection field_of_view "
     "blank_pixels max_image_size mask_path camera_mask_path"},
    {"feature_extractor", "--database_path database.db --image_path images",
     "database_path image_path image_list_path ImageReader.camera_model "
     "ImageReader.camera_params_path ImageReader.mask_path "
     "ImageReader.camera_mask_path ImageReader.single_camera_per_folder"},
    {"image_splitter",
     "--image_path panoramas --output_path views --image_type panorama",
     "image_path output_path image_type field_of_view max_image_size mask_path "
     "camera_mask_path camera_params_path"},
    {"video_sampler", "--video_path front.mp4 left.mp4 --output_path videos",
     "video_path output_path sampling rate min_motion alignment time_offsets"},
    {"recording_importer", "--recording_path drive.bag --output_path recording",
     "recording_path output_path image_topics sampling rate min_motion "
     "position_topic"},
    {"model_converter",
     "--input_path sparse/0 --output_path poses.txt --output_type tum",
     "input_path input_type output_path output_type poses "
     "image_timestamps_path image_path database_path origin"},
    {"model_aligner",
     "--input_path sparse/0 --output_path aligned --alignment_type plane",
     "input_path output_path alignment_type ref_images_path ref_is_gps "
     "database_path ref_model_path use_prior_gravity alignment_max_error "
     "transform_path"},
    {"model_evaluator",
     "--input_path sparse/0 --gt_path poses.txt --gt_format kitti",
     "input_path gt_path gt_format calib_path reference alignment gt_unit json "
     "svg_path"},
    {"feature_importer",
     "--database_path database.db --image_path images --import_path "
     "features.h5",
     ""},
    {"rig_configurator",
     "--database_path database.db --rig_config_path rig_config.json", ""},
    {"sequential_matcher", "--database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "SequentialMatching.overlap SequentialMatching.quadratic_overlap "
     "SequentialMatching.loop_detection"},
    {"exhaustive_matcher", "--database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "ExhaustiveMatching.block_size"},
    {"vocab_tree_matcher", "--database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "VocabTreeMatching.num_images"},
    {"vocab_tree_builder",
     "--database_path database.db --vocab_tree_path tree.bin", ""},
    {"spatial_matcher", "--database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "SpatialMatching.is_gps SpatialMatching.max_num_neighbors "
     "SpatialMatching.max_distance"},
    {"matches_importer",
     "--database_path database.db --match_list_path pairs.txt",
     "database_path match_list_path match_type rig_config_path "
     "calibration_path rig_name_rule"},
    {"geometric_verifier", "--database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "TwoViewGeometry.min_num_inliers TwoViewGeometry.max_error "
     "FeatureMatching.rig_verification"},
    {"model_analyzer", "--path sparse/0", ""},
    {"model_merger",
     "--input_path1 sparse/0 --input_path2 sparse/1 --output_path merged",
     "input_path1 input_path2 output_path min_common_images max_reproj_error "
     "graph input_path cluster_path database_path refine max_memory"},
    {"model_splitter", "--input_path sparse/0 --output_path parts", ""},
    {"model_cropper",
     "--input_path sparse/0 --output_path cropped --boundary 0.05,0.95", ""},
    {"image_deleter",
     "--input_path sparse/0 --output_path smaller --image_names_path names.txt",
     ""},
    {"database_merger",
     "--database_path1 a.db --database_path2 b.db --merged_database_path "
     "merged.db",
     ""},
    {"database_cleaner", "--database_path database.db --type matches", ""},
    {"simulate", "--preset standard --output_path drive",
     "output_path preset rig path num_frames pixel_noise rig_config_path "
     "trajectory_path render"},
};

constexpr char kCommonOptions[] = " num_threads random_seed log_level quiet";

OptionList SelectBasic(const BasicHelp& help, const OptionList& options) {
  if (*help.options == '\0') return options;
  TextInput words(std::string(help.options) + kCommonOptions);
  const std::vector<std::string> names{
      std::istream_iterator<std::string>(words), {}};
  OptionList basic;
  for (const OptionEntry& entry : options) {
    if (Contains(names, entry.name)) basic.push_back(entry);
  }
  MGSFM_CHECK_EQ(basic.size(), names.size());
  return basic;
}

// The part of a text before its first full stop, colon or semicolon.
std::string FirstClause(const std::string& text) {
  for (size_t i = 1; i + 1 < text.size(); ++i) {
    const char c = text[i];
    const bool is_end =
        c == ':' || c == ';' || (c == '.' && text[i - 1] != '.');
    if (is_end && text[i + 1] == ' ') return text.substr(0, i) + ".";
  }
  return text;
}

// Appends words to a line of 80 columns, and to further indented lines.
void AppendWords(std::string line, const std::string& words_text, size_t indent,
                 std::string* text) {
  TextInput words(words_text);
  for (std::string word; words >> word; line += word + " ") {
    if (line.size() + word.size() <= 80) continue;
    *text += line.substr(0, line.size() - 1) + "\n";
    line.assign(indent, ' ');
  }
  *text += line.substr(0, line.size() - 1) + "\n";
}

// "  --flag    What its help says first. [default]".
void AppendBriefly(const OptionEntry& entry, std::string* text) {
  const size_t indent = 30;
  std::string line = "  --" + entry.name;
  if (line.size() >= indent) {
    *text += line + "\n";
    line.clear();
  }
  std::string help = FirstClause(entry.help);
  const std::string value = FormatOptionValue(entry.default_value);
  if (!value.empty()) help += " [" + value + "]";
  line.resize(indent, ' ');
  AppendWords(std::move(line), help, indent, text);
}

constexpr char kSwitches[] =
    "\nFor all commands\n"
    "  --config_path FILE\n"
    "      Read options from a file in the format of --dump_config; flags\n"
    "      override it.\n"
    "  --dump_config\n"
    "      Print all options with their values, and exit.\n"
    "  --help, --help_all\n"
    "      Print the basic options, or all of them, and exit.\n";

}  // namespace

std::string MakeHelp(const std::string& command, const std::string& summary,
                     const OptionList& options, HelpLevel level) {
  const auto* const help = std::find_if(
      std::begin(kBasicHelps), std::end(kBasicHelps),
      [&](const BasicHelp& entry) { return entry.command == command; });
  const std::string title = "mgsfm " + command + ": ";
  if (help == std::end(kBasicHelps)) {
    return title + summary + "\n\n" + OptionsToHelp(options) + kSwitches;
  }
  const std::string example =
      "\nExample\n  mgsfm " + command + " " + help->example + "\n\n";
  if (level == HelpLevel::kAll) {
    return title + summary + "\n" + example + OptionsToHelp(options) +
           kSwitches;
  }
  std::string text;
  AppendWords(title, summary, 2, &text);
  text += example;
  const OptionList basic = SelectBasic(*help, options);
  for (const OptionEntry& entry : basic) AppendBriefly(entry, &text);
  text += "\n";
  AppendWords("[default]; ",
              (basic.size() < options.size()
                   ? std::to_string(options.size() - basic.size()) +
                         " more options and "
                   : "") +
                  "details: mgsfm " + command + " --help_all",
              2, &text);
  return text;
}

}  // namespace mgsfm
