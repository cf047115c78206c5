// SPDX-License-Identifier: BSD-3-Clause

#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "command.h"
#include "commands.h"
#include "evaluation/evaluation_plot.h"
#include "evaluation/truth_comparison.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {

enum class LengthUnit { kAuto, kMeter, kArbitrary };

template <>
struct EnumTable<LengthUnit> {
  static constexpr std::pair<std::string_view, LengthUnit> kNames[] = {
      {"auto", LengthUnit::kAuto},
      {"m", LengthUnit::kMeter},
      {"units", LengthUnit::kArbitrary}};
};

namespace {

struct EvaluatorOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Evaluate the model in this folder."};
  Option<std::string> gt_path{"gt_path", "",
                              "Compare with these true poses: a folder "
                              "(colmap) or a file (kitti, tum)."};
  Option<TruthFormat> gt_format{
      "gt_format", TruthFormat::kColmap,
      "State the format of the true poses. colmap: a model with the same image "
      "names. kitti, tum: poses of the reference camera, assigned by the "
      "number (kitti) or the time (tum) in the image name, else in frame "
      "order. rig: only the rig of --calib_path."};
  Option<std::string> calib_path{
      "calib_path", "",
      "Compare with this true rig: a rig_config.json, KITTI's calib.txt, or "
      "EuRoC's sensor.yaml of every camera, separated by commas, in the order "
      "of the camera folders."};
  Option<std::string> database_path{
      "database_path", "",
      "Count images of this database that are missing in the model as "
      "unregistered, for kitti and tum. Without it, only images in gaps "
      "between frames of the model count."};
  Option<std::string> image_prefix{
      "image_prefix", "",
      "Evaluate only images whose names have this prefix, such as seq1/."};
  Option<std::string> reference{
      "reference", "",
      "Name the folder of the camera whose poses are in --gt_path. By default, "
      "it is the reference sensor of the model's rig, or the first folder."};
  Option<std::string> rig_name_rule{
      "rig_name_rule", "auto",
      "Choose how image names identify cameras and frames if the model has no "
      "rigs, as for the mapper."};
  Option<Alignment> alignment{
      "alignment", Alignment::kSimilarity,
      "Choose the alignment of the model before it is compared: similarity; "
      "rigid for metric models; none for models in the world of the ground "
      "truth."};
  Option<LengthUnit> gt_unit{
      "gt_unit", LengthUnit::kAuto,
      "State the unit of length of the ground truth, for the output. auto: m "
      "for kitti, tum and georeferenced models; otherwise units, because "
      "models do not state their unit."};
  Option<std::string> json{"json", "", "Write the errors to a JSON file."};
  Option<std::string> svg_path{
      "svg_path", "", "Write an SVG plot of the trajectory and its errors."};
  Option<std::string> position_thresholds{
      "position_thresholds", "0.05,0.1,0.5,1", AnyValue(), "of gt_unit",
      "Set the position thresholds of the areas under the curve, separated by "
      "commas."};
  Option<std::string> rotation_thresholds{
      "rotation_thresholds", "0.5,1,5", AnyValue(), "deg",
      "Set the rotation thresholds of the areas under the curve, separated by "
      "commas."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, gt_path, gt_format, calib_path, database_path,
          image_prefix, reference, rig_name_rule, alignment, gt_unit, json,
          svg_path, position_thresholds, rotation_thresholds);
  }
};

std::vector<double> ParseThresholds(const std::string& name,
                                    const std::string& list) {
  return Transformed(SplitList(list), [&](const std::string& item) {
    const std::optional<double> value = ParseDouble(item);
    if (!value || !(*value > 0.0)) {
      throw Error("--" + name + ": '" + item + "' is not a positive number");
    }
    return *value;
  });
}

void CheckUsage(const EvaluatorOptions& options) {
  const bool is_rig = options.gt_format == TruthFormat::kRig;
  if (is_rig && options.calib_path->empty()) {
    throw Error("--gt_format rig needs --calib_path");
  }
  if (!is_rig && options.gt_path->empty()) {
    throw Error("--gt_path is needed, or --gt_format rig with --calib_path");
  }
  if (is_rig && !options.svg_path->empty()) {
    throw Error(
        "--svg_path needs true poses; choose another --gt_format than rig");
  }
}

// Warns of true poses in another convention, detected by the rotations of the
// model between consecutive images.
void WarnOfConvention(const TruthComparison& comparison,
                      const EvaluatorOptions& options, const Context& context) {
  if (options.gt_format == TruthFormat::kRig) return;
  PoseConvention convention;
  if (options.gt_format == TruthFormat::kKitti) {
    convention.order = PoseConvention::kMatrix;
  } else if (options.gt_format == TruthFormat::kColmap) {
    convention = {false, PoseConvention::kWxyz};
  }
  std::vector<RotationEvidence> evidence;
  const ImagePoses* last = nullptr;
  for (const ImagePoses& image : comparison.images) {
    if (!image.is_reference || !image.cam_from_model) continue;
    if (last != nullptr) {
      evidence.push_back({image.cam_from_model->rotation *
                              last->cam_from_model->rotation.conjugate(),
                          last->cam_from_world.rotation,
                          image.cam_from_world.rotation});
    }
    last = &image;
  }
  const auto other = FindOtherConvention(evidence, convention, "model");
  if (other) context.Warning("'" + *options.gt_path + "': " + *other);
}

CommandResult RunModelEvaluator(const EvaluatorOptions& options,
                                const Context& context) {
  CheckUsage(options);
  EvaluationOptions thresholds{
      ParseThresholds("position_thresholds", options.position_thresholds),
      ParseThresholds("rotation_thresholds", options.rotation_thresholds),
      options.alignment};
  const TruthComparison comparison = CompareWithTruth(
      {options.input_path, options.gt_path, options.gt_format,
       options.calib_path, options.database_path, options.image_prefix,
       options.reference, options.rig_name_rule});
  WarnOfConvention(comparison, options, context);
  thresholds.is_metric =
      options.gt_unit == LengthUnit::kMeter ||
      (options.gt_unit == LengthUnit::kAuto && comparison.is_metric);
  const Evaluation evaluation =
      Evaluate(comparison.images, comparison.has_true_poses, comparison.sensors,
               thresholds);
  WarnOfFewPoses(comparison, evaluation, options.alignment, context);
  if (!options.json->empty()) {
    ReplaceFile(*options.json, EvaluationToJson(evaluation));
  }
  if (!options.svg_path->empty()) {
    ReplaceFile(*options.svg_path,
                EvaluationToSvg(comparison.images, evaluation));
  }
  return {kExitSuccess, EvaluationToText(evaluation),
          EvaluationToJson(evaluation)};
}

}  // namespace

Command ModelEvaluatorCommand() {
  return MakeCommand(
      "model_evaluator",
      "Compares a model with ground-truth poses or rig extrinsics.",
      RunModelEvaluator);
}

}  // namespace mgsfm
