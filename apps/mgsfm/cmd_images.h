// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "imaging/image_run.h"
#include "mgsfm/base/context.h"
#include "mgsfm/features/feature_extraction.h"
#include "mgsfm/models/scene_loading.h"
#include "recordings/recording_import.h"
#include "video/video_sampling.h"

namespace mgsfm {

// Extracts the features of images, or of a share of them, into a database on
// disk. Throws Error for bad input, after removing a database that it created
// and left empty.
void ExtractInto(const std::string& database_path,
                 const std::string& image_path,
                 const FeatureExtractionOptions& options,
                 const std::optional<Share>& share, const Context& context);

// SampleVideos for a list of videos separated by commas; logs the result.
void SampleVideosInto(const std::filesystem::path& output_path,
                      const std::string& video_paths,
                      const VideoSamplingOptions& options,
                      const Context& context);

// ImportRecording for a list of recordings separated by commas; logs the result
// and the options of later commands.
RecordingImportSummary ImportRecordingInto(
    const std::filesystem::path& output_path,
    const std::string& recording_paths, const RecordingImportOptions& options,
    const Context& context);

// "96 images in 2.1 s, 45.2 images/s; 0 were already there".
std::string Describe(const ImageRunSummary& summary);

// Acts only if frames are formed by time, no file of times is given, and some
// image name contains no time. Writes the times in the EXIF tags of all images
// to `output_path` and makes it the file of times. Throws Error, naming the
// image, if an image has no such tag.
void UseExifTimes(const std::string& image_path,
                  const std::vector<std::string>& names,
                  const std::filesystem::path& output_path,
                  const Context& context, SceneLoadingOptions* loading);

}  // namespace mgsfm
