// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace mgsfm {

// The single list of the files that make up a model on disk. Outputs replace
// only these files.

// cameras, images, points3D, rigs and frames as .bin or .txt; rig_config.json,
// geo_origin.json, covariances.csv, frames.csv and report.html.
bool IsModelFileName(const std::filesystem::path& name);

// "0", "1", ...: the names of the model folders of a mapper run.
bool IsModelFolderName(const std::filesystem::path& name);

// The report beside the models of a run.
constexpr char kReportFileName[] = "report.json";

// The page of a model.
constexpr char kReportPageFileName[] = "report.html";

// The entries of a folder in the order of their names, sorted by their role.
struct FolderContents {
  std::vector<std::string> model_files;
  std::vector<std::string> others;

  // Has images.bin or images.txt.
  bool HoldsModel() const;
  bool IsEmpty() const { return model_files.empty() && others.empty(); }
};

// A subfolder never is a model file. Throws Error if the folder cannot be read.
FolderContents ListFolder(const std::filesystem::path& folder);

enum class OutputKind {
  kRun,    // holds models in folders "0", "1", ...
  kModel,  // is a model
};

// Returns whether an output may replace or remove this file.
bool IsReplacedByOutput(const std::filesystem::path& target, OutputKind kind,
                        const std::filesystem::path& file);

}  // namespace mgsfm
