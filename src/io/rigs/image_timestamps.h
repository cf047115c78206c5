// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "files/other_images.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Times of exposure: one line "image_name SECONDS" per image; '#' starts
// comments.

// The times of the images with these names. Throws Error, naming the line or
// image, for an unreadable file, a malformed line, a time that is not finite,
// and an image that is unknown, listed twice or missing.
std::vector<double> ReadImageTimes(const std::filesystem::path& path,
                                   const std::vector<std::string>& names,
                                   OtherImages others = OtherImages::kReject);

// Throws Error for lines as above, although images may be missing.
void CheckImageTimes(const std::filesystem::path& path,
                     const std::vector<std::string>& names);

// Why the times of a file are probably not in seconds: images of a moving rig
// overlap only if less lies between them. nullopt if they may be.
std::optional<std::string> WhyTimesAreNotSeconds(
    const std::filesystem::path& path, const Scene& scene);

// Sets the times of all images. Throws Error as above, and for frames of a rig
// whose times do not increase in the natural order of their names ("9" before
// "10").
void ReadImageTimestamps(const std::filesystem::path& path, Scene* scene,
                         OtherImages others = OtherImages::kReject);

// Images without a time are skipped.
void WriteImageTimestamps(const std::filesystem::path& path,
                          const Scene& scene);

}  // namespace mgsfm
