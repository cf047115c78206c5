// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <set>
#include <system_error>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text_streams.h"
#include "base/text_tools.h"
#include "database/sqlite_database.h"
#include "files/file_operations.h"
#include "files/image_reading.h"
#include "files/model_files.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// An output of some commands.
struct Output {
  const char* commands;  // separated by blanks
  const char* option;
  // The outputs of the command, relative to the path in the option: files,
  // folders of a model ("sparse/"), and folders of numbered models
  // ("sparse/*"). "." is the path itself, and "export" its files: the path,
  // those in it, and the path with an extension.
  const char* writes;
  // The input that the command may adjust in place, if any.
  const char* in_place = "";
};

constexpr char kMatchers[] =
    "exhaustive_matcher sequential_matcher vocab_tree_matcher spatial_matcher "
    "matches_importer geometric_verifier";
constexpr Output kOutputs[] = {
    {"mapper", "output_path", "/*"},
    {"automatic_reconstructor", "workspace_path",
     "database.db views/cameras.txt views/rig_config.json "
     "videos/timestamps.txt videos/video_sampling.json "
     "recording/rig_config.json recording/positions.txt "
     "recording/recording_import.json sparse/*"},
    {"bundle_adjuster point_triangulator", "output_path", "/", "input_path"},
    {"model_aligner model_cropper model_merger image_deleter", "output_path",
     "/"},
    {"model_aligner", "transform_path", "."},
    {"model_converter", "output_path", "export /"},
    {"model_splitter", "output_path", "/*"},
    {"database_merger", "merged_database_path", "."},
    {"image_undistorter", "output_path",
     "undistortion.json transforms.json sparse_pc.ply sparse/ sparse/0/ "
     "colmap/sparse/0/"},
    {"image_splitter", "output_path", "cameras.txt rig_config.json"},
    {"video_sampler", "output_path", "timestamps.txt video_sampling.json"},
    {"recording_importer", "output_path",
     "rig_config.json positions.txt recording_import.json"},
    {"simulate", "output_path",
     "database.db timestamps.txt gravity.txt cameras.txt pairs.csv truth/ "
     "truth_images/"},
    {"model_evaluator", "json", "."},
    {"model_evaluator", "svg_path", "."},
    {"report", "output_path", "."},
    {"feature_extractor rig_configurator exhaustive_matcher sequential_matcher "
     "vocab_tree_matcher spatial_matcher matches_importer",
     "database_path", "."},
    {kMatchers, "shard_path", "."},
    {kMatchers, "output_pairs_path", "."},
    {"vocab_tree_builder", "vocab_tree_path", "."},
};

bool IsSameFile(const fs::path& target, const fs::path& file) {
  std::error_code ignored;  // where one is missing
  return fs::equivalent(target, file, ignored);
}

bool ExportReplaces(const fs::path& target, const fs::path& file) {
  std::error_code ignored;
  const std::string prefix = fs::weakly_canonical(target, ignored).string();
  const std::string path = fs::weakly_canonical(file, ignored).string();
  const bool has_prefix = path.compare(0, prefix.size(), prefix) == 0;
  const char next = path.size() > prefix.size() ? path[prefix.size()] : '/';
  return has_prefix && (next == '/' || next == '.');
}

// Whether an output at `target` would replace `file`.
bool Replaces(const Output& output, const fs::path& target,
              const fs::path& file) {
  TextInput words(output.writes);
  for (std::string word; words >> word;) {
    const size_t slash = word.rfind('/');
    const std::string kind =
        slash == std::string::npos ? "" : word.substr(slash);
    const std::string folder = word.substr(0, word.size() - kind.size());
    const fs::path place = folder.empty() ? target : target / folder;
    const bool replaces =
        word == "export" ? ExportReplaces(target, file)
        : kind == "/*"   ? IsReplacedByOutput(place, OutputKind::kRun, file)
        : kind == "/"    ? IsReplacedByOutput(place, OutputKind::kModel, file)
                      : IsSameFile(word == "." ? target : target / word, file);
    if (replaces) return true;
  }
  return false;
}

// An output of a command, and the path that its option names.
struct Target {
  const Output* output;
  std::string path;
  // A separate file, unlike a database, which is extended.
  bool is_new_file;
};

std::vector<Target> TargetsOf(const std::string& command,
                              const OptionList& options) {
  std::vector<Target> targets;
  for (const Output& output : kOutputs) {
    const std::string commands = " " + std::string(output.commands) + " ";
    if (commands.find(" " + command + " ") == std::string::npos) continue;
    for (const OptionEntry& entry : options) {
      const std::string path = FormatOptionValue(entry.get());
      if (entry.name != output.option || path.empty()) continue;
      targets.push_back(
          {&output, path,
           output.writes == std::string(".") && entry.name != "database_path"});
    }
  }
  return targets;
}

// The files behind an input path. A folder represents the files of its model;
// outputs never replace images or pipes.
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

// Options of several inputs have numbered names, such as input_path1.
bool IsPathOption(const std::string& name) {
  constexpr std::string_view kEnd = "_path";
  const size_t size = name.find_last_not_of("0123456789") + 1;
  return size >= kEnd.size() &&
         name.compare(size - kEnd.size(), kEnd.size(), kEnd) == 0;
}

// The options of inputs and their paths. Some options take a list of paths,
// separated by commas.
std::vector<std::pair<std::string, std::string>> ReadInputs(
    const std::vector<Target>& targets, const OptionList& options,
    const std::string& config_path) {
  std::vector<std::pair<std::string, std::string>> inputs;
  const auto add = [&](const std::string& option, const std::string& value) {
    if (!value.empty()) inputs.emplace_back(option, value);
    for (const std::string& item : SplitList(value)) {
      if (item != value) inputs.emplace_back(option, item);
    }
  };
  for (const OptionEntry& entry : options) {
    const OptionValue value = entry.get();
    const bool is_output = AnyOf(targets, [&](const Target& target) {
      return target.output->option == entry.name;
    });
    if (!IsPathOption(entry.name) || is_output ||
        !std::holds_alternative<std::string>(value)) {
      continue;
    }
    add(entry.name, std::get<std::string>(value));
  }
  add("config_path", config_path);
  return inputs;
}

// The kind of a user's file that no table, list or page may replace, even if it
// is not an input; empty for other files.
std::string KindOfKeptFile(const std::string& target) {
  std::error_code ignored;
  if (!fs::is_regular_file(target, ignored)) return "";
  if (HasDatabaseHeader(target)) return "a database";
  return ReadImageSizeOf(target) ? "an image" : "";
}

void CheckIsNotKept(const Target& target) {
  const std::string option = target.output->option;
  // The command itself reads an existing database there, and extends or rejects
  // it.
  if (option == "shard_path" || option == "merged_database_path") return;
  const std::string kind = KindOfKeptFile(target.path);
  if (kind.empty()) return;
  throw Error("'" + target.path + "' (--" + option + ") is " + kind +
              ", which the output would replace; choose another " + option);
}

// A new file must not have the name of a model file, nor be another output.
void CheckNewFiles(const std::string& command,
                   const std::vector<Target>& targets) {
  std::map<fs::path, std::string> option_of_file;
  for (const Target& target : targets) {
    if (!target.is_new_file) continue;
    const std::string option = target.output->option;
    const std::string remedy = "; choose another " + option;
    // The page of a model may be beside the model.
    const bool is_page = command == "report";
    if (!is_page && IsModelFileName(fs::path(target.path).filename())) {
      throw Error("'" + target.path + "' (--" + option +
                  ") is the name of a file of a model" + remedy);
    }
    const auto [other, is_new] =
        option_of_file.emplace(CanonicalPath(target.path), option);
    if (!is_new) {
      throw Error("'" + other->first.string() + "' is the output of --" +
                  other->second + " and of --" + option + remedy);
    }
  }
}

void CheckOutputsAreNoInputs(const std::string& command,
                             const OptionList& options,
                             const std::string& config_path) {
  const std::vector<Target> targets = TargetsOf(command, options);
  CheckNewFiles(command, targets);
  for (const Target& target : targets) {
    const bool is_file = target.is_new_file || command == "model_converter";
    if (is_file) CheckIsNotKept(target);
  }
  const auto inputs = ReadInputs(targets, options, config_path);
  for (const Target& target : targets) {
    const Output& output = *target.output;
    for (const auto& [option, path] : inputs) {
      if (option == output.in_place) continue;
      for (const fs::path& file : FilesOf(path)) {
        if (!Replaces(output, target.path, file)) continue;
        throw Error("'" + file.string() + "' is an input (--" + option +
                    ") that --" + output.option +
                    " would replace; choose another " + output.option);
      }
    }
  }
}

struct Flag {
  std::string name;
  std::optional<std::string> value;
};

bool IsFlag(const std::string& argument) {
  return argument.size() > 2 && argument.compare(0, 2, "--") == 0;
}

// Options with a list of paths separated by commas. On the command line, each
// path may be a separate argument, as shells expand them.
bool TakesList(const std::string& name) {
  return name == "calibration_path" || name == "video_path" ||
         name == "recording_path";
}

std::vector<Flag> SplitFlags(const std::vector<std::string>& arguments) {
  std::vector<Flag> flags;
  for (const std::string& argument : arguments) {
    const bool is_first_value =
        !flags.empty() && !flags.back().value && !IsFlag(argument);
    const bool is_next_value = !flags.empty() && flags.back().value &&
                               !IsFlag(argument) &&
                               TakesList(flags.back().name);
    if (argument == "-h") {
      flags.push_back({"help", {}});
    } else if (is_first_value) {
      flags.back().value = argument;
    } else if (is_next_value) {
      *flags.back().value += "," + argument;
    } else if (IsFlag(argument)) {
      const size_t equals = argument.find('=');
      flags.push_back({argument.substr(2, equals - 2), {}});
      if (equals != std::string::npos) {
        flags.back().value = argument.substr(equals + 1);
      }
    } else {
      throw Error("unexpected argument '" + argument +
                  "'; options are given as --name value");
    }
  }
  return flags;
}

// Removes the flag from the list.
std::optional<Flag> TakeFlag(const std::string& name,
                             std::vector<Flag>* flags) {
  for (size_t i = 0; i < flags->size(); ++i) {
    if ((*flags)[i].name != name) continue;
    Flag flag = std::move((*flags)[i]);
    flags->erase(flags->begin() + static_cast<std::ptrdiff_t>(i));
    return flag;
  }
  return std::nullopt;
}

bool TakeSwitch(const std::string& name, std::vector<Flag>* flags) {
  const std::optional<Flag> flag = TakeFlag(name, flags);
  if (flag && flag->value) throw Error("--" + name + " takes no value");
  return flag.has_value();
}

OptionAdvice AdviceFor(const OptionList& options) {
  return [&options](const std::string& name) {
    return AdviceOnOption(name, options);
  };
}

void SetFlags(const std::vector<Flag>& flags, const OptionList& options) {
  // An unknown name is more likely than a missing value.
  CheckOptionNames(options, Transformed(flags, &Flag::name),
                   AdviceFor(options));
  const auto is_bool = [&](const std::string& name) {
    return AnyOf(options, [&](const OptionEntry& entry) {
      return entry.name == name &&
             std::holds_alternative<bool>(entry.default_value);
    });
  };
  std::set<std::string> known;
  for (const Flag& flag : flags) {
    if (!known.insert(flag.name).second) {
      throw Error("--" + flag.name + " is given twice");
    }
    if (flag.value) {
      SetOption(options, flag.name, *flag.value);
    } else if (is_bool(flag.name)) {
      SetOption(options, flag.name, "true");
    } else {
      throw Error("--" + flag.name + " needs a value");
    }
  }
}

}  // namespace

Switches SetOptions(const std::vector<std::string>& arguments,
                    const OptionList& options) {
  std::vector<Flag> flags = SplitFlags(arguments);
  Switches switches;
  if (TakeSwitch("help", &flags)) switches.help = HelpLevel::kBasic;
  if (TakeSwitch("help_all", &flags)) switches.help = HelpLevel::kAll;
  if (switches.help) return switches;
  switches.dump_config = TakeSwitch("dump_config", &flags);
  if (const auto config = TakeFlag("config_path", &flags)) {
    if (!config->value) throw Error("--config_path needs a value");
    switches.config_path = *config->value;
    LoadOptions(std::filesystem::path(switches.config_path), options,
                AdviceFor(options));
  }
  SetFlags(flags, options);
  return switches;
}

bool ParseArguments(const std::string& name, const std::string& summary,
                    const std::vector<std::string>& arguments,
                    const OptionList& options) {
  const Switches switches = SetOptions(arguments, options);
  if (switches.help) {
    std::cout << MakeHelp(name, summary, options, *switches.help);
    return false;
  }
  if (switches.dump_config) {
    std::cout << DumpOptions(options);
    return false;
  }
  CheckCommandOptions(name, options, switches.config_path);
  return true;
}

void CheckCommandOptions(const std::string& name, const OptionList& options,
                         const std::string& config_path) {
  CheckOptions(options);
  CheckOutputsAreNoInputs(name, options, config_path);
}

Context ApplyCommonOptions(const CommonOptions& options, Context environment) {
  environment.num_threads = ResolveNumThreads(options.num_threads);
  environment.random_seed = static_cast<uint64_t>(options.random_seed);
  environment.log = [min_level = options.MinLogLevel(),
                     log = std::move(environment.log)](
                        LogLevel level, const std::string& message) {
    if (level >= min_level) log(level, message);
  };
  return environment;
}

int PrintResult(const CommandResult& result, const Context& context) {
  std::cout << result.text;
  if (result.has_files && !std::cout.flush()) {
    context.Warning(
        "the table cannot be written to the standard output; the model is "
        "complete");
    std::ignore = std::freopen("/dev/null", "w", stdout);
    std::cout.clear();
  }
  return result.exit_code;
}

}  // namespace mgsfm
