// SPDX-License-Identifier: BSD-3-Clause
#include "output_check.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <system_error>
#include <utility>
#include <vector>

#include "base/file_reading.h"
#include "base/text_tools.h"
#include "database/sqlite_database.h"
#include "files/file_operations.h"
#include "files/image_limits.h"
#include "files/image_reading.h"
#include "files/model_files.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Returns whether an output at `target` would replace `file`.
using Replaces = bool (*)(const fs::path& target, const fs::path& file);

bool IsSameFile(const fs::path& target, const fs::path& file) {
  std::error_code ignored;  // where one is missing
  return fs::equivalent(target, file, ignored);
}

bool RunReplaces(const fs::path& target, const fs::path& file) {
  return IsReplacedByOutput(target, OutputKind::kRun, file);
}

bool ModelReplaces(const fs::path& target, const fs::path& file) {
  return IsReplacedByOutput(target, OutputKind::kModel, file);
}

bool SplittingReplaces(const fs::path& target, const fs::path& file) {
  return IsSameFile(target / "cameras.txt", file) ||
         IsSameFile(target / "rig_config.json", file);
}

bool VideosReplace(const fs::path& target, const fs::path& file) {
  return IsSameFile(target / "timestamps.txt", file) ||
         IsSameFile(target / "video_sampling.json", file);
}

bool WorkspaceReplaces(const fs::path& target, const fs::path& file) {
  return IsSameFile(target / "database.db", file) ||
         SplittingReplaces(target / "views", file) ||
         VideosReplace(target / "videos", file) ||
         RunReplaces(target / "sparse", file);
}

bool UndistortionReplaces(const fs::path& target, const fs::path& file) {
  for (const char* name :
       {"undistortion.json", "transforms.json", "sparse_pc.ply"}) {
    if (IsSameFile(target / name, file)) return true;
  }
  return ModelReplaces(target / "sparse", file) ||
         ModelReplaces(target / "sparse" / "0", file) ||
         ModelReplaces(target / "colmap" / "sparse" / "0", file);
}

bool SimulationReplaces(const fs::path& target, const fs::path& file) {
  for (const char* name : {"database.db", "timestamps.txt", "gravity.txt",
                           "cameras.txt", "pairs.csv"}) {
    if (IsSameFile(target / name, file)) return true;
  }
  return ModelReplaces(target / "truth", file) ||
         ModelReplaces(target / "truth_images", file);
}

// Files of an export have the path of the output, are in that folder, or have
// the path with an extension.
bool ExportReplaces(const fs::path& target, const fs::path& file) {
  std::error_code ignored;
  const std::string prefix = fs::weakly_canonical(target, ignored).string();
  const std::string path = fs::weakly_canonical(file, ignored).string();
  const bool has_prefix = path.compare(0, prefix.size(), prefix) == 0;
  const char next = path.size() > prefix.size() ? path[prefix.size()] : '/';
  return (has_prefix && (next == '/' || next == '.')) ||
         ModelReplaces(target, file);
}

// An output of some commands.
struct Output {
  const char* commands;  // separated by blanks
  const char* option;
  Replaces replaces;
  // The input that the command may adjust in place, if any.
  const char* in_place = "";
};

constexpr char kMatchers[] =
    "exhaustive_matcher sequential_matcher vocab_tree_matcher spatial_matcher "
    "matches_importer geometric_verifier";

constexpr Output kOutputs[] = {
    {"mapper", "output_path", RunReplaces},
    {"automatic_reconstructor", "workspace_path", WorkspaceReplaces},
    {"bundle_adjuster", "output_path", ModelReplaces, "input_path"},
    {"point_triangulator", "output_path", ModelReplaces, "input_path"},
    {"model_aligner", "output_path", ModelReplaces},
    {"model_aligner", "transform_path", IsSameFile},
    {"model_converter", "output_path", ExportReplaces},
    {"model_cropper", "output_path", ModelReplaces},
    {"model_merger", "output_path", ModelReplaces},
    {"model_splitter", "output_path", RunReplaces},
    {"database_merger", "merged_database_path", IsSameFile},
    {"image_deleter", "output_path", ModelReplaces},
    {"image_undistorter", "output_path", UndistortionReplaces},
    {"image_splitter", "output_path", SplittingReplaces},
    {"video_sampler", "output_path", VideosReplace},
    {"simulate", "output_path", SimulationReplaces},
    {"model_evaluator", "json", IsSameFile},
    {"model_evaluator", "svg_path", IsSameFile},
    {"report", "output_path", IsSameFile},
    {"feature_extractor rig_configurator exhaustive_matcher sequential_matcher "
     "vocab_tree_matcher spatial_matcher matches_importer",
     "database_path", IsSameFile},
    {kMatchers, "shard_path", IsSameFile},
    {kMatchers, "output_pairs_path", IsSameFile},
    {"vocab_tree_builder", "vocab_tree_path", IsSameFile},
};

// Files of their own, unlike databases, which are extended.
bool IsNewFile(const Output& output) {
  return output.replaces == IsSameFile &&
         output.option != std::string("database_path");
}

bool IsOf(const Output& output, const std::string& command) {
  const std::string commands = " " + std::string(output.commands) + " ";
  return commands.find(" " + command + " ") != std::string::npos;
}

struct NamedPath {
  std::string option;
  std::string path;
};

bool IsOutput(const std::string& command, const std::string& option) {
  return std::any_of(std::begin(kOutputs), std::end(kOutputs),
                     [&](const Output& output) {
                       return IsOf(output, command) && option == output.option;
                     });
}

bool EndsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() &&
         text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// The files behind an input path. A folder stands for the files of the model in
// it; outputs never replace images, nor pipes.
std::vector<fs::path> FilesOf(const fs::path& path) {
  std::error_code ignored;
  if (fs::is_fifo(path, ignored)) return {};
  if (!fs::is_directory(path, ignored)) return {path};
  std::vector<fs::path> files;
  for (const std::string& name : ListFolder(path).model_files) {
    files.push_back(path / name);
  }
  return files;
}

// Some options take a list of paths, separated by commas.
std::vector<NamedPath> ReadInputs(const std::string& command,
                                  const OptionList& options,
                                  const std::string& config_path) {
  std::vector<NamedPath> inputs;
  const auto add = [&](const std::string& option, const std::string& value) {
    inputs.push_back({option, value});
    for (const std::string& item : SplitList(value)) {
      if (item != value) inputs.push_back({option, item});
    }
  };
  for (const OptionEntry& entry : options) {
    const OptionValue value = entry.get();
    if (!EndsWith(entry.name, "_path") || IsOutput(command, entry.name) ||
        !std::holds_alternative<std::string>(value)) {
      continue;
    }
    add(entry.name, std::get<std::string>(value));
  }
  add("config_path", config_path);
  inputs.erase(
      std::remove_if(inputs.begin(), inputs.end(),
                     [](const NamedPath& input) { return input.path.empty(); }),
      inputs.end());
  return inputs;
}

std::string ValueOf(const OptionList& options, const std::string& name) {
  for (const OptionEntry& entry : options) {
    if (entry.name == name) return FormatOptionValue(entry.get());
  }
  return "";
}

[[noreturn]] void ThrowIsModelFile(const std::string& target,
                                   const std::string& option,
                                   const std::string& remedy) {
  throw Error("'" + target + "' (--" + option +
              ") is the name of a file of a model" + remedy);
}

// The kind of a file of the user's that no table, list or page may replace,
// even if it is no input; empty for other files.
std::string KindOfKeptFile(const std::string& target) {
  std::error_code ignored;
  if (!fs::is_regular_file(target, ignored)) return "";
  if (HasDatabaseHeader(target)) return "a database";
  const std::string header = ReadFile(target, "", kMaxImageHeaderBytes);
  return ReadImageSize(header).has_value() ? "an image" : "";
}

// Whether the command itself reads an existing database at its output, and
// extends or refuses it.
bool IsDatabaseOption(const std::string& option) {
  return option == "shard_path" || option == "merged_database_path";
}

void CheckIsNotKept(const std::string& target, const std::string& option) {
  const std::string kind = KindOfKeptFile(target);
  if (kind.empty()) return;
  throw Error("'" + target + "' (--" + option + ") is " + kind +
              ", which the output would replace; choose another " + option);
}

void CheckKeptFiles(const std::string& command, const OptionList& options) {
  for (const Output& output : kOutputs) {
    const std::string target = ValueOf(options, output.option);
    const bool is_file = IsNewFile(output) || output.replaces == ExportReplaces;
    if (!IsOf(output, command) || target.empty() || !is_file ||
        IsDatabaseOption(output.option)) {
      continue;
    }
    CheckIsNotKept(target, output.option);
  }
}

// A new file is neither named like a file of a model nor another output.
void CheckNewFiles(const std::string& command, const OptionList& options) {
  std::map<fs::path, std::string> option_of_file;
  for (const Output& output : kOutputs) {
    const std::string target = ValueOf(options, output.option);
    if (!IsOf(output, command) || target.empty() || !IsNewFile(output)) {
      continue;
    }
    const std::string remedy = std::string("; choose another ") + output.option;
    // The page of a model may stand beside the model.
    const bool is_page = command == "report";
    if (!is_page && IsModelFileName(fs::path(target).filename())) {
      ThrowIsModelFile(target, output.option, remedy);
    }
    const auto [other, is_new] =
        option_of_file.emplace(CanonicalPath(target), output.option);
    if (!is_new) {
      throw Error("'" + other->first.string() + "' is the output of --" +
                  other->second + " and of --" + output.option + remedy);
    }
  }
}

}  // namespace

void CheckOutputsAreNoInputs(const std::string& command,
                             const OptionList& options,
                             const std::string& config_path) {
  CheckNewFiles(command, options);
  CheckKeptFiles(command, options);
  const std::vector<NamedPath> inputs =
      ReadInputs(command, options, config_path);
  for (const Output& output : kOutputs) {
    const std::string target = ValueOf(options, output.option);
    if (!IsOf(output, command) || target.empty()) continue;
    for (const NamedPath& input : inputs) {
      if (input.option == output.in_place) continue;
      for (const fs::path& file : FilesOf(input.path)) {
        if (!output.replaces(target, file)) continue;
        throw Error("'" + file.string() + "' is an input (--" + input.option +
                    ") that --" + output.option +
                    " would replace; choose another " + output.option);
      }
    }
  }
}

}  // namespace mgsfm
