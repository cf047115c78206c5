// SPDX-License-Identifier: BSD-3-Clause
#include "files/model_files.h"

#include <algorithm>
#include <system_error>

#include "base/ranges.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

namespace fs = std::filesystem;

bool IsModelFileName(const fs::path& name) {
  static constexpr auto kTables = {"cameras", "images", "points3D", "rigs",
                                   "frames"};
  static constexpr auto kOthers = {"rig_config.json", "geo_origin.json",
                                   "covariances.csv", "frames.csv",
                                   kReportPageFileName};
  const bool is_table_format =
      name.extension() == ".bin" || name.extension() == ".txt";
  return (is_table_format && Contains(kTables, name.stem())) ||
         Contains(kOthers, name);
}

bool IsModelFolderName(const fs::path& name) {
  const std::string digits = name.string();
  return !digits.empty() && (digits == "0" || digits[0] != '0') &&
         AllOf(digits, [](char c) { return c >= '0' && c <= '9'; });
}

bool FolderContents::HoldsModel() const {
  return Contains(model_files, "images.bin") ||
         Contains(model_files, "images.txt");
}

FolderContents ListFolder(const fs::path& folder) {
  FolderContents contents;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    const fs::path name = it->path().filename();
    const bool is_model_file = IsModelFileName(name) && !it->is_directory();
    (is_model_file ? contents.model_files : contents.others)
        .push_back(name.string());
  }
  if (error) {
    throw Error("cannot read the folder '" + folder.string() +
                "': " + error.message() + "; choose another output path");
  }
  std::sort(contents.model_files.begin(), contents.model_files.end());
  std::sort(contents.others.begin(), contents.others.end());
  return contents;
}

bool IsReplacedByOutput(const fs::path& target, OutputKind kind,
                        const fs::path& file) {
  const fs::path folder = CanonicalPath(target);
  const fs::path path = CanonicalPath(file);
  const fs::path parent = path.parent_path();
  if (path.filename() == kReportFileName) return parent == folder;
  if (!IsModelFileName(path.filename())) return false;
  return kind == OutputKind::kModel ? parent == folder
                                    : parent.parent_path() == folder &&
                                          IsModelFolderName(parent.filename());
}

}  // namespace mgsfm
