// SPDX-License-Identifier: BSD-3-Clause
#include <string>
#include <vector>

#include "base/format.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "command.h"
#include "commands.h"
#include "database/database_cleaning.h"
#include "database/database_merging.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

struct DatabaseCleanerOptions {
  Option<std::string> database_path{"database_path", "", Required(),
                                    "Change this COLMAP database."};
  Option<std::string> type{
      "type", "", Required(),
      "Delete these rows: matches (and two-view geometries), features (and "
      "matches), images (and features, frames and priors) or all."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, type);
  }
};

CleanedRows ParseType(const std::string& name) {
  for (const auto& [type_name, rows] : EnumTable<CleanedRows>::kNames) {
    if (type_name == name) return rows;
  }
  throw Error("unknown --type '" + name +
              "'; choose all, images, features or matches");
}

int RunDatabaseCleaner(const DatabaseCleanerOptions& options,
                       const Context& context) {
  CleanDatabase(options.database_path, ParseType(options.type));
  context.Info("deleted from " + *options.database_path + ": " + *options.type);
  return kExitSuccess;
}

struct DatabaseMergerOptions {
  Option<std::string> database_path1{
      "database_path1", "",
      "Merge this database with the second one, as in COLMAP."};
  Option<std::string> database_path2{"database_path2", "",
                                     "Merge this database with the first one."};
  Option<std::string> database_path{
      "database_path", "",
      "Merge these databases, in any order, separated by commas: shards, or "
      "databases of different images. They are not changed."};
  Option<std::string> database_list_path{
      "database_list_path", "",
      "Read the databases from this file, one per line: its path and, "
      "separated by tabs, optionally its image prefix and its vehicle. Set it "
      "for many databases."};
  Option<std::string> image_prefix{
      "image_prefix", "",
      "Add these prefixes to image names, one per database, separated by "
      "commas, such as monday/,tuesday/. Set it if sessions have the same "
      "image names."};
  Option<std::string> vehicle{
      "vehicle", "",
      "Name the vehicle of each database, separated by commas. Databases of "
      "one vehicle share the rig and the cameras of equal folders. By default, "
      "each database has its own cameras."};
  Option<std::string> merged_database_path{
      "merged_database_path", "", Required(),
      "Write this database, which must not exist."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path1, database_path2, database_path, database_list_path,
          image_prefix, vehicle, merged_database_path);
  }
};

std::vector<MergeInput> ReadList(const std::string& path) {
  std::vector<MergeInput> inputs;
  TextLines lines(path);
  while (lines.NextContent()) {
    std::vector<std::string> words = SplitFields(lines.line(), '\t');
    if (words.size() > 3) {
      lines.Throw(
          Formatted("has %zu columns; expected a path and optionally a "
                    "prefix and a vehicle, separated by tabs",
                    words.size()));
    }
    words.resize(3);
    inputs.push_back({words[0], words[1], words[2]});
  }
  return inputs;
}

// Sets a member of each input from a list with one value per input.
void SetEach(const std::string& text, const std::string& option,
             std::string MergeInput::*member, std::vector<MergeInput>* inputs) {
  if (text.empty()) return;
  const std::vector<std::string> values = SplitFields(text, ',');
  if (values.size() != inputs->size()) {
    throw Error(
        Formatted("--%s has %zu values for %zu databases; give one for each",
                  option.c_str(), values.size(), inputs->size()));
  }
  for (size_t i = 0; i < values.size(); ++i) (*inputs)[i].*member = values[i];
}

std::vector<MergeInput> ReadInputs(const DatabaseMergerOptions& options) {
  std::vector<MergeInput> inputs;
  for (const std::string& path :
       {*options.database_path1, *options.database_path2}) {
    if (!path.empty()) inputs.push_back({path});
  }
  for (const std::string& path : SplitList(options.database_path)) {
    inputs.push_back({path});
  }
  SetEach(options.image_prefix, "image_prefix", &MergeInput::prefix, &inputs);
  SetEach(options.vehicle, "vehicle", &MergeInput::vehicle, &inputs);
  if (!options.database_list_path->empty()) {
    const std::vector<MergeInput> listed = ReadList(options.database_list_path);
    inputs.insert(inputs.end(), listed.begin(), listed.end());
  }
  if (inputs.empty()) {
    throw Error(
        "there is nothing to merge; set --database_path a.db,b.db or "
        "--database_list_path");
  }
  return inputs;
}

int RunDatabaseMerger(const DatabaseMergerOptions& options,
                      const Context& context) {
  const DatabaseMergeSummary summary = MergeDatabases(
      ReadInputs(options), options.merged_database_path, context);
  context.Info(Formatted("merged: %zu images, %zu pairs, %zu rigs",
                         summary.num_images, summary.num_pairs,
                         summary.num_rigs));
  return kExitSuccess;
}

}  // namespace

std::vector<Command> DatabaseCommands() {
  return {
      MakeCommand("database_merger",
                  "Merges shards, or databases of different images.",
                  RunDatabaseMerger),
      MakeCommand(
          "database_cleaner",
          "Deletes matches, features, images or everything from a database.",
          RunDatabaseCleaner)};
}

}  // namespace mgsfm
