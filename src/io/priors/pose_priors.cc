// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/priors/pose_priors.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text.h"
#include "database/database_rows.h"
#include "database/sqlite_database.h"
#include "files/file_operations.h"
#include "files/json_reading.h"
#include "geometry/geodetic.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "priors/body_calibration.h"
#include "priors/position_files.h"
#include "scene/item_lists.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

using CoordinateSystem = PosePriorRow::CoordinateSystem;

class PriorMaker {
 public:
  PriorMaker(const Scene& scene, const PosePriorOptions& options)
      : scene_(scene), options_(options) {
    rows_.resize(scene.images.size());
  }

  void TakeRows(const std::vector<PosePriorRow>& rows,
                const std::string& source) {
    source_ = source;
    const auto idx_of_id = IndexById(scene_.images);
    for (const PosePriorRow& row : rows) {
      // Rows of a deleted image are harmless.
      const auto found = idx_of_id.find(row.image_id);
      if (found != idx_of_id.end()) rows_[found->second] = row;
    }
  }

  void ReadLines() {
    const std::string& path = options_.ref_images_path;
    source_ = "'" + path + "'";
    const PositionFileFormat format = options_.ref_columns->empty()
                                          ? DetectPositionFormat(path)
                                          : PositionFileFormat::kCsv;
    if (format == PositionFileFormat::kCsv) return ReadCsv();
    if (format != PositionFileFormat::kNamed) {
      // Degrees in trajectories are rare, so they must be stated.
      const auto system = *options_.ref_is_gps == PositionKind::kGps
                              ? CoordinateSystem::kWgs84
                              : CoordinateSystem::kCartesian;
      for (const auto& [image_idx, position] : ReadTrajectoryPositions(
               scene_, path, format, options_.prior_clock_offset_s)) {
        AddPosition(image_idx, position, system);
      }
      return;
    }
    for (const NamedVector& line :
         ReadNamedVectors(scene_, path, "X Y Z", "ref_images_path")) {
      AddPosition(line.image_idx, line.value, CoordinateSystem::kUndefined);
    }
  }

  // Receivers without a fix write zeros, between which nothing is known.
  void ReadCsv() {
    const std::string& path = options_.ref_images_path;
    std::vector<TimedVector> vectors =
        ReadTimedPositions(path, options_.ref_columns);
    const bool are_gps = AreGps(Transformed(vectors, &TimedVector::value),
                                options_.ref_is_gps, source_);
    if (are_gps) {
      EraseIf(&vectors, [](const TimedVector& vector) {
        return vector.value.head<2>().isZero(0.0);
      });
    }
    for (const auto& [image_idx, vector] : InterpolateVectors(
             scene_, path, vectors, options_.prior_clock_offset_s)) {
      AddPosition(
          image_idx, vector.value,
          are_gps ? CoordinateSystem::kWgs84 : CoordinateSystem::kCartesian);
      rows_[image_idx]->covariance = vector.covariance;
    }
  }

  PositionPriors Make() {
    PositionPriors priors;
    priors.images.resize(scene_.images.size());
    undefined_are_gps_ = AreUndefinedGps();
    std::optional<bool> are_gps;
    for (size_t i = 0; i < rows_.size(); ++i) {
      if (!rows_[i]) continue;
      Check(*rows_[i], static_cast<int>(i));
      const bool is_gps = IsGps(*rows_[i]);
      if (are_gps.value_or(is_gps) != is_gps) {
        Throw(
            "positions are partly WGS84, partly Cartesian; give all of one "
            "kind");
      }
      are_gps = is_gps;
      if (is_gps && rows_[i]->position.head<2>().isZero(0.0)) {
        ++priors.num_null_fixes;
        continue;
      }
      if (is_gps && !priors.origin_wgs84) {
        priors.origin_wgs84 = rows_[i]->position;
      }
      priors.images[i] = PositionMeasurement{
          is_gps ? EastNorthUp(rows_[i]->position, *priors.origin_wgs84)
                 : rows_[i]->position,
          CovarianceOf(*rows_[i])};
    }
    if (!are_gps || (*are_gps && !priors.origin_wgs84)) {
      Throw(
          "there are no positions of images; extract features of images with "
          "GPS, set ref_images_path, or do not set use_prior_position");
    }
    const auto problem = *are_gps ? WhyRigsAreNotMetric(scene_) : std::nullopt;
    if (problem) Throw("positions are GPS, but " + *problem);
    return priors;
  }

 private:
  void AddPosition(int image_idx, const Eigen::Vector3d& position,
                   CoordinateSystem coordinate_system) {
    PosePriorRow row;
    row.coordinate_system = coordinate_system;
    row.position = position;
    row.image_id = scene_.images[image_idx].id;
    rows_[image_idx] = row;
  }
  [[noreturn]] void Throw(const std::string& problem) const {
    throw Error(source_ + ": " + problem);
  }
  void Check(const PosePriorRow& row, int image_idx) const;
  Eigen::Matrix3d CovarianceOf(const PosePriorRow& row) const;

  bool IsGps(const PosePriorRow& row) const {
    return row.coordinate_system == CoordinateSystem::kWgs84 ||
           (row.coordinate_system == CoordinateSystem::kUndefined &&
            undefined_are_gps_);
  }
  bool AreUndefinedGps() const;

  const Scene& scene_;
  const PosePriorOptions& options_;
  std::string source_;
  std::vector<std::optional<PosePriorRow>> rows_;  // per image
  bool undefined_are_gps_ = false;
};

bool PriorMaker::AreUndefinedGps() const {
  std::vector<Eigen::Vector3d> positions;
  for (const auto& row : rows_) {
    if (row && row->coordinate_system == CoordinateSystem::kUndefined) {
      positions.push_back(row->position);
    }
  }
  return AreGps(positions, options_.ref_is_gps, source_);
}

void PriorMaker::Check(const PosePriorRow& row, int image_idx) const {
  const std::string of_image =
      " of image '" + scene_.images[image_idx].name + "'";
  if (!row.position.allFinite()) {
    Throw("the position" + of_image +
          " is not finite; correct it, or delete its row");
  }
  if (IsGps(row) && (std::abs(row.position.x()) > 90.0 ||
                     std::abs(row.position.y()) > 360.0)) {
    Throw(
        "the position" + of_image +
        " is not a latitude and longitude in degrees; if it is Cartesian, set "
        "its coordinate system");
  }
  if (!row.covariance || options_.overwrite_priors_covariance) return;
  const Eigen::LLT<Eigen::Matrix3d> llt(*row.covariance);
  if (!row.covariance->allFinite() || llt.info() != Eigen::Success) {
    Throw("the covariance of the position" + of_image +
          " is not positive definite; correct it, or set "
          "overwrite_priors_covariance");
  }
}

Eigen::Matrix3d PriorMaker::CovarianceOf(const PosePriorRow& row) const {
  if (row.covariance && !options_.overwrite_priors_covariance) {
    return *row.covariance;
  }
  return Eigen::Vector3d(options_.prior_position_std_x_m,
                         options_.prior_position_std_y_m,
                         options_.prior_position_std_z_m)
      .cwiseAbs2()
      .asDiagonal();
}

GravityPriors ReadTimedGravity(const Scene& scene, const std::string& path,
                               double clock_offset_s) {
  std::vector<TimedVector> directions = ReadTimedVectors(path);
  for (TimedVector& direction : directions) {
    if (direction.value.isZero(0.0)) {
      throw Error(
          "'" + path + "': the direction of gravity at " +
          FormatDouble(direction.timestamp_s, std::chars_format::fixed, 6) +
          " s is zero; delete the line");
    }
    direction.value.stableNormalize();
  }
  GravityPriors gravity;
  gravity.images.resize(scene.images.size());
  for (const auto& [image_idx, direction] :
       InterpolateVectors(scene, path, directions, clock_offset_s)) {
    if (direction.value.isZero(0.0)) continue;  // between opposite ones
    gravity.images[image_idx] = direction.value.stableNormalized();
  }
  return gravity;
}

// From the axes of the reference cameras; those of a camera whose pose is to be
// estimated are unknown.
void TurnFromReferences(const Scene& scene, const std::string& path,
                        GravityPriors* gravity) {
  bool has_any = false, has_lost = false;
  for (size_t i = 0; i < gravity->images.size(); ++i) {
    auto& direction = gravity->images[i];
    if (!direction) continue;
    const auto& pose =
        scene.sensors[scene.images[i].sensor_idx].sensor_from_rig;
    if (pose) {
      direction = pose->rotation * *direction;
      has_any = true;
    } else {
      direction.reset();
      has_lost = true;
    }
  }
  if (has_any || !has_lost) return;
  throw Error("'" + path +
              "' has directions in the axes of the reference camera, but all "
              "at times of cameras with unknown poses; give their poses with "
              "rig_config_path, or a body_calibration");
}

GravityPriors ReadGravityFile(const Scene& scene,
                              const PosePriorOptions& options) {
  const std::string& path = options.gravity_path;
  if (HasTimedVectors(scene, path)) {
    GravityPriors gravity =
        ReadTimedGravity(scene, path, options.prior_clock_offset_s);
    const bool are_of_body = !options.body_calibration->empty();
    if (!are_of_body) TurnFromReferences(scene, path, &gravity);
    return gravity;
  }
  GravityPriors gravity;
  gravity.images.resize(scene.images.size());
  const auto lines = ReadNamedVectors(scene, path, "GX GY GZ", "gravity_path");
  if (lines.empty()) {
    throw Error("'" + path +
                "': there is no line 'image_name GX GY GZ'; add some, or do "
                "not set gravity_path");
  }
  for (const NamedVector& line : lines) {
    if (line.value.isZero(0.0)) {
      throw Error("'" + path + "': line " + std::to_string(line.line_number) +
                  " has no direction of gravity for image '" +
                  scene.images[line.image_idx].name +
                  "'; give numbers that are not all zero");
    }
    gravity.images[line.image_idx] = line.value.stableNormalized();
  }
  return gravity;
}

// From the axes of the inertial sensor.
void TurnToCameras(const Scene& scene, const BodyFrame& body,
                   GravityPriors* gravity) {
  for (size_t i = 0; i < gravity->images.size(); ++i) {
    auto& direction = gravity->images[i];
    if (!direction) continue;
    direction =
        body.CamFromBody(scene, static_cast<int>(i)).rotation * *direction;
  }
}

// COLMAP writes values that are not finite for an unknown gravity.
GravityPriors ReadGravityColumn(const Scene& scene,
                                const std::string& database_path) {
  GravityPriors gravity;
  gravity.images.resize(scene.images.size());
  const auto idx_of_id = IndexById(scene.images);
  const SqliteSnapshot snapshot(database_path);
  for (const PosePriorRow& row : ReadPosePriorRows(snapshot.database())) {
    const auto found = idx_of_id.find(row.image_id);
    if (found == idx_of_id.end() || !row.gravity) continue;
    if (row.gravity->isZero(0.0)) {
      throw Error("database '" + database_path + "': the gravity of image '" +
                  scene.images[found->second].name +
                  "' is zero; correct it, or delete its row");
    }
    gravity.images[found->second] = row.gravity->stableNormalized();
  }
  snapshot.CheckUnchanged();
  return gravity;
}

}  // namespace

bool AreGps(const std::vector<Eigen::Vector3d>& positions, PositionKind kind,
            const std::string& source) {
  if (kind != PositionKind::kAuto) return kind == PositionKind::kGps;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& position : positions) {
    // Receivers without a fix write zeros.
    if (!position.head<2>().isZero(0.0)) box.extend(position);
  }
  if (box.isEmpty()) return false;
  constexpr double kMinDistanceRatio = 10.0;  // from zero, in extents
  constexpr double kSmallExtentDeg = 0.01;    // 1 km
  constexpr double kMaxExtentDeg = 1.0;       // 100 km
  const double extent = box.sizes().head<2>().maxCoeff();
  const bool is_in_range = box.min().x() >= -90.0 && box.max().x() <= 90.0 &&
                           box.min().y() >= -360.0 && box.max().y() <= 360.0;
  const bool is_far =
      box.center().head<2>().norm() > kMinDistanceRatio * extent;
  if (!is_in_range || !is_far) return false;
  // In degrees, these positions would lie in the Gulf of Guinea.
  const bool fits_radians = box.min().x() >= -0.5 * kPi &&
                            box.max().x() <= 0.5 * kPi &&
                            box.min().y() >= -kPi && box.max().y() <= kPi;
  if (fits_radians) {
    throw Error(source +
                ": positions may be radians; convert them to degrees, or set "
                "ref_is_gps (SpatialMatching.is_gps) to 1 if they are degrees, "
                "to 0 if they are lengths");
  }
  // Heights in meters differ by more than degrees do, lengths by less.
  const bool is_flat = box.sizes().z() <= extent;
  if (extent <= (is_flat ? kSmallExtentDeg : kMaxExtentDeg)) return true;
  throw Error(source +
              ": positions may be degrees or lengths; set ref_is_gps "
              "(SpatialMatching.is_gps) to 1 if they are latitude, longitude "
              "and altitude, else to 0");
}

PositionPriors MakePositionPriors(const Scene& scene,
                                  const std::vector<PosePriorRow>& rows,
                                  const std::string& source,
                                  const PosePriorOptions& options) {
  if (!options.AreUsed()) return {};
  PriorMaker maker(scene, options);
  if (options.ref_images_path->empty()) {
    maker.TakeRows(rows, source);
  } else {
    maker.ReadLines();
  }
  PositionPriors priors = maker.Make();
  if (!options.body_calibration->empty()) {
    SetAntenna(scene, ReadBody(scene, options.body_calibration), &priors);
  }
  return priors;
}

PositionPriors ReadPositionPriors(const Scene& scene,
                                  const std::string& database_path,
                                  const PosePriorOptions& options) {
  const std::string& body = options.body_calibration;
  if (!body.empty() && !options.AreUsed() && options.gravity_path->empty()) {
    throw Error("'" + body +
                "' (body_calibration) would not be read: it is for positions "
                "and gravity_path; set use_prior_position, ref_images_path or "
                "gravity_path, or omit it");
  }
  std::vector<PosePriorRow> rows;
  if (options.AreUsed() && options.ref_images_path->empty()) {
    const SqliteSnapshot snapshot(database_path);
    rows = ReadPosePriorRows(snapshot.database());
    snapshot.CheckUnchanged();
  }
  return MakePositionPriors(scene, rows, "database '" + database_path + "'",
                            options);
}

GravityPriors ReadGravity(const Scene& scene, const std::string& database_path,
                          const PosePriorOptions& options) {
  if (!options.gravity_path->empty()) {
    GravityPriors gravity = ReadGravityFile(scene, options);
    if (!options.body_calibration->empty()) {
      TurnToCameras(scene, ReadBody(scene, options.body_calibration), &gravity);
    }
    return gravity;
  }
  if (!options.use_prior_gravity) return {};
  GravityPriors gravity = ReadGravityColumn(scene, database_path);
  if (NoneOf(gravity.images, [](const auto& g) { return g.has_value(); })) {
    throw Error("database '" + database_path +
                "': there are no directions of gravity; set gravity_path, or "
                "do not set use_prior_gravity");
  }
  return gravity;
}

void WriteGeoOrigin(const std::string& path,
                    const Eigen::Vector3d& origin_wgs84) {
  const nlohmann::ordered_json json = {{"latitude_deg", origin_wgs84.x()},
                                       {"longitude_deg", origin_wgs84.y()},
                                       {"altitude_m", origin_wgs84.z()}};
  WriteFile(path, json.dump(2) + "\n");
}

void CheckGeoOrigin(const Eigen::Vector3d& origin_wgs84,
                    const std::string& source) {
  if (origin_wgs84.allFinite() && std::abs(origin_wgs84.x()) <= 90.0 &&
      std::abs(origin_wgs84.y()) <= 360.0) {
    return;
  }
  throw Error(source +
              " is not a latitude and longitude in degrees and an altitude in "
              "meters; correct it");
}

std::optional<Eigen::Vector3d> ReadGeoOrigin(const std::string& model_folder) {
  const std::filesystem::path path =
      std::filesystem::path(model_folder) / "geo_origin.json";
  if (!std::filesystem::exists(path)) return std::nullopt;
  const nlohmann::json json = ParseJson(
      ReadFile(path), "'" + path.string() + "'", "correct or delete it");
  try {
    const Eigen::Vector3d origin(json.at("latitude_deg").get<double>(),
                                 json.at("longitude_deg").get<double>(),
                                 json.at("altitude_m").get<double>());
    CheckGeoOrigin(origin, "'" + path.string() + "'");
    return origin;
  } catch (const nlohmann::json::exception&) {
    throw Error(
        "'" + path.string() +
        "' is not an object with the numbers latitude_deg, longitude_deg "
        "and altitude_m; correct or delete it");
  }
}

void WriteGravity(const std::string& path, const Scene& scene,
                  const GravityPriors& gravity) {
  std::string text;
  for (size_t i = 0; i < gravity.images.size(); ++i) {
    if (!gravity.images[i]) continue;
    text += scene.images[i].name;
    for (const double value : *gravity.images[i]) {
      text += ' ' + FormatDouble(value, std::chars_format::general, 17);
    }
    text += "\n";
  }
  WriteFile(path, text);
}

std::vector<PosePriorRow> MakePosePriorRows(const Scene& scene,
                                            const PositionPriors& priors) {
  std::vector<PosePriorRow> rows;
  for (size_t i = 0; i < priors.images.size(); ++i) {
    if (!priors.images[i]) continue;
    rows.push_back({scene.images[i].id, CoordinateSystem::kCartesian,
                    priors.images[i]->position, priors.images[i]->covariance});
  }
  return rows;
}

}  // namespace mgsfm
