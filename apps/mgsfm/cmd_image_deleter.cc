// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "base/file_reading.h"
#include "command.h"
#include "commands.h"
#include "database/database_reader.h"
#include "files/staged_output.h"
#include "mgsfm/base/error.h"
#include "tool_model.h"

namespace mgsfm {
namespace {

struct ImageDeleterOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Read the model in this folder."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write the model without the images into this folder."};
  Option<std::string> image_names_path{
      "image_names_path", "",
      "Delete the images that this text file names, one per line."};
  Option<std::string> image_ids_path{
      "image_ids_path", "",
      "Delete the images whose ids this text file lists, one per line."};
  Option<ModelFormat> output_format{
      "output_format", ModelFormat::kBinary,
      "Write the model in binary or text format."};
  ToolRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, image_names_path, image_ids_path,
          output_format, rigs);
  }
};

[[noreturn]] void ThrowNoImage(const std::string& list_path,
                               const std::string& key,
                               const std::string& model_path) {
  throw Error("'" + list_path + "' lists '" + key +
              "', which is not an image of '" + model_path +
              "'; remove the line");
}

// Marks the images that a list names; `keys` are all names or ids.
void MarkDeleted(const std::string& list_path,
                 const std::vector<std::string>& keys,
                 const std::string& model_path, Mask* keeps_image) {
  std::map<std::string, size_t> image_of_key;
  for (size_t i = 0; i < keys.size(); ++i) image_of_key[keys[i]] = i;
  for (const std::string& key : ReadImageList(list_path)) {
    const auto found = image_of_key.find(key);
    if (found == image_of_key.end()) {
      ThrowNoImage(list_path, key, model_path);
    }
    (*keeps_image)[found->second] = false;
  }
}

int RunImageDeleter(const ImageDeleterOptions& options,
                    const Context& context) {
  if (options.image_names_path->empty() && options.image_ids_path->empty()) {
    throw Error("give --image_names_path or --image_ids_path");
  }
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ToolModel input = ReadToolModel(options.input_path, options.rigs, context);
  CheckFormat(input.model.scene, options.output_format);
  std::vector<std::string> names, ids;
  for (const Image& image : input.model.scene.images) {
    names.push_back(image.name);
    ids.push_back(std::to_string(image.id.value()));
  }
  Mask keeps_image(names.size(), true);
  if (!options.image_names_path->empty()) {
    MarkDeleted(options.image_names_path, names, options.input_path,
                &keeps_image);
  }
  if (!options.image_ids_path->empty()) {
    MarkDeleted(options.image_ids_path, ids, options.input_path, &keeps_image);
  }
  if (std::count(keeps_image.begin(), keeps_image.end(), true) == 0) {
    throw Error("all images of '" + *options.input_path +
                "' are listed; nothing would be left");
  }
  KeepImages(keeps_image, &input.model);
  WriteToolModel(input, options.output_format, context, &output);
  context.Info("the model has " + DescribeSize(input.model) + " left");
  return kExitSuccess;
}

}  // namespace

Command ImageDeleterCommand() {
  return MakeCommand("image_deleter", "Deletes images from a model.",
                     RunImageDeleter);
}

}  // namespace mgsfm
