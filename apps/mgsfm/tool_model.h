// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "files/staged_output.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/model_tools/model_tools.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// The rigs of commands on finished models. These commands make no rigs by
// themselves, as the mapper does: that would change the poses of images.
struct ToolRigOptions {
  Option<std::string> rig_config_path{
      "rig_config_path", "",
      "Group the images into the rigs of COLMAP's rig_config.json or of an "
      "earlier model, and fit the poses of the rigs to those of the images."};
  Option<std::string> rig_name_rule{
      "rig_name_rule", "auto",
      "Choose the source of rigs and frames: auto (those of the model, "
      "otherwise single images), none (single images), or a regular expression "
      "on image names, as for the mapper, that groups the images into rigs."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(rig_config_path, rig_name_rule);
  }
};

// A model on disk, and its place on the earth if it has one.
struct ToolModel {
  SceneModel model;
  std::optional<Eigen::Vector3d> origin_wgs84;
};

ToolModel ReadToolModel(const std::string& path, const ToolRigOptions& rigs,
                        const Context& context);

// The same for a model in memory; `path` names it in messages.
ToolModel MakeToolModel(const Model& model, const std::string& path,
                        const ToolRigOptions& rigs, const Context& context);

// Writes the model, rig_config.json and geo_origin.json, and commits them.
void WriteToolModel(const ToolModel& model, ModelFormat format,
                    const Context& context, StagedOutput* output);

// "12 frames, 48 images and 3600 points", for messages.
std::string DescribeSize(const SceneModel& model);
std::string DescribeSize(const ModelStatistics& statistics);

}  // namespace mgsfm
