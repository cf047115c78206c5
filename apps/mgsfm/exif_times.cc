// SPDX-License-Identifier: BSD-3-Clause
#include "exif_times.h"

#include <algorithm>
#include <charconv>

#include "base/file_reading.h"
#include "base/text.h"
#include "features/image_file.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"
#include "rigs/image_times.h"

namespace mgsfm {

void UseExifTimes(const std::string& image_path,
                  const std::vector<std::string>& names,
                  const std::filesystem::path& output_path,
                  const Context& context, SceneLoadingOptions* loading) {
  const bool names_suffice = std::all_of(
      names.begin(), names.end(),
      [](const std::string& name) { return TimeInName(name).has_value(); });
  if (!loading->PairsFramesByTime() ||
      !loading->image_timestamps_path->empty() || names_suffice) {
    return;
  }
  std::string lines = "# image_name SECONDS, of EXIF tags\n";
  for (const std::string& name : names) {
    context.CheckInterrupted();
    const std::string path =
        (std::filesystem::path(image_path) / name).string();
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
  if (std::filesystem::exists(output_path, ignored) &&
      ReadFile(output_path) != lines) {
    throw Error("'" + output_path.string() +
                "' exists, but does not hold the times of the EXIF tags; set "
                "image_timestamps_path to use it, or remove it");
  }
  ReplaceFile(output_path, lines);
  context.Info("the times of EXIF tags are in " + output_path.string());
  loading->image_timestamps_path = output_path.string();
}

}  // namespace mgsfm
