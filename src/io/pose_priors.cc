// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/io/pose_priors.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "io/database_rows.h"
#include "io/sqlite_snapshot.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/geodetic.h"
#include "mgsfm/io/output_file.h"

namespace mgsfm {
namespace {

using CoordinateSystem = PosePriorRow::CoordinateSystem;

class PriorMaker {
 public:
  PriorMaker(const Scene& scene, const PosePriorOptions& options)
      : scene_(scene), options_(options) {
    for (size_t i = 0; i < scene.images.size(); ++i) {
      idx_of_name_[scene.images[i].name] = static_cast<int>(i);
    }
    rows_.resize(scene.images.size());
  }

  void TakeRows(const std::vector<PosePriorRow>& rows,
                const std::string& database_path) {
    source_ = "database '" + database_path + "'";
    std::map<ImageId, int> idx_of_id;
    for (const auto& [name, idx] : idx_of_name_) {
      idx_of_id[scene_.images[idx].id] = idx;
    }
    for (const PosePriorRow& row : rows) {
      // Rows left behind by an image that was deleted are harmless.
      const auto found = idx_of_id.find(row.image_id);
      if (found != idx_of_id.end()) rows_[found->second] = row;
    }
  }

  void ReadLines() {
    const std::string& path = options_.ref_images_path;
    source_ = "'" + path + "'";
    std::ifstream file(path);
    if (!file) Throw("cannot be read; check --ref_images_path");
    std::string line;
    for (int number = 1; std::getline(file, line); ++number) {
      if (!line.empty() && line.back() == '\r') line.pop_back();
      if (line.find_first_not_of(" \t") == std::string::npos ||
          line.front() == '#') {
        continue;
      }
      TakeLine(line, "line " + std::to_string(number));
    }
  }

  PositionPriors Make() {
    PositionPriors priors;
    priors.images.resize(scene_.images.size());
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
      if (is_gps && !priors.origin_wgs84) {
        priors.origin_wgs84 = rows_[i]->position;
      }
      priors.images[i] = PositionMeasurement{
          is_gps ? EastNorthUp(rows_[i]->position, *priors.origin_wgs84)
                 : rows_[i]->position,
          CovarianceOf(*rows_[i])};
    }
    if (!are_gps) {
      Throw(
          "there are no positions of images; extract features of images with "
          "GPS, give --ref_images_path, or leave out --use_prior_position");
    }
    return priors;
  }

 private:
  [[noreturn]] void Throw(const std::string& problem) const {
    throw Error(source_ + ": " + problem);
  }
  void TakeLine(const std::string& line, const std::string& where);
  void Check(const PosePriorRow& row, int image_idx) const;
  Eigen::Matrix3d CovarianceOf(const PosePriorRow& row) const;

  bool IsGps(const PosePriorRow& row) const {
    return row.coordinate_system == CoordinateSystem::kWgs84 ||
           (row.coordinate_system == CoordinateSystem::kUndefined &&
            options_.ref_is_gps);
  }

  const Scene& scene_;
  const PosePriorOptions& options_;
  std::string source_;
  std::map<std::string, int> idx_of_name_;
  std::vector<std::optional<PosePriorRow>> rows_;  // per image
};

// Names may have blanks: the last three words are the position.
void PriorMaker::TakeLine(const std::string& line, const std::string& where) {
  std::vector<std::string> words;
  std::istringstream stream(line);
  for (std::string word; stream >> word;) words.push_back(word);
  if (words.size() < 4) Throw(where + " is not 'image_name X Y Z'");
  PosePriorRow row;
  row.coordinate_system = CoordinateSystem::kUndefined;
  size_t end = line.size();
  for (int k = 2; k >= 0; --k) {
    const std::string& word = words[words.size() - 3 + k];
    char* rest = nullptr;
    row.position[k] = std::strtod(word.c_str(), &rest);
    if (rest == word.c_str() || *rest != '\0') {
      Throw(where + " has '" + word + "' where a number should be");
    }
    end = line.rfind(word, end - 1);
  }
  std::string name = line.substr(0, end);
  name.erase(name.find_last_not_of(" \t") + 1);
  name.erase(0, name.find_first_not_of(" \t"));
  const auto found = idx_of_name_.find(name);
  if (found == idx_of_name_.end()) {
    Throw(where + " names the image '" + name +
          "', which the database does not have");
  }
  if (rows_[found->second]) Throw(where + " names '" + name + "' again");
  row.image_id = scene_.images[found->second].id;
  rows_[found->second] = row;
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
    Throw("the position" + of_image +
          " is no latitude and longitude in degrees; if it is Cartesian, its "
          "coordinate system must say so");
  }
  if (!row.covariance || options_.overwrite_priors_covariance) return;
  const Eigen::LLT<Eigen::Matrix3d> llt(*row.covariance);
  if (!row.covariance->allFinite() || llt.info() != Eigen::Success) {
    Throw("the covariance of the position" + of_image +
          " is not positive definite; correct it, or use "
          "--overwrite_priors_covariance 1");
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

}  // namespace

PositionPriors MakePositionPriors(const Scene& scene,
                                  const std::vector<PosePriorRow>& rows,
                                  const std::string& database_path,
                                  const PosePriorOptions& options) {
  if (!options.AreUsed()) return {};
  PriorMaker maker(scene, options);
  if (options.ref_images_path.empty()) {
    maker.TakeRows(rows, database_path);
  } else {
    maker.ReadLines();
  }
  return maker.Make();
}

PositionPriors ReadPositionPriors(const Scene& scene,
                                  const std::string& database_path,
                                  const PosePriorOptions& options) {
  std::vector<PosePriorRow> rows;
  if (options.AreUsed() && options.ref_images_path.empty()) {
    const SqliteSnapshot snapshot(database_path);
    if (snapshot.database().HasTable("pose_priors")) {
      SqliteStatement row =
          snapshot.database().Prepare(PosePriorQuery(snapshot.database()));
      while (row.Step()) rows.push_back(DecodePosePrior(row));
    }
    snapshot.CheckUnchanged();
  }
  return MakePositionPriors(scene, rows, database_path, options);
}

void WriteGeoOrigin(const std::string& path,
                    const Eigen::Vector3d& origin_wgs84) {
  const nlohmann::ordered_json json = {{"latitude_deg", origin_wgs84.x()},
                                       {"longitude_deg", origin_wgs84.y()},
                                       {"altitude_m", origin_wgs84.z()}};
  WriteFile(path, json.dump(2) + "\n");
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
