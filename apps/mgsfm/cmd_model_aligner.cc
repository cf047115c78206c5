// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <map>
#include <utility>
#include <vector>

#include "base/text.h"
#include "command.h"
#include "commands.h"
#include "io/database/database_reader.h"
#include "io/database/sqlite_snapshot.h"
#include "io/files/file_operations.h"
#include "io/files/staged_output.h"
#include "io/priors/named_vectors.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/priors/pose_priors.h"
#include "priors/position_registration.h"
#include "tool_model.h"

namespace mgsfm {

enum class AlignmentType { kCustom, kEnu, kPlane };

template <>
struct EnumTable<AlignmentType> {
  static constexpr std::pair<std::string_view, AlignmentType> kNames[] = {
      {"custom", AlignmentType::kCustom},
      {"enu", AlignmentType::kEnu},
      {"plane", AlignmentType::kPlane}};
};

namespace {

struct ModelAlignerOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Folder of the model to align."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "Folder for the aligned model."};
  Option<std::string> ref_images_path{
      "ref_images_path", "",
      "Align to the positions in this file, one line `image_name X Y Z` per "
      "image."};
  Option<std::string> database_path{
      "database_path", "",
      "Align to the positions in the table pose_priors of this database."};
  Option<std::string> ref_model_path{
      "ref_model_path", "", "Align to this model, by images of the same name."};
  Option<AlignmentType> alignment_type{
      "alignment_type", AlignmentType::kCustom,
      "custom: align to the positions or the model above. enu: the same, but "
      "positions must be GPS; they become metres east, north and up of the "
      "first one. plane: needs no reference; z is up and the trajectory lies "
      "in the plane z = 0."};
  Option<bool> ref_is_gps{
      "ref_is_gps", true,
      "Whether positions in the file, or in a database without coordinate "
      "system, are latitude, longitude (deg) and altitude (m)."};
  Option<int> min_common_images{
      "min_common_images", 3, AtLeast(3), "images",
      "Minimum number of images that have a reference."};
  Option<bool> estimate_scale{
      "estimate_scale", true,
      "Whether to estimate the scale. 0 keeps the unit of the model."};
  Option<double> alignment_max_error{
      "alignment_max_error", 4.0, GreaterThan(0.0), "units of the reference",
      "Positions farther than this from the aligned model are outliers, unless "
      "most are."};
  Option<std::string> transform_path{
      "transform_path", "",
      "Write the transform to this file: scale qw qx qy qz tx ty tz."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Format of the model: binary or text."};
  ToolRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, ref_images_path, database_path,
          ref_model_path, alignment_type, ref_is_gps, min_common_images,
          estimate_scale, alignment_max_error, transform_path, output_format,
          rigs);
  }
};

void CheckUsage(const ModelAlignerOptions& options) {
  const int num_references = (options.ref_images_path->empty() ? 0 : 1) +
                             (options.database_path->empty() ? 0 : 1) +
                             (options.ref_model_path->empty() ? 0 : 1);
  const bool is_plane = options.alignment_type == AlignmentType::kPlane;
  if (is_plane && num_references > 0) {
    throw Error(
        "--alignment_type plane needs no reference; drop --ref_images_path, "
        "--database_path and --ref_model_path, or the type");
  }
  if (!is_plane && num_references != 1) {
    throw Error(
        "give one of --ref_images_path, --database_path and --ref_model_path, "
        "or --alignment_type plane");
  }
  if (options.alignment_type == AlignmentType::kEnu &&
      !options.ref_model_path->empty()) {
    throw Error(
        "--alignment_type enu needs GPS positions; give --ref_images_path or "
        "--database_path");
  }
}

void CheckCount(size_t num_images, const std::string& reference,
                const ModelAlignerOptions& options) {
  if (num_images >= static_cast<size_t>(options.min_common_images)) return;
  throw Error("only " + std::to_string(num_images) + " images of '" +
              *options.input_path + "' have a place in '" + reference +
              "', fewer than --min_common_images " +
              std::to_string(options.min_common_images));
}

// The transform of a world that moved the frames from `before` to `after`.
Sim3 FindTransform(const Reconstruction& before, const Reconstruction& after) {
  std::vector<Rigid3> from, to;
  for (size_t i = 0; i < before.rig_from_world.size(); ++i) {
    if (!before.rig_from_world[i]) continue;
    from.push_back(*before.rig_from_world[i]);
    to.push_back(*after.rig_from_world[i]);
  }
  size_t farthest = 0;
  const auto distance = [](const std::vector<Rigid3>& poses, size_t i) {
    return (poses[i].Center() - poses.front().Center()).norm();
  };
  for (size_t i = 1; i < from.size(); ++i) {
    if (distance(from, i) > distance(from, farthest)) farthest = i;
  }
  Sim3 transform;
  transform.rotation =
      (to.front().rotation.conjugate() * from.front().rotation).normalized();
  if (farthest > 0) {
    transform.scale = distance(to, farthest) / distance(from, farthest);
  }
  transform.translation =
      to.front().Center() - transform * from.front().Center();
  return transform;
}

// Positions of images of the model; those of other images are left out.
std::vector<PosePriorRow> ReadPositions(const std::string& path,
                                        const Scene& scene) {
  std::vector<PosePriorRow> rows;
  for (const NamedVector& line : ReadNamedVectors(
           scene, path, "X Y Z", "ref_images_path", OtherImages::kIgnore)) {
    rows.push_back({scene.images[line.image_idx].id,
                    PosePriorRow::CoordinateSystem::kUndefined, line.value,
                    std::nullopt});
  }
  return rows;
}

PositionPriors ReadReference(const ModelAlignerOptions& options,
                             const Scene& scene) {
  constexpr double kOutlierDistance = 4.0;  // standard deviations
  const double std = options.alignment_max_error / kOutlierDistance;
  PosePriorOptions priors;
  priors.use_prior_position = true;
  priors.ref_is_gps = options.ref_is_gps;
  priors.overwrite_priors_covariance = true;
  priors.prior_position_std_x_m = std;
  priors.prior_position_std_y_m = std;
  priors.prior_position_std_z_m = std;
  if (options.ref_images_path->empty()) {
    return ReadPositionPriors(scene, options.database_path, priors);
  }
  return MakePositionPriors(scene,
                            ReadPositions(options.ref_images_path, scene),
                            options.ref_images_path, priors);
}

// Images of a model and of a database have different ids.
Scene WithDatabaseIds(Scene scene, const std::string& database_path,
                      const Context& context) {
  const SqliteSnapshot snapshot(database_path);
  std::map<std::string, ImageId> id_of_name;
  for (const ImageRow& image :
       ReadStructure(snapshot.database(), context).images) {
    id_of_name.emplace(image.name, image.id);
  }
  for (Image& image : scene.images) {
    const auto found = id_of_name.find(image.name);
    if (found == id_of_name.end()) {
      throw Error("the database '" + database_path + "' has no image '" +
                  image.name +
                  "' of the model; give the database of its images");
    }
    image.id = found->second;
  }
  return scene;
}

Sim3 AlignToPositions(const ModelAlignerOptions& options, ToolModel* input,
                      const Context& context) {
  Scene scene = input->model.scene;
  std::string reference = options.ref_images_path;
  if (!options.database_path->empty()) {
    reference = options.database_path;
    scene = WithDatabaseIds(std::move(scene), reference, context);
  }
  const PositionPriors priors = ReadReference(options, scene);
  if (options.alignment_type == AlignmentType::kEnu && !priors.origin_wgs84) {
    throw Error("the positions in '" + reference +
                "' are Cartesian; --alignment_type enu needs GPS");
  }
  CheckCount(static_cast<size_t>(
                 std::count_if(priors.images.begin(), priors.images.end(),
                               [](const auto& p) { return p.has_value(); })),
             reference, options);
  const Reconstruction before = input->model.reconstruction;
  PositionRegistration registration =
      RegisterToPriors(scene, priors, std::nullopt, !options.estimate_scale,
                       context.random_seed, &input->model.reconstruction);
  const PositionPriorSummary& summary = registration.summary;
  if (!summary.is_registered) {
    throw Error("'" + *options.input_path + "' cannot be aligned to '" +
                reference + "': " + summary.message);
  }
  EvaluatePositions(scene, priors, registration.used,
                    input->model.reconstruction, &registration.summary);
  if (summary.num_used < options.min_common_images) {
    throw Error("'" + *options.input_path + "' has another shape than the " +
                std::to_string(summary.num_priors) + " positions in '" +
                reference +
                "', of which no similarity brings --min_common_images within "
                "--alignment_max_error; check --ref_is_gps and the positions");
  }
  input->origin_wgs84 = priors.origin_wgs84;
  char numbers[120];
  std::snprintf(numbers, sizeof(numbers),
                "aligned to %d of %d positions, RMS distance %.4g",
                registration.summary.num_used, registration.summary.num_priors,
                registration.summary.rms.value_or(0.0));
  context.Info(numbers);
  if (!registration.summary.message.empty()) {
    context.Warning(registration.summary.message);
  }
  return FindTransform(before, input->model.reconstruction);
}

Sim3 AlignToModel(const ModelAlignerOptions& options, ToolModel* input,
                  const Context& context) {
  const ToolModel reference =
      ReadToolModel(options.ref_model_path, ToolRigOptions(), context);
  const std::vector<ImagePoses> pairs =
      PairImages(input->model, reference.model);
  CheckCount(pairs.size(), options.ref_model_path, options);
  Sim3 transform =
      *AlignPoses(pairs, options.estimate_scale ? Alignment::kSimilarity
                                                : Alignment::kRigid);
  std::vector<double> distances;
  for (const ImagePoses& pair : pairs) {
    distances.push_back((transform * pair.cam_from_model->Center() -
                         pair.cam_from_world.Center())
                            .norm());
  }
  TransformWorld(transform, &input->model.reconstruction);
  input->origin_wgs84 = reference.origin_wgs84;
  char numbers[120];
  std::snprintf(numbers, sizeof(numbers),
                "aligned by %zu common images, median distance %.4g",
                pairs.size(), Median(distances));
  context.Info(numbers);
  return transform;
}

Sim3 Align(const ModelAlignerOptions& options, ToolModel* input,
           const Context& context) {
  if (options.alignment_type == AlignmentType::kPlane) {
    Sim3 transform = *AlignToGroundPlane(input->model);
    TransformWorld(transform, &input->model.reconstruction);
    input->origin_wgs84.reset();
    return transform;
  }
  return options.ref_model_path->empty()
             ? AlignToPositions(options, input, context)
             : AlignToModel(options, input, context);
}

std::string TransformText(const Sim3& transform) {
  const Eigen::Quaterniond& q = transform.rotation;
  std::string text;
  for (const double value :
       {transform.scale, q.w(), q.x(), q.y(), q.z(), transform.translation.x(),
        transform.translation.y(), transform.translation.z()}) {
    text += (text.empty() ? "" : " ") +
            FormatDouble(value, std::chars_format::general, 17);
  }
  return text + '\n';
}

int RunModelAligner(const ModelAlignerOptions& options,
                    const Context& context) {
  CheckUsage(options);
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ToolModel input = ReadToolModel(options.input_path, options.rigs, context);
  CheckFormat(input.model.scene, options.output_format);
  const Sim3 transform = Align(options, &input, context);
  WriteToolModel(input, options.output_format, context, &output);
  if (!options.transform_path->empty()) {
    FileOperations files;
    ReplaceFile(*options.transform_path, TransformText(transform), &files);
  }
  context.Info("scale " +
               FormatDouble(transform.scale, std::chars_format::general, 9));
  return kExitSuccess;
}

}  // namespace

Command ModelAlignerCommand() {
  return MakeCommand("model_aligner",
                     "Moves a model to measured positions, another model, or "
                     "the ground plane.",
                     RunModelAligner);
}

}  // namespace mgsfm
