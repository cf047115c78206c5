// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "command.h"
#include "commands.h"
#include "database/database_reader.h"
#include "database/sqlite_database.h"
#include "files/file_operations.h"
#include "geometry/geodetic.h"
#include "geometry/so3.h"
#include "georegistration/position_registration.h"
#include "georegistration/world_frame.h"
#include "mapper_run.h"
#include "math/statistics.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "model_file.h"
#include "priors/body_calibration.h"
#include "priors/position_files.h"

namespace mgsfm {

enum class AlignmentType {
  kCustom,
  kEcef,
  kEnu,
  kEnuPlane,
  kEnuPlaneUnscaled,
  kPlane
};

template <>
struct EnumTable<AlignmentType> {
  static constexpr std::pair<std::string_view, AlignmentType> kNames[] = {
      {"custom", AlignmentType::kCustom},
      {"ecef", AlignmentType::kEcef},
      {"enu", AlignmentType::kEnu},
      {"enu-plane", AlignmentType::kEnuPlane},
      {"enu-plane-unscaled", AlignmentType::kEnuPlaneUnscaled},
      {"plane", AlignmentType::kPlane}};
};

namespace {

struct ModelAlignerOptions : ModelEditOptions {
  ModelAlignerOptions()
      : ModelEditOptions("Align the model in this folder.",
                         "Write the aligned model into this folder.") {}

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
      "Choose the world. custom: the world of the positions or the model "
      "above; GPS becomes meters east, north and up of the first position. For "
      "GPS positions only: enu, like custom; ecef, earth-centered; enu-plane, "
      "east, north and up of the center of the points; enu-plane-unscaled, "
      "like enu-plane, but in the unit of the model. plane: without reference; "
      "z is up and the trajectory lies in the plane z = 0."};
  Option<PositionKind> ref_is_gps{"ref_is_gps", PositionKind::kAuto,
                                  kPositionKindHelp};
  Option<int> min_common_images{
      "min_common_images", 3, AtLeast(3), "images",
      "Require this many images that have a reference."};
  Option<bool> estimate_scale{
      "estimate_scale", true,
      "Estimate the scale. 0 keeps the unit of the model."};
  Option<bool> robust_alignment{
      "robust_alignment", true,
      "Reject positions that do not fit the model (RANSAC). 0: align to all "
      "positions by least squares, whatever their distances."};
  Option<double> alignment_max_error{
      "alignment_max_error", 4.0, GreaterThan(0.0), "units of the reference",
      "Count positions, or images of the other model, within this distance of "
      "the aligned model as inliers. Images farther than a tenth of the extent "
      "of the other model are outliers in any case."};
  Option<double> min_inlier_ratio{
      "min_inlier_ratio", kMinAgreeingShare, Between(0.0, 1.0),
      "Require this fraction of inliers among the positions, or among the "
      "common images of a model. With fewer, nothing is written."};
  Option<bool> merge_image_and_ref_origins{
      "merge_image_and_ref_origins", false,
      "Shift the aligned model so that its first image is exactly at its "
      "position."};
  Option<bool> use_prior_gravity{
      "use_prior_gravity", false,
      "Use the gravity directions in the table pose_priors of --database_path "
      "as upward direction for plane and for GPS positions on a line."};
  Option<std::string> body_calibration{
      "body_calibration", "",
      "Take positions for those of the antenna in this file, as in mapper."};
  Option<std::string> transform_path{
      "transform_path", "",
      "Write the transform to this file: scale qw qx qy qz tx ty tz."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, ref_images_path, database_path,
          ref_model_path, alignment_type, ref_is_gps, min_common_images,
          estimate_scale, robust_alignment, alignment_max_error,
          min_inlier_ratio, merge_image_and_ref_origins, use_prior_gravity,
          body_calibration, transform_path, output_format, rigs);
  }
};

// Measured positions and gravity of the images of a finished model.
struct ReferencePositions {
  PositionPriors positions;
  GravityPriors gravity;  // empty if it is not wanted
};

PosePriorOptions PriorOptions(const ModelAlignerOptions& options) {
  // The distance, in standard deviations, beyond which the registration drops a
  // position.
  constexpr double kOutlierDistance = 4.0;
  PosePriorOptions priors;
  priors.use_prior_position = true;
  priors.ref_is_gps = options.ref_is_gps;
  priors.overwrite_priors_covariance = true;
  priors.prior_position_std_x_m =
      options.alignment_max_error / kOutlierDistance;
  priors.prior_position_std_y_m = priors.prior_position_std_x_m;
  priors.prior_position_std_z_m = priors.prior_position_std_x_m;
  priors.use_prior_gravity = options.use_prior_gravity;
  return priors;
}

// Positions of images of the model; skips positions of other images.
std::vector<PosePriorRow> ReadPositions(const std::string& path,
                                        const Scene& scene) {
  std::vector<PosePriorRow> rows;
  for (const NamedVector& line : ReadNamedVectors(
           scene, path, "X Y Z", "ref_images_path", UnknownImages::kIgnore)) {
    rows.push_back({scene.images[line.image_idx].id,
                    PosePriorRow::CoordinateSystem::kUndefined, line.value,
                    std::nullopt});
  }
  if (rows.empty()) {
    throw Error("'" + path +
                "' (--ref_images_path) has no position of an image of the "
                "model, such as '" +
                scene.images.front().name + "'; give names as in the model");
  }
  return rows;
}

// Only the names and ids of the images of a database, in canonical order.
Scene ImagesOfDatabase(const std::string& path, const Context& context) {
  const SqliteSnapshot snapshot(path);
  Scene scene;
  for (const ImageRow& row :
       ReadStructure(snapshot.database(), context).images) {
    scene.images.push_back({row.id, row.name, 0, 0, 0, {}});
  }
  SortBy(&scene.images, &Image::name);
  return scene;
}

// Finds the positions of the images of a model by their names. The origin of
// GPS positions in a database is the same as for the mapper, the first of all
// images by name, so that all models of a database have the same world.
ReferencePositions ReadReference(const ModelAlignerOptions& options,
                                 const Scene& scene, const Context& context) {
  const PosePriorOptions prior_options = PriorOptions(options);
  ReferencePositions reference;
  if (!options.ref_images_path->empty()) {
    reference.positions =
        MakePositionPriors(scene, ReadPositions(options.ref_images_path, scene),
                           "'" + *options.ref_images_path + "'", prior_options);
    return reference;
  }
  const Scene all = ImagesOfDatabase(options.database_path, context);
  const std::vector<size_t> idxs =
      FindImages(scene, all, options.database_path);
  if (options.alignment_type != AlignmentType::kPlane) {
    reference.positions =
        ReadPositionPriors(all, options.database_path, prior_options);
    SelectImages(idxs, &reference.positions.images);
  }
  if (options.use_prior_gravity) {
    reference.gravity = ReadGravity(all, options.database_path, prior_options);
    SelectImages(idxs, &reference.gravity.images);
  }
  return reference;
}

bool NeedsGps(AlignmentType type) {
  return type != AlignmentType::kCustom && type != AlignmentType::kPlane;
}

void CheckUsage(const ModelAlignerOptions& options) {
  const int num_references = (options.ref_images_path->empty() ? 0 : 1) +
                             (options.database_path->empty() ? 0 : 1) +
                             (options.ref_model_path->empty() ? 0 : 1);
  if (options.use_prior_gravity && options.database_path->empty()) {
    throw Error("--use_prior_gravity needs the --database_path that has it");
  }
  const bool is_plane = options.alignment_type == AlignmentType::kPlane;
  if (is_plane && num_references > (options.use_prior_gravity ? 1 : 0)) {
    throw Error(
        "--alignment_type plane needs no reference; drop --ref_images_path, "
        "--database_path and --ref_model_path, or the type");
  }
  if (!is_plane && num_references != 1) {
    throw Error(
        "give one of --ref_images_path, --database_path and --ref_model_path, "
        "or --alignment_type plane");
  }
  if (NeedsGps(options.alignment_type) && !options.ref_model_path->empty()) {
    throw Error("--alignment_type " +
                std::string(EnumName(*options.alignment_type)) +
                " needs GPS positions; give --ref_images_path or "
                "--database_path");
  }
  const bool needs_positions =
      options.merge_image_and_ref_origins || !options.body_calibration->empty();
  if (needs_positions && (is_plane || !options.ref_model_path->empty())) {
    throw Error(
        "--merge_image_and_ref_origins and --body_calibration need positions; "
        "give --ref_images_path or --database_path");
  }
}

void CheckCount(size_t num_images, const std::string& reference,
                const ModelAlignerOptions& options) {
  if (num_images >= static_cast<size_t>(options.min_common_images)) return;
  throw Error(
      Formatted("only %zu images of '%s' have a reference in '%s', fewer than "
                "--min_common_images %d; check that the image names agree",
                num_images, options.input_path->c_str(), reference.c_str(),
                *options.min_common_images));
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

// Throws Error if the directions contradict the orientations of the images.
std::optional<Eigen::Vector3d> MeasuredUp(const ReferencePositions& reference,
                                          const SceneModel& model) {
  // Inertial sensors, including those of phones, are far more accurate.
  constexpr double kMaxSigmaDeg = 10.0;
  const auto gravity = EstimateGravity(model.scene, reference.gravity, 0.0,
                                       model.reconstruction);
  if (!gravity) return std::nullopt;
  if (gravity->sigma_rad > DegToRad(kMaxSigmaDeg)) {
    throw Error(
        "the directions of gravity contradict the orientations of the images "
        "by " +
        FormatDouble(RadToDeg(gravity->sigma_rad), std::chars_format::general,
                     3) +
        " deg; give them in the camera frame, x right, y down, z forward, or "
        "drop --use_prior_gravity");
  }
  return -gravity->down_in_world;
}

// The offsets of the positions of images from the model, in the order of the
// names of the images.
std::vector<Eigen::Vector3d> OffsetsOf(const PositionPriors& positions,
                                       const SceneModel& model) {
  std::vector<Eigen::Vector3d> offsets;
  for (size_t i = 0; i < positions.images.size(); ++i) {
    const auto pose =
        model.reconstruction.CamFromWorld(model.scene, static_cast<int>(i));
    if (!positions.images[i] || !pose) continue;
    offsets.emplace_back(positions.images[i]->position -
                         positions.images[i]->PointInWorld(*pose));
  }
  return offsets;
}

// The reference of the alignment, for messages.
struct Reference {
  std::string path;
  const char* items;  // "positions"
  double max_error;
};

// Throws Error unless enough reference positions or images agree with the
// aligned model.
void CheckAgreement(const ModelAlignerOptions& options,
                    const Reference& reference,
                    const std::vector<double>& distances,
                    const Context& context) {
  size_t num_used = 0;
  double squared_sum = 0.0;
  for (const double distance : distances) {
    if (options.robust_alignment && !(distance <= reference.max_error))
      continue;
    ++num_used;
    squared_sum += distance * distance;
  }
  const double min_num_used = std::max<double>(
      options.min_common_images,
      options.min_inlier_ratio * static_cast<double>(distances.size()));
  const std::string found =
      Formatted("%zu of %zu %s", num_used, distances.size(), reference.items);
  if (static_cast<double>(num_used) < min_num_used) {
    throw Error(
        "'" + *options.input_path + "' differs in shape from '" +
        reference.path + "': only " + found + " are within " +
        FormatDouble(reference.max_error, std::chars_format::general, 4) +
        " of the aligned model, median distance " +
        FormatDouble(Median(distances), std::chars_format::general, 4) +
        "; check --ref_is_gps and the images, or set "
        "--alignment_max_error, --min_inlier_ratio and "
        "--min_common_images");
  }
  context.Info(Formatted("aligned to %s, RMS distance %.4g, median %.4g",
                         found.c_str(),
                         std::sqrt(squared_sum / static_cast<double>(num_used)),
                         Median(distances)));
}

Eigen::Vector3d MeanPoint(const SceneModel& model) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Point3D& point : model.reconstruction.points) {
    sum += point.point_in_world;
  }
  if (model.reconstruction.points.empty()) {
    throw Error(
        "the model has no points, whose center --alignment_type enu-plane "
        "needs; choose enu");
  }
  return sum / static_cast<double>(model.reconstruction.points.size());
}

// The transform from the east-north-up world of the first position to the world
// of the alignment type. `scale` is the scale of the alignment.
Sim3 FromEastNorthUp(AlignmentType type, double scale, ModelFile* input) {
  Sim3 transform;
  const bool keeps_world =
      type == AlignmentType::kCustom || type == AlignmentType::kEnu;
  if (keeps_world) return transform;
  const Eigen::Vector3d origin = *input->origin_wgs84;
  Rigid3 to_from_enu = EarthFromEastNorthUp(origin);
  if (type == AlignmentType::kEcef) {
    input->origin_wgs84.reset();
  } else {
    input->origin_wgs84 =
        LatitudeLongitudeAltitude(MeanPoint(input->model), origin);
    to_from_enu =
        EarthFromEastNorthUp(*input->origin_wgs84).Inverse() * to_from_enu;
  }
  transform.rotation = to_from_enu.rotation;
  transform.translation = to_from_enu.translation;
  if (type == AlignmentType::kEnuPlaneUnscaled) {
    transform.scale = 1.0 / scale;
    transform.translation /= scale;
    input->origin_wgs84.reset();
  }
  return transform;
}

Sim3 AlignToPositions(const ModelAlignerOptions& options, ModelFile* input,
                      const Context& context) {
  const Scene& scene = input->model.scene;
  const std::string reference_path = options.database_path->empty()
                                         ? options.ref_images_path
                                         : options.database_path;
  ReferencePositions reference = ReadReference(options, scene, context);
  if (!options.body_calibration->empty()) {
    SetAntenna(scene, ReadBodyOfModel(scene, options.body_calibration),
               &reference.positions);
  }
  const PositionPriors& positions = reference.positions;
  if (NeedsGps(options.alignment_type) && !positions.origin_wgs84) {
    throw Error("the positions in '" + reference_path +
                "' are Cartesian; --alignment_type " +
                std::string(EnumName(*options.alignment_type)) + " needs GPS");
  }
  const auto num_positions = static_cast<size_t>(
      CountIf(positions.images, [](const auto& p) { return p.has_value(); }));
  context.Info(Formatted("'%s' has %s of %zu of %zu images",
                         reference_path.c_str(),
                         positions.origin_wgs84 ? "latitudes and longitudes"
                                                : "Cartesian positions",
                         num_positions, scene.images.size()));
  CheckCount(num_positions, reference_path, options);
  const Reconstruction before = input->model.reconstruction;
  const PositionRegistration registration =
      RegisterToPriors(scene, positions,
                       {MeasuredUp(reference, input->model),
                        !options.estimate_scale, context.random_seed,
                        options.robust_alignment ? OutlierRule::kFixedBound
                                                 : OutlierRule::kNone},
                       &input->model.reconstruction);
  if (!registration.summary.is_registered) {
    throw Error("'" + *options.input_path + "' cannot be aligned to '" +
                reference_path + "': " + registration.summary.message +
                " Set --alignment_max_error to the accuracy of the positions.");
  }
  const std::vector<Eigen::Vector3d> offsets =
      OffsetsOf(positions, input->model);
  CheckAgreement(
      options, {reference_path, "positions", options.alignment_max_error},
      Transformed(offsets, [](const auto& offset) { return offset.norm(); }),
      context);
  if (!registration.summary.message.empty()) {
    context.Warning(registration.summary.message);
  }
  if (options.merge_image_and_ref_origins) {
    Sim3 shift;
    shift.translation = offsets.front();
    TransformWorld(shift, &input->model.reconstruction);
  }
  input->origin_wgs84 = positions.origin_wgs84;
  const double scale = FindTransform(before, input->model.reconstruction).scale;
  TransformWorld(FromEastNorthUp(options.alignment_type, scale, input),
                 &input->model.reconstruction);
  return FindTransform(before, input->model.reconstruction);
}

Sim3 AlignToModel(const ModelAlignerOptions& options, ModelFile* input,
                  const Context& context) {
  const ModelFile reference =
      ReadModelFile(options.ref_model_path, ModelRigOptions(), context);
  const std::vector<ImagePoses> pairs =
      PairImages(input->model, reference.model);
  CheckCount(pairs.size(), options.ref_model_path, options);
  Sim3 transform =
      *AlignPoses(pairs, options.estimate_scale ? Alignment::kSimilarity
                                                : Alignment::kRigid);
  const ImageAgreement agreement =
      CompareCenters(pairs, transform, reference.model.reconstruction);
  const double max_error =
      std::min<double>(options.alignment_max_error, agreement.max_distance);
  CheckAgreement(options, {options.ref_model_path, "common images", max_error},
                 agreement.distances, context);
  TransformWorld(transform, &input->model.reconstruction);
  input->origin_wgs84 = reference.origin_wgs84;
  return transform;
}

Sim3 Align(const ModelAlignerOptions& options, ModelFile* input,
           const Context& context) {
  if (options.alignment_type == AlignmentType::kPlane) {
    std::optional<Eigen::Vector3d> up;
    if (options.use_prior_gravity) {
      up = MeasuredUp(ReadReference(options, input->model.scene, context),
                      input->model);
      if (!up) {
        throw Error("'" + *options.database_path +
                    "' has no gravity of an image of the model; drop "
                    "--use_prior_gravity");
      }
    }
    Sim3 transform = *AlignToGroundPlane(input->model, up);
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
  const Eigen::Vector3d& t = transform.translation;
  std::string text =
      FormatDouble(transform.scale, std::chars_format::general, 17);
  for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
    text += ' ' + FormatDouble(value, std::chars_format::general, 17);
  }
  return text + '\n';
}

int RunModelAligner(const ModelAlignerOptions& options,
                    const Context& context) {
  CheckUsage(options);
  Sim3 transform;
  EditModel(options, context, [&](ModelFile* file) {
    transform = Align(options, file, context);
  });
  if (!options.transform_path->empty()) {
    ReplaceFile(*options.transform_path, TransformText(transform));
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
