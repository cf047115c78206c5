// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "files/staged_output.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/model_tools/model_tools.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

inline Option<ModelFormat> ModelFormatOption() {
  return {"output_format", ModelFormat::kBinary,
          "Write the model in binary or text format."};
}

// The rigs of commands on finished models. Unlike the mapper, these commands do
// not infer rigs, because this would change the poses of images.
struct ModelRigOptions {
  Option<std::string> rig_config_path{
      "rig_config_path", "",
      "Group the images into the rigs of COLMAP's rig_config.json or of an "
      "earlier model, and fit the poses of the rigs to the image poses."};
  Option<std::string> rig_name_rule{
      "rig_name_rule", "auto",
      "Choose the source of rigs and frames: auto (from the model, otherwise "
      "single images), none (single images), or a regular expression on image "
      "names, as for the mapper, that groups the images into rigs."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(rig_config_path, rig_name_rule);
  }
};

// A model on disk, and its georeference if it has one.
struct ModelFile {
  SceneModel model;
  std::optional<Eigen::Vector3d> origin_wgs84;
};

ModelFile ReadModelFile(const std::string& path, const ModelRigOptions& rigs,
                        const Context& context);

// The same for a model in memory; `path` names it in messages.
ModelFile MakeModelFile(const Model& model, const std::string& path,
                        const ModelRigOptions& rigs, const Context& context);

// Writes a model and its rig_config.json.
void WriteModelAndRig(const std::filesystem::path& folder, const Scene& scene,
                      const Reconstruction& reconstruction, ModelFormat format,
                      const Context& context);

// Writes the model, rig_config.json and geo_origin.json, and commits them.
void WriteModelFile(const ModelFile& model, ModelFormat format,
                    const Context& context, StagedOutput* output);

// The common options of commands that change a model.
struct ModelEditOptions {
  ModelEditOptions(const char* input_help, const char* output_help)
      : input_path("input_path", "", Required(), input_help),
        output_path("output_path", "", Required(), output_help) {}

  Option<std::string> input_path;
  Option<std::string> output_path;
  Option<ModelFormat> output_format = ModelFormatOption();
  ModelRigOptions rigs;
};

// Writes the model that `edit` has changed; nothing if it throws. Returns the
// size of the model (DescribeSize).
std::string EditModel(const ModelEditOptions& options, const Context& context,
                      const std::function<void(ModelFile*)>& edit);

// "12 frames, 48 images and 3600 points", for messages.
std::string DescribeSize(const SceneModel& model);

}  // namespace mgsfm
