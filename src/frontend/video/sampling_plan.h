// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// One instant of a rig.
struct SampledFrame {
  std::string name;  // without folder and extension
  // The time stamp of the image of each video, if there is one.
  std::vector<std::optional<int64_t>> times_ns;
};

// The images that are extracted from each video.
struct SamplingPlan {
  std::vector<std::string> folders;  // one per video
  // Add them to time stamps to get times on a common clock.
  std::vector<int64_t> offsets_ns;
  std::vector<SampledFrame> frames;
};

// The name of a frame: its time since the first one, such as 000012.345. All
// names of a recording have the same number of decimals, three if that suffices
// to tell them apart.
std::vector<std::string> NamesOfTimes(const std::vector<int64_t>& times_ns);

// Folders of the images: the names of the videos without extension or, if some
// of these are equal, of the folders of the videos. Throws Error if these are
// equal, too.
std::vector<std::string> FoldersOfVideos(
    const std::vector<std::filesystem::path>& paths);

// The plan of an earlier run with the same settings, a JSON text. nullopt if
// there is no earlier run. Throws Error if the folder holds images of other
// settings, or of unknown ones.
std::optional<SamplingPlan> ReadPlan(const std::filesystem::path& output_path,
                                     const std::string& settings);

// Begins a run, which later ones continue.
void WritePlan(const std::filesystem::path& output_path,
               const std::string& settings, const SamplingPlan& plan);

}  // namespace mgsfm
