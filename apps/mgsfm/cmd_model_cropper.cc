// SPDX-License-Identifier: BSD-3-Clause
#include <vector>

#include "base/text.h"
#include "base/text_tools.h"
#include "command.h"
#include "commands.h"
#include "files/staged_output.h"
#include "geometry/geodetic.h"
#include "mgsfm/base/error.h"
#include "tool_model.h"

namespace mgsfm {
namespace {

struct ModelCropperOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Crop the model in this folder."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "Write the cropped model into this folder."};
  Option<std::string> boundary{
      "boundary", "", Required(),
      "Keep the points in the box x1,y1,z1,x2,y2,z2 in the world of the model, "
      "or between two quantiles of the points along each axis, such as "
      "0.01,0.99."};
  Option<bool> boundary_is_gps{
      "boundary_is_gps", false,
      "Take the corners of the box for latitude,longitude,altitude. The model "
      "must have a geo_origin.json."};
  Option<ModelFormat> output_format{
      "output_format", ModelFormat::kBinary,
      "Write the model in binary or text format."};
  ToolRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, boundary, boundary_is_gps, output_format,
          rigs);
  }
};

std::vector<double> ParseBoundary(const std::string& text) {
  std::vector<double> values;
  bool is_valid = true;
  for (const std::string& item : SplitList(text)) {
    const std::optional<double> value = ParseDouble(item);
    is_valid &= value.has_value();
    values.push_back(value.value_or(0.0));
  }
  const bool are_quantiles =
      values.size() == 2 && values[0] >= 0.0 && values[1] <= 1.0;
  for (size_t i = 0; is_valid && 2 * i < values.size(); ++i) {
    is_valid = values[i] <= values[i + values.size() / 2];
  }
  if (!is_valid || (values.size() != 6 && !are_quantiles)) {
    throw Error("--boundary '" + text +
                "' is neither x1,y1,z1,x2,y2,z2 with x1 <= x2, y1 <= y2 and z1 "
                "<= z2, nor two quantiles between 0 and 1");
  }
  return values;
}

Eigen::AlignedBox3d MakeBox(const ModelCropperOptions& options,
                            const std::vector<double>& boundary,
                            const ToolModel& input) {
  if (boundary.size() == 2) {
    if (input.model.reconstruction.points.empty()) {
      throw Error("'" + *options.input_path +
                  "' has no points, so --boundary cannot be quantiles");
    }
    return BoxOfQuantiles(input.model, boundary[0], boundary[1]);
  }
  const Eigen::Vector3d low(boundary[0], boundary[1], boundary[2]);
  const Eigen::Vector3d high(boundary[3], boundary[4], boundary[5]);
  if (!options.boundary_is_gps) return {low, high};
  if (!input.origin_wgs84) {
    throw Error("'" + *options.input_path +
                "' has no geo_origin.json; align it to GPS with "
                "model_aligner, or do not set --boundary_is_gps");
  }
  Eigen::AlignedBox3d box(EastNorthUp(low, *input.origin_wgs84));
  box.extend(EastNorthUp(high, *input.origin_wgs84));
  return box;
}

int RunModelCropper(const ModelCropperOptions& options,
                    const Context& context) {
  const std::vector<double> boundary = ParseBoundary(options.boundary);
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ToolModel input = ReadToolModel(options.input_path, options.rigs, context);
  CheckFormat(input.model.scene, options.output_format);
  KeepBox(MakeBox(options, boundary, input), &input.model);
  if (input.model.reconstruction.points.empty()) {
    throw Error("no point of '" + *options.input_path +
                "' lies in --boundary; nothing is written");
  }
  WriteToolModel(input, options.output_format, context, &output);
  context.Info("the cropped model has " + DescribeSize(input.model));
  return kExitSuccess;
}

}  // namespace

Command ModelCropperCommand() {
  return MakeCommand(
      "model_cropper",
      "Keeps the points in a box and the frames that observe them.",
      RunModelCropper);
}

}  // namespace mgsfm
