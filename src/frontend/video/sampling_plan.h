// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// Times are in ascending order.

// The images nearest to the times t0, t0 + 1 / rate, ... up to the last image,
// where t0 is the time of the first image; ties go to the earlier image. Each
// image is selected at most once.
std::vector<int> SelectByRate(const std::vector<int64_t>& times_ns,
                              double rate_hz);

// For each instant, the nearest image if they are at most `max_difference_ns`
// apart. One to one: an image that is nearest to several instants belongs to
// the nearest of them; ties go to the earlier instant.
std::vector<std::optional<int>> SelectAtInstants(
    const std::vector<int64_t>& instants_ns,
    const std::vector<int64_t>& times_ns, int64_t max_difference_ns);

// The median time between two images; nullopt for fewer than two.
std::optional<int64_t> MedianInterval(const std::vector<int64_t>& times_ns);

// One instant of a rig.
struct SampledFrame {
  std::string name;  // without folder and extension
  // The time stamp of the image of each video, if there is one.
  std::vector<std::optional<int64_t>> times_ns;
};

// The images that are extracted from each video.
struct SamplingPlan {
  std::vector<std::string> folders;  // one per video
  // Offsets to add to time stamps to get times on a common clock.
  std::vector<int64_t> offsets_ns;
  std::vector<SampledFrame> frames;
};

// The name of a frame: its time since the first one, such as 000012.345. All
// names of a recording have the same number of decimals, three if this makes
// them distinct.
std::vector<std::string> NamesOfTimes(const std::vector<int64_t>& times_ns);

// Folders of the images: the names of the videos without extension or, if some
// of these are equal, of the folders of the videos. Throws Error if these are
// equal, too.
std::vector<std::string> FoldersOfVideos(
    const std::vector<std::filesystem::path>& paths);

// The plan of an earlier run with the same settings, a JSON text. nullopt if
// there is no earlier run. Throws Error if the folder holds images of other or
// unknown settings.
std::optional<SamplingPlan> ReadPlan(const std::filesystem::path& output_path,
                                     const std::string& settings);

// Begins a run that later runs can continue.
void WritePlan(const std::filesystem::path& output_path,
               const std::string& settings, const SamplingPlan& plan);

}  // namespace mgsfm
