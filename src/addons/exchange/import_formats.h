// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {

// Models of other programs. Each reader throws Error, naming the file, the line
// or item, and the remedy, for malformed files.

struct ImportInput {
  std::filesystem::path path;
  // Folder of the images, for the sizes that a format lacks; may be empty.
  std::filesystem::path image_path;
  // Bundler's list of images; empty: the one beside the file.
  std::filesystem::path list_path;
};

struct ImportFormat {
  std::string_view name;
  Model (*read)(const ImportInput& input, const Context& context);
  std::string_view extension;
};

// Upper and lower case are the same. nullptr for an unknown name.
const ImportFormat* FindImportFormat(const std::string& name);
std::vector<std::string> ImportFormatNames();

// Goes by the extension of the file; nullptr if no format has it.
const ImportFormat* GuessImportFormat(const std::filesystem::path& path);

// VisualSFM, of which the first model is read. Principal points are those of a
// fixed calibration, else the centers of the images. Pixels count from the
// principal point if any is negative, else from the upper left corner, as in
// files of COLMAP. The only coefficient of distortion has COLMAP's sign.
Model ReadNvm(const ImportInput& input, const Context& context);

// Bundler v0.3. Principal points are the centers of the images.
Model ReadBundler(const ImportInput& input, const Context& context);

// transforms.json of nerfstudio and instant-ngp. The world is that of the file;
// the points of ply_file_path have no tracks.
Model ReadNerfstudio(const ImportInput& input, const Context& context);

}  // namespace mgsfm
