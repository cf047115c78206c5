// SPDX-License-Identifier: BSD-3-Clause
#include "help.h"

#include <algorithm>
#include <iterator>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/text_streams.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// The one place that tells basic options from advanced ones.
struct BasicHelp {
  std::string_view command;
  const char* example;
  const char* options;  // separated by blanks; empty: all are basic
};

constexpr BasicHelp kBasicHelps[] = {
    {"automatic_reconstructor",
     "mgsfm automatic_reconstructor --image_path images --workspace_path work",
     "workspace_path image_path video_path data_type rig_config_path "
     "calibration_path "
     "rig_name_rule frame_max_time_difference_s use_prior_position "
     "write_report live_port"},
    {"mapper",
     "mgsfm mapper --database_path database.db --image_path images "
     "--output_path sparse",
     "database_path output_path image_path input_path output_format "
     "rig_config_path calibration_path rig_name_rule "
     "frame_max_time_difference_s use_prior_position use_prior_gravity "
     "image_timestamps_path compute_covariances SoftRig.method live_port"},
    {"bundle_adjuster",
     "mgsfm bundle_adjuster --input_path sparse/0 --output_path adjusted",
     "input_path output_path output_format retriangulate compute_covariances "
     "rig_config_path rig_name_rule BundleAdjustment.refine_rig_from_world "
     "BundleAdjustment.refine_sensor_from_rig "
     "BundleAdjustment.refine_focal_length "
     "BundleAdjustment.refine_extra_params"},
    {"point_triangulator",
     "mgsfm point_triangulator --database_path database.db --input_path poses "
     "--output_path model",
     "database_path input_path output_path image_path clear_points "
     "output_format rig_config_path rig_name_rule"},
    {"report",
     "mgsfm report --input_path sparse/0 --image_path images --output_path "
     "report.html",
     "input_path output_path database_path image_path compare_path gt_path "
     "gt_format max_size side_files figures"},
    {"image_undistorter",
     "mgsfm image_undistorter --image_path images --input_path sparse/0 "
     "--output_path undistorted",
     "image_path input_path output_path output_type projection field_of_view "
     "blank_pixels max_image_size mask_path"},
    {"feature_extractor",
     "mgsfm feature_extractor --database_path database.db --image_path images",
     "database_path image_path image_list_path ImageReader.camera_model "
     "ImageReader.camera_params_path ImageReader.mask_path "
     "ImageReader.single_camera_per_folder"},
    {"image_splitter",
     "mgsfm image_splitter --image_path panoramas --output_path views "
     "--image_type panorama",
     "image_path output_path image_type field_of_view max_image_size "
     "mask_path camera_params_path"},
    {"video_sampler",
     "mgsfm video_sampler --video_path front.mp4 left.mp4 --output_path videos",
     "video_path output_path sampling rate min_motion alignment time_offsets"},
    {"model_converter",
     "mgsfm model_converter --input_path sparse/0 --output_path poses.txt "
     "--output_type tum",
     "input_path input_type output_path output_type poses "
     "image_timestamps_path image_path database_path origin"},
    {"model_aligner",
     "mgsfm model_aligner --input_path sparse/0 --output_path aligned "
     "--alignment_type plane",
     "input_path output_path alignment_type ref_images_path ref_is_gps "
     "database_path ref_model_path use_prior_gravity alignment_max_error "
     "transform_path"},
    {"model_evaluator",
     "mgsfm model_evaluator --input_path sparse/0 --gt_path poses.txt "
     "--gt_format kitti",
     "input_path gt_path gt_format calib_path reference alignment gt_unit "
     "json svg_path"},
    {"feature_importer",
     "mgsfm feature_importer --database_path database.db --image_path images "
     "--import_path features.h5",
     ""},
    {"rig_configurator",
     "mgsfm rig_configurator --database_path database.db --rig_config_path "
     "rig_config.json",
     ""},
    {"sequential_matcher",
     "mgsfm sequential_matcher --database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "SequentialMatching.overlap SequentialMatching.quadratic_overlap "
     "SequentialMatching.loop_detection"},
    {"exhaustive_matcher",
     "mgsfm exhaustive_matcher --database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "ExhaustiveMatching.block_size"},
    {"vocab_tree_matcher",
     "mgsfm vocab_tree_matcher --database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "VocabTreeMatching.num_images"},
    {"vocab_tree_builder",
     "mgsfm vocab_tree_builder --database_path database.db --vocab_tree_path "
     "tree.bin",
     ""},
    {"spatial_matcher", "mgsfm spatial_matcher --database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "SpatialMatching.is_gps SpatialMatching.max_num_neighbors "
     "SpatialMatching.max_distance"},
    {"matches_importer",
     "mgsfm matches_importer --database_path database.db --match_list_path "
     "pairs.txt",
     "database_path match_list_path match_type rig_config_path "
     "calibration_path rig_name_rule"},
    {"geometric_verifier",
     "mgsfm geometric_verifier --database_path database.db",
     "database_path rig_config_path calibration_path rig_name_rule "
     "TwoViewGeometry.min_num_inliers TwoViewGeometry.max_error "
     "FeatureMatching.rig_verification"},
    {"model_analyzer", "mgsfm model_analyzer --path sparse/0", ""},
    {"model_merger",
     "mgsfm model_merger --input_path1 sparse/0 --input_path2 sparse/1 "
     "--output_path merged",
     "input_path1 input_path2 output_path min_common_images max_reproj_error "
     "graph input_path cluster_path database_path refine max_memory"},
    {"model_splitter",
     "mgsfm model_splitter --input_path sparse/0 --output_path parts", ""},
    {"model_cropper",
     "mgsfm model_cropper --input_path sparse/0 --output_path cropped "
     "--boundary 0.05,0.95",
     ""},
    {"image_deleter",
     "mgsfm image_deleter --input_path sparse/0 --output_path smaller "
     "--image_names_path names.txt",
     ""},
    {"database_merger",
     "mgsfm database_merger --database_path1 a.db --database_path2 b.db "
     "--merged_database_path merged.db",
     ""},
    {"database_cleaner",
     "mgsfm database_cleaner --database_path database.db --type matches", ""},
    {"simulate", "mgsfm simulate --preset standard --output_path drive",
     "output_path preset rig path num_frames pixel_noise rig_config_path "
     "trajectory_path render"},
};

const char* const kCommonOptions[] = {"num_threads", "random_seed", "log_level",
                                      "quiet"};

OptionList SelectBasic(const BasicHelp& help, const OptionList& options) {
  TextInput words(help.options);
  const std::vector<std::string> names{
      std::istream_iterator<std::string>(words), {}};
  const auto is_basic = [&](const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end() ||
           std::find(std::begin(kCommonOptions), std::end(kCommonOptions),
                     name) != std::end(kCommonOptions);
  };
  if (names.empty()) return options;
  OptionList basic;
  for (const OptionEntry& entry : options) {
    if (is_basic(entry.name)) basic.push_back(entry);
  }
  MGSFM_CHECK_EQ(basic.size(), names.size() + std::size(kCommonOptions));
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

// Appends words to a line of 80 columns, and to further ones behind an indent.
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
      std::string("\nExample\n  ") + help->example + "\n\n";
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
