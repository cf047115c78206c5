// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Treatment of lines about images that a scene does not have. A finished model
// may lack images of its database.
enum class UnknownImages { kReject, kIgnore };

// The time, in nanoseconds, in the file name of an image; folders and extension
// are ignored. The first of these found in the name:
// 1. The last number that is a UNIX time between 1973 (2001 for seconds) and
//    2103 in s, ms, us or ns; its magnitude shows the unit. A fraction may
//    follow the seconds, after '.', after '_' with 3, 6 or 9 digits, or after
//    '-' with 9 digits: 1403636579.763555584, 1403636579-763555584,
//    n015__CAM_FRONT__1532402927612460. If other digits follow the seconds
//    after '_' or '-', the name has no time: they may be a fraction or a
//    counter.
// 2. A date with a time of day, and a fraction as above: 20230501_123456_789,
//    2013-05-28T08-46-02.904626944. It is interpreted as UTC.
// 3. Seconds with at least three decimals that are the whole name: 12.345.
// Counters such as 0000000250 are not times.
std::optional<int64_t> TimeInName(const std::string& image_name);

// Why a time cannot be in seconds; nullopt if it can.
std::optional<std::string> WhyNoTime(double time_s);

// The same for a name without folder and extension. A name that is a number,
// but not a time, is interpreted as seconds.
std::optional<int64_t> TimeOrNumberInStem(const std::string& stem);

// Times of exposure: one line "image_name SECONDS" per image; '#' starts
// comments.

// The times of the images with these names. Throws Error, naming the line or
// image, for an unreadable file, a malformed line, a time that is not finite,
// and an image that is unknown, listed twice or missing.
std::vector<double> ReadImageTimes(
    const std::filesystem::path& path, const std::vector<std::string>& names,
    UnknownImages others = UnknownImages::kReject);

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
                         UnknownImages others = UnknownImages::kReject);

// Images without a time are skipped.
void WriteImageTimestamps(const std::filesystem::path& path,
                          const Scene& scene);

}  // namespace mgsfm
