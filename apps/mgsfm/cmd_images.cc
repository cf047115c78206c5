// SPDX-License-Identifier: BSD-3-Clause
#include "cmd_images.h"

#include <algorithm>
#include <charconv>
#include <system_error>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "command.h"
#include "commands.h"
#include "features/image_file.h"
#include "files/file_operations.h"
#include "imaging/image_splitting.h"
#include "mapper_run.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/features/feature_import.h"
#include "models/rows_to_scene.h"
#include "rigs/image_times.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// "96 images in 2.1 s, 45.2 images/s; ".
std::string Rate(size_t num_images, double seconds) {
  return Formatted("%zu images in %.1f s, %.3g images/s; ", num_images, seconds,
                   static_cast<double>(num_images) / std::max(seconds, 1e-9));
}

void LogSummary(const FeatureExtractionSummary& summary,
                const Context& context) {
  context.Info(Formatted(
      "%zu features of %s%zu images already had features, %zu were rejected",
      summary.num_features,
      Rate(summary.num_extracted, summary.seconds).c_str(), summary.num_present,
      summary.num_rejected));
}

}  // namespace

void ExtractInto(const std::string& database_path,
                 const std::string& image_path,
                 const FeatureExtractionOptions& options,
                 const std::optional<Share>& share, const Context& context) {
  const bool is_new = !fs::exists(database_path);
  std::optional<FeatureDatabase> database(std::in_place, database_path,
                                          FeatureDatabase::OpenMode::kOrCreate);
  try {
    LogSummary(share
                   ? ExtractFeatureShard(image_path, options, *share,
                                         &*database, context)
                   : ExtractFeatures(image_path, options, &*database, context),
               context);
  } catch (const Error&) {
    // A failed run leaves no empty database.
    const bool is_empty =
        is_new && database->ReadStructure(context).images.empty();
    database.reset();
    std::error_code ignored;
    if (is_empty) fs::remove(database_path, ignored);
    throw;
  }
}

void SampleVideosInto(const fs::path& output_path,
                      const std::string& video_paths,
                      const VideoSamplingOptions& options,
                      const Context& context) {
  const VideoSamplingSummary summary =
      SampleVideos(SplitVideoPaths(video_paths), output_path, options, context);
  context.Info(Formatted(
      "extracted %zu images of %zu frames in %.1f s; %zu were already there",
      summary.num_written, summary.num_frames, summary.seconds,
      summary.num_present));
  context.Info("images are in " + (output_path / "images").string() +
               ", their times in " + (output_path / "timestamps.txt").string());
}

RecordingImportSummary ImportRecordingInto(
    const fs::path& output_path, const std::string& recording_paths,
    const RecordingImportOptions& options, const Context& context) {
  RecordingImportSummary summary = ImportRecording(
      SplitVideoPaths(recording_paths), output_path, options, context);
  context.Info("imported " + Rate(summary.num_written, summary.seconds) +
               std::to_string(summary.num_present) + " were already there");
  std::string next = "images are in " + (output_path / "images").string();
  const auto add = [&](const char* option, const std::string& value) {
    next += std::string("; --") + option + " " + value;
  };
  if (!summary.rig_config_path.empty()) {
    add("rig_config_path", summary.rig_config_path.string());
  }
  if (!summary.positions_path.empty()) {
    add("ref_images_path", summary.positions_path.string());
    if (summary.positions_are_gps) add("ref_is_gps", "1");
  }
  if (!summary.gravity_path.empty()) {
    add("gravity_path", summary.gravity_path.string());
    if (options.gravity_axes == GravityAxes::kImu) {
      add("body_calibration", "FILE");
    }
  }
  if (summary.max_time_difference_s > 0.0) {
    add("frame_max_time_difference_s",
        Formatted("%.6g", summary.max_time_difference_s));
  }
  context.Info(next);
  return summary;
}

std::string Describe(const ImageRunSummary& summary) {
  return Rate(summary.num_written, summary.seconds) +
         std::to_string(summary.num_present) + " were already there";
}

void UseExifTimes(const std::string& image_path,
                  const std::vector<std::string>& names,
                  const fs::path& output_path, const Context& context,
                  SceneLoadingOptions* loading) {
  const bool names_suffice = AllOf(names, [](const std::string& name) {
    return TimeInName(name).has_value();
  });
  if (!loading->PairsFramesByTime() ||
      !loading->image_timestamps_path->empty() || names_suffice) {
    return;
  }
  std::string lines = "# image_name SECONDS, of EXIF tags\n";
  for (const std::string& name : names) {
    context.CheckInterrupted();
    const std::string path = (fs::path(image_path) / name).string();
    const auto time_s = ReadTags(ReadImageFile(path), 1, 1).time_s;
    if (!time_s) {
      throw Error("image '" + path +
                  "' has no time in its name or EXIF tags; list the times of "
                  "all images in a file and set image_timestamps_path");
    }
    lines +=
        name + ' ' + FormatDouble(*time_s, std::chars_format::fixed, 6) + '\n';
  }
  std::error_code ignored;
  if (fs::exists(output_path, ignored) && ReadFile(output_path) != lines) {
    throw Error("'" + output_path.string() +
                "' exists, but does not hold the times of the EXIF tags; set "
                "image_timestamps_path to use it, or remove it");
  }
  ReplaceFile(output_path, lines);
  context.Info("the times of EXIF tags are in " + output_path.string());
  loading->image_timestamps_path = output_path.string();
}

namespace {

struct FeatureExtractorOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add features to this COLMAP database, which is created if missing. "
      "Images that have features there are skipped."};
  Option<std::string> image_path{
      "image_path", "", Required(),
      "Read the images of this folder and its subfolders."};
  Option<std::string> shard{
      "shard", "",
      "Extract share i of n, such as 3/8, into a separate database. "
      "database_merger joins these databases. Set it to use several processes "
      "or machines."};
  FeatureExtractionOptions extraction;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, image_path, shard, extraction);
  }
};

int RunFeatureExtractor(const FeatureExtractorOptions& options,
                        const Context& context) {
  std::optional<Share> share;
  if (!options.shard->empty()) share = ParseShare(options.shard);
  ExtractInto(options.database_path, options.image_path, options.extraction,
              share, context);
  return kExitSuccess;
}

struct FeatureImporterOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add features to this COLMAP database, which is created if missing."};
  FeatureImportOptions import;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, import);
  }
};

int RunFeatureImporter(const FeatureImporterOptions& options,
                       const Context& context) {
  FeatureDatabase database(options.database_path,
                           FeatureDatabase::OpenMode::kOrCreate);
  const FeatureImportSummary summary =
      ImportFeatures(options.import, &database, context);
  context.Info(
      Formatted("%zu features of %zu images, %zu images already had features; "
                "%zu matches of %zu pairs",
                summary.num_features, summary.num_images - summary.num_present,
                summary.num_present, summary.num_matches, summary.num_pairs));
  context.Info("next: verify the matches with geometric_verifier");
  return kExitSuccess;
}

struct VideoSamplerOptions {
  Option<std::string> video_path{
      "video_path", "", Required(),
      "Sample these videos, one per camera of the rig, separated by spaces or "
      "commas. The first video determines which frames are sampled."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write images/VIDEO/TIME.jpg and timestamps.txt into this folder. Images "
      "of an interrupted run with the same settings are kept."};
  VideoSamplingOptions sampling;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(video_path, output_path, sampling);
  }
};

int RunVideoSampler(const VideoSamplerOptions& options,
                    const Context& context) {
  SampleVideosInto(*options.output_path, options.video_path, options.sampling,
                   context);
  return kExitSuccess;
}

struct RecordingImporterOptions {
  Option<std::string> recording_path{"recording_path", "", Required(),
                                     "Read this recording: ROS 1 bags, MCAP or "
                                     ".db3 files of ROS 2, or folders "
                                     "of them, separated by spaces or commas."};
  Option<std::string> output_path{
      "output_path", "",
      "Write images/CAMERA/TIME.png, rig_config.json, positions.txt and "
      "gravity.txt into this folder. Images of an interrupted run with the "
      "same settings are kept. By default, only the topics of the recording "
      "are listed."};
  RecordingImportOptions import;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(recording_path, output_path, import);
  }
};

CommandResult RunRecordingImporter(const RecordingImporterOptions& options,
                                   const Context& context) {
  if (options.output_path->empty()) {
    return {kExitSuccess,
            ListTopics(SplitVideoPaths(options.recording_path), context)};
  }
  (void)ImportRecordingInto(*options.output_path, options.recording_path,
                            options.import, context);
  return kExitSuccess;
}

struct ImageSplitterOptions {
  Option<std::string> image_path{
      "image_path", "", Required(),
      "Read the images of this folder and its subfolders."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write images and, for panoramas, cameras.txt and rig_config.json into "
      "this folder. Images of an interrupted run with the same settings are "
      "kept."};
  Option<CombinedImages> image_type{
      "image_type", CombinedImages::kPanorama,
      "Choose the kind of images. panorama: equirectangular images, split into "
      "six perspective views. dual_fisheye: two square fisheye images side by "
      "side, split into left and right."};
  Option<std::string> image_list_path{
      "image_list_path", "",
      "Use only the images listed in this file, one per line, relative to the "
      "image folder. By default, all images of the folder are used."};
  Option<std::string> mask_path{"mask_path", "",
                                "Split the masks in this folder, too, such as "
                                "pano/a.jpg.png for pano/a.jpg."};
  Option<std::string> camera_mask_path{
      "camera_mask_path", "",
      "Split the masks of cameras, too: pano.png in this folder for all images "
      "below pano, or a file for all images."};
  Option<std::string> camera_params_path{
      "camera_params_path", "",
      "Read the intrinsics of ordinary cameras beside the panoramas from this "
      "file, in the format of ImageReader.camera_params_path."};
  Option<std::string> rig_config_path{
      "rig_config_path", "",
      "Read the known poses of the folders of panoramas, and of ordinary "
      "cameras, in their rig from this rig_config.json. Without it, the poses "
      "of the views of all but the first panorama are estimated."};
  SplittingOptions splitting;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(image_path, output_path, image_type, image_list_path, mask_path,
          camera_mask_path, camera_params_path, rig_config_path, splitting);
  }
};

int RunImageSplitter(const ImageSplitterOptions& options,
                     const Context& context) {
  CheckImagePath(options.image_path);
  const ImageRunSummary summary =
      SplitImages({*options.image_path,
                   ListImages(options.image_path, options.image_list_path,
                              options.mask_path, options.camera_mask_path),
                   {*options.mask_path, *options.camera_mask_path},
                   *options.camera_params_path,
                   *options.output_path,
                   *options.rig_config_path},
                  options.image_type, options.splitting, context);
  context.Info("split " + Describe(summary));
  return kExitSuccess;
}

struct RigConfiguratorOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Replace the rigs and frames of this COLMAP database; its features and "
      "matches stay."};
  Option<std::string> image_path{
      "image_path", "",
      "Read EXIF times from the images in this folder if "
      "frame_max_time_difference_s needs times that image names lack. The "
      "times are written to timestamps.txt beside the database."};
  SceneLoadingOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, image_path, rigs);
  }
};

// The rigs with times from the EXIF tags of images, if they are needed.
SceneLoadingOptions WithExifTimes(const RigConfiguratorOptions& options,
                                  const FeatureDatabase& database,
                                  const Context& context) {
  SceneLoadingOptions rigs = options.rigs;
  if (options.image_path->empty()) return rigs;
  CheckImagePath(options.image_path);
  const std::vector<std::string> names =
      Transformed(database.ReadStructure(context).images, &ImageRow::name);
  const fs::path path = *options.database_path;
  UseExifTimes(options.image_path, names, path.parent_path() / "timestamps.txt",
               context, &rigs);
  return rigs;
}

int RunRigConfigurator(const RigConfiguratorOptions& options,
                       const Context& context) {
  FeatureDatabase database(options.database_path,
                           FeatureDatabase::OpenMode::kExisting);
  const RigConfigurationSummary summary = ConfigureRigs(
      WithExifTimes(options, database, context), &database, context);
  context.Info(
      Formatted("rigs from %s: %zu rigs of %zu cameras, %zu frames, %zu images",
                summary.rig_source.c_str(), summary.num_rigs,
                summary.num_sensors, summary.num_frames, summary.num_images));
  return kExitSuccess;
}

}  // namespace

std::vector<Command> ImageCommands() {
  return {
      MakeResumableCommand("feature_extractor",
                           "Extracts SIFT features from images.",
                           RunFeatureExtractor),
      MakeCommand(
          "feature_importer",
          "Imports features and matches of other programs, in hloc's format.",
          RunFeatureImporter),
      MakeResumableCommand(
          "image_splitter",
          "Splits panoramas and dual fisheye images into the images of rigs.",
          RunImageSplitter),
      MakeResumableCommand(
          "video_sampler",
          "Extracts images of videos, one video per camera of a rig.",
          RunVideoSampler),
      MakeResumableCommand(
          "recording_importer",
          "Imports images, calibration, positions and gravity of ROS bags and "
          "MCAP files.",
          RunRecordingImporter),
      MakeCommand("rig_configurator", "Writes rigs and frames to a database.",
                  RunRigConfigurator)};
}

}  // namespace mgsfm
