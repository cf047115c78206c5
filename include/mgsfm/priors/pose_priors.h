// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The kind of positions without a coordinate system.
enum class PositionKind { kAuto, kGps, kCartesian };

template <>
struct EnumTable<PositionKind> {
  static constexpr std::pair<std::string_view, PositionKind> kNames[] = {
      {"auto", PositionKind::kAuto},       {"1", PositionKind::kGps},
      {"0", PositionKind::kCartesian},     {"true", PositionKind::kGps},
      {"false", PositionKind::kCartesian},
  };
};

constexpr char kPositionKindHelp[] =
    "State whether positions in a file, or in a database without coordinate "
    "system, are latitude, longitude (deg) and altitude (m). auto decides by "
    "their range: degrees of one recording differ by less than 1 and are far "
    "from zero.";

// Measured positions of images, by GPS or in any Cartesian world, and measured
// gravity: from the table pose_priors of the database, or from a file with one
// line "image_name X Y Z" per image, where '#' starts comments. TUM and KITTI
// trajectories are also read as positions.
struct PosePriorOptions {
  Option<bool> use_prior_position{
      "use_prior_position", false,
      "Use the image positions in the table pose_priors (GPS or Cartesian) to "
      "place models in their world and as priors of bundle adjustment."};
  Option<std::string> ref_images_path{
      "ref_images_path", "",
      "Use the positions in this file instead of the table pose_priors: one "
      "line `image_name X Y Z` per image, a trajectory of the reference camera "
      "in the format of TUM, EuRoC (by image times) or KITTI (one line per "
      "frame), or a CSV file with positions by time."};
  Option<std::string> ref_columns{
      "ref_columns", "",
      "Name the columns of a CSV file in ref_images_path, as KEY=COLUMN "
      "separated by commas. Keys are time (s), time_ms, time_us, time_ns; x, "
      "y, z or latitude, longitude, altitude; std_x, std_y, std_z (m). A key "
      "without an item is a column of that name."};
  Option<double> prior_clock_offset_s{
      "prior_clock_offset_s", 0.0, Between(-1e10, 1e10), "s",
      "Add this to image times to get times of ref_images_path and "
      "gravity_path, whose clock is ahead by it."};
  Option<std::string> body_calibration{
      "body_calibration", "",
      "Read the poses of cameras relative to an inertial sensor (T_cam_imu of "
      "Kalibr, or a URDF) and the antenna (antenna_in_imu) from this file. "
      "Positions are those of the antenna, and directions in gravity_path are "
      "in the axes of the inertial sensor."};
  Option<PositionKind> ref_is_gps{"ref_is_gps", PositionKind::kAuto,
                                  kPositionKindHelp};
  Option<bool> overwrite_priors_covariance{
      "overwrite_priors_covariance", false,
      "Use the standard deviations below instead of the covariances of the "
      "database."};
  Option<double> prior_position_std_x_m{
      "prior_position_std_x", 1.0, GreaterThan(0.0), "m",
      "Set the east standard deviation of positions without covariance."};
  Option<double> prior_position_std_y_m{
      "prior_position_std_y", 1.0, GreaterThan(0.0), "m",
      "Set the north standard deviation of positions without covariance."};
  Option<double> prior_position_std_z_m{
      "prior_position_std_z", 1.0, GreaterThan(0.0), "m",
      "Set the vertical standard deviation of positions without covariance."};
  Option<bool> use_prior_gravity{
      "use_prior_gravity", false,
      "Use the gravity directions in the table pose_priors to level the "
      "rotations; gravity is along +y in the models."};
  Option<std::string> gravity_path{
      "gravity_path", "",
      "Use the gravity directions in this file instead, one line `image_name "
      "GX GY GZ` per image, in the camera frame, or lines `SECONDS GX GY GZ`, "
      "in that of the reference camera, interpolated at image times."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(use_prior_position, ref_images_path, ref_columns,
          prior_clock_offset_s, body_calibration, ref_is_gps,
          overwrite_priors_covariance, prior_position_std_x_m,
          prior_position_std_y_m, prior_position_std_z_m, use_prior_gravity,
          gravity_path);
  }

  bool AreUsed() const {
    return use_prior_position || !ref_images_path->empty();
  }
  // Positions or gravity.
  bool HaveAny() const {
    return AreUsed() || use_prior_gravity || !gravity_path->empty();
  }
};

// Whether positions without a coordinate system are latitude, longitude and
// altitude. Throws Error, naming `source`, if kAuto cannot decide.
[[nodiscard]] bool AreGps(const std::vector<Eigen::Vector3d>& positions,
                          PositionKind kind, const std::string& source);

// The priors of a scene; empty if the options use none. Positions in degrees
// are converted to meters east, north and up of the first position by image
// name. Throws Error, naming the image, for a position or covariance that is
// not finite or impossible, for mixed coordinate systems, and for an image that
// is unknown or repeated, and those of ReadBody. Also throws Error if the file
// cannot be read, if there is no position, and if positions are GPS but known
// sensor poses cannot be in meters. `source` names the rows in messages.
[[nodiscard]] PositionPriors MakePositionPriors(
    const Scene& scene, const std::vector<PosePriorRow>& rows,
    const std::string& source, const PosePriorOptions& options);

// Reads the rows of a database, which it does not change.
[[nodiscard]] PositionPriors ReadPositionPriors(
    const Scene& scene, const std::string& database_path,
    const PosePriorOptions& options);

// The directions of gravity in the camera frame, as unit vectors: from a file
// with lines "image_name GX GY GZ", or from the column `gravity` of pose_priors
// (COLMAP 4.0 and later), both of any length. Empty if the options use none.
// Throws Error, naming the line or image, for a direction that is zero or, in a
// file, not finite, and for the reasons above.
[[nodiscard]] GravityPriors ReadGravity(const Scene& scene,
                                        const std::string& database_path,
                                        const PosePriorOptions& options);
void WriteGravity(const std::string& path, const Scene& scene,
                  const GravityPriors& gravity);

// Writes the origin of an east-north-up world as {"latitude_deg",
// "longitude_deg", "altitude_m"}.
void WriteGeoOrigin(const std::string& path,
                    const Eigen::Vector3d& origin_wgs84);

// Reads the origin from geo_origin.json in the folder of a model; nullopt
// without the file. Throws Error, naming the file, unless it holds a latitude,
// a longitude and an altitude.
[[nodiscard]] std::optional<Eigen::Vector3d> ReadGeoOrigin(
    const std::string& model_folder);
// Throws Error, naming `source`, unless latitude and longitude (degrees) and
// altitude (meters) are valid.
void CheckGeoOrigin(const Eigen::Vector3d& origin_wgs84,
                    const std::string& source);

// Rows for a database, in Cartesian coordinates.
[[nodiscard]] std::vector<PosePriorRow> MakePosePriorRows(
    const Scene& scene, const PositionPriors& priors);

}  // namespace mgsfm
