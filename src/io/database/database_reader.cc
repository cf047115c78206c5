// SPDX-License-Identifier: BSD-3-Clause
#include "io/database/database_reader.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <unordered_map>

#include "base/parallel.h"
#include "base/text.h"
#include "io/database/database_pair_id.h"
#include "io/database/database_rows.h"
#include "io/database/sqlite_snapshot.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/io/database/database.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

class DatabaseReader {
 public:
  DatabaseReader(const SqliteDatabase& database,
                 const DatabaseSelection& selection, const Context& context)
      : database_(database), selection_(selection), context_(context) {
    contents_.path = database.path();
  }

  DatabaseContents Read() {
    CheckTables();
    ReadCameras();
    ReadImages();
    contents_.is_selection = !left_out_ids_.empty();
    if (contents_.images.empty() && left_out_ids_.empty()) {
      Throw("has no images; run the feature extractor first");
    }
    if (selection_.has_keypoints) {
      ReadKeypoints();
      CheckKeypoints();
    }
    ReadPairs();
    if (selection_.has_keypoints) CheckMatches();
    ReadRigsAndFrames();
    return std::move(contents_);
  }

  DatabaseContents ReadStructure() {
    CheckTables();
    ReadCameras();
    ReadImages();
    ReadRigsAndFrames();
    return std::move(contents_);
  }

 private:
  [[noreturn]] void Throw(const std::string& problem) const {
    ThrowDatabaseError(contents_.path, problem);
  }
  bool Next(SqliteStatement* row) const {
    context_.CheckInterrupted();
    return row->Step();
  }

  void CheckTables();
  void ReadCameras();
  void ReadImages();
  void ReadKeypoints();
  void CheckKeypoints() const;
  void ReadPairs();
  void CheckMatches() const;
  void ReadRigsAndFrames();
  void ReadRigs();
  void ReadRigSensors();
  void ReadFrames();

  Camera DecodeCamera(const SqliteStatement& row) const;
  void DecodePair(const SqliteStatement& row);

  // The id in a column; `what` names the row.
  template <class IdType>
  IdType CheckedId(int64_t value, const std::string& what) const {
    if (value < 0 || value >= kMaxNumIds) {
      Throw(what + " has the id " + std::to_string(value) +
            ", which is out of range; create the database again");
    }
    return IdType(static_cast<uint32_t>(value));
  }
  bool IsSelected(const std::string& image_name) const {
    return selection_.image_names.empty() ||
           selection_.image_names.count(image_name) > 0;
  }
  bool IsLeftOut(int64_t image_id) const {
    return std::binary_search(left_out_ids_.begin(), left_out_ids_.end(),
                              image_id);
  }
  // Position of an image in contents_.images, nullptr if there is none.
  const size_t* FindImage(int64_t image_id) const {
    const auto it = image_positions_.find(image_id);
    return it == image_positions_.end() ? nullptr : &it->second;
  }
  // "images 3 'a.jpg' and 7 'b.jpg'"
  std::string PairName(int64_t image_id1, int64_t image_id2) const;

  const SqliteDatabase& database_;
  const DatabaseSelection& selection_;
  const Context& context_;
  DatabaseContents contents_;
  std::unordered_map<int64_t, size_t> image_positions_;
  std::vector<int64_t> left_out_ids_;  // of images not selected, ascending
  std::string pair_table_;
};

void DatabaseReader::CheckTables() {
  for (const char* table : {"cameras", "images", "keypoints"}) {
    if (!database_.HasTable(table)) {
      Throw(std::string("has no table '") + table +
            "', so it is not a COLMAP database; give the one that COLMAP's "
            "feature extractor made");
    }
  }
  if (database_.HasTable("two_view_geometries")) {
    pair_table_ = "two_view_geometries";
  } else if (database_.HasTable("inlier_matches")) {
    pair_table_ = "inlier_matches";
  } else {
    Throw("has no table 'two_view_geometries'; match its images first");
  }
  if (!database_.HasTable("rigs")) return;
  for (const char* table : {"rig_sensors", "frames", "frame_data"}) {
    if (!database_.HasTable(table)) {
      Throw(std::string("has the table 'rigs' but no table '") + table + "'" +
            kConfigureAgain);
    }
  }
}

Camera DatabaseReader::DecodeCamera(const SqliteStatement& row) const {
  const std::string name = "camera " + std::to_string(row.Int(0));
  const CameraModelInfo* model = nullptr;
  const int64_t model_id = row.Int(1);
  if (model_id >= 0 && model_id <= std::numeric_limits<int32_t>::max()) {
    model = FindCameraModel(static_cast<int32_t>(model_id));
  }
  if (model == nullptr) {
    Throw(name + " has the unknown camera model " + std::to_string(model_id) +
          "; extract the features again with one of COLMAP's camera models");
  }
  Camera camera{
      CheckedId<CameraId>(row.Int(0), "a camera"), model->id, 0, 0, {}, false};
  const int64_t width = row.Int(2);
  const int64_t height = row.Int(3);
  constexpr int64_t kMaxSize = std::numeric_limits<int>::max();
  if (width <= 0 || height <= 0 || width > kMaxSize || height > kMaxSize) {
    Throw(name + " has the image size " + std::to_string(width) + " x " +
          std::to_string(height) + kExtractAgain);
  }
  camera.width_px = static_cast<int>(width);
  camera.height_px = static_cast<int>(height);
  const BlobView params = row.Blob(4);
  const auto num_params = static_cast<size_t>(model->num_params);
  if (params.size != num_params * sizeof(double)) {
    Throw(name + " has " + std::to_string(params.size) +
          " bytes of parameters, but " + std::string(model->name) + " has " +
          std::to_string(num_params) + " parameters" + kExtractAgain);
  }
  camera.params.resize(num_params);
  std::memcpy(camera.params.data(), params.data, params.size);
  if (const auto problem = WhyImplausible(camera)) {
    Throw(name + ' ' + *problem + kExtractAgain);
  }
  camera.has_prior_focal_length = row.Int(5) != 0;
  return camera;
}

void DatabaseReader::ReadCameras() {
  SqliteStatement row = database_.Prepare(
      "SELECT camera_id, model, width, height, params, prior_focal_length "
      "FROM cameras ORDER BY camera_id");
  while (Next(&row)) contents_.cameras.push_back(DecodeCamera(row));
}

void DatabaseReader::ReadImages() {
  std::set<int64_t> camera_ids;
  for (const Camera& camera : contents_.cameras) {
    camera_ids.insert(camera.id.value());
  }
  std::set<std::string> names;
  SqliteStatement row = database_.Prepare(
      "SELECT image_id, name, camera_id FROM images ORDER BY image_id");
  while (Next(&row)) {
    const std::string name = row.Text(1);
    const std::string what =
        "image " + std::to_string(row.Int(0)) + " '" + Printable(name) + "'";
    if (const auto problem = WhyUnusable(name)) {
      Throw("the name of " + what + ' ' + *problem +
            "; rename the file and extract the features again");
    }
    if (name.empty() || !names.insert(name).second) {
      Throw(what + (name.empty() ? " has no name" : " is there twice") +
            kExtractAgain);
    }
    if (camera_ids.count(row.Int(2)) == 0) {
      Throw(what + " has the camera " + std::to_string(row.Int(2)) +
            ", which does not exist" + kExtractAgain);
    }
    if (!IsSelected(name)) {
      left_out_ids_.push_back(row.Int(0));
      continue;
    }
    image_positions_[row.Int(0)] = contents_.images.size();
    contents_.images.push_back({CheckedId<ImageId>(row.Int(0), what),
                                name,
                                CheckedId<CameraId>(row.Int(2), what),
                                {}});
  }
}

void DatabaseReader::ReadKeypoints() {
  SqliteStatement row = database_.Prepare(
      "SELECT image_id, rows, cols, data FROM keypoints ORDER BY image_id");
  while (Next(&row)) {
    // Rows left behind by an image that was deleted are harmless.
    const size_t* position = FindImage(row.Int(0));
    if (position == nullptr) continue;
    ImageRow& image = contents_.images[*position];
    const KeypointBlob blob = DecodeKeypoints(
        row, contents_.path, "the keypoints of image '" + image.name + "'");
    image.keypoints_px.resize(blob.rows);
    for (size_t i = 0; i < blob.rows; ++i) {
      // x and y come first in all layouts.
      std::memcpy(image.keypoints_px[i].data(),
                  blob.data + i * blob.cols * sizeof(float), 2 * sizeof(float));
    }
  }
}

void DatabaseReader::CheckKeypoints() const {
  const std::vector<ImageRow>& images = contents_.images;
  Mask is_finite(images.size());
  ParallelFor(images.size(), context_.num_threads, [&](size_t i) {
    is_finite[i] = std::all_of(
        images[i].keypoints_px.begin(), images[i].keypoints_px.end(),
        [](const Eigen::Vector2f& keypoint) { return keypoint.allFinite(); });
  });
  for (size_t i = 0; i < images.size(); ++i) {
    if (is_finite[i] == 0) {
      Throw("image '" + images[i].name + "' has a keypoint that is not finite" +
            kExtractAgain);
    }
  }
}

std::string DatabaseReader::PairName(int64_t image_id1,
                                     int64_t image_id2) const {
  const auto image_name = [this](int64_t id) {
    const size_t* position = FindImage(id);
    return std::to_string(id) +
           (position == nullptr
                ? std::string()
                : " '" + contents_.images[*position].name + "'");
  };
  return "the pair of images " + image_name(image_id1) + " and " +
         image_name(image_id2);
}

void DatabaseReader::ReadPairs() {
  SqliteStatement row = database_.Prepare(
      TwoViewGeometryQuery(database_, pair_table_) + " ORDER BY pair_id");
  while (Next(&row)) DecodePair(row);
}

void DatabaseReader::DecodePair(const SqliteStatement& row) {
  const int64_t pair_id = row.Int(0);
  const int64_t id1 = pair_id / kMaxNumIds;
  const int64_t id2 = pair_id % kMaxNumIds;
  if (IsLeftOut(id1) || IsLeftOut(id2)) return;
  const std::string name = PairName(id1, id2);
  if (pair_id < 0 || FindImage(id1) == nullptr || FindImage(id2) == nullptr) {
    Throw(name + " in " + pair_table_ + " names an image that does not exist" +
          kMatchAgain);
  }
  if (id1 >= id2) {
    Throw(name + " in " + pair_table_ + " has the invalid pair id " +
          std::to_string(pair_id) + kMatchAgain);
  }
  if (selection_.has_pair &&
      !selection_.has_pair(contents_.images[*FindImage(id1)].name,
                           contents_.images[*FindImage(id2)].name)) {
    return;
  }
  TwoViewGeometryRow pair{ImageId(static_cast<uint32_t>(id1)),
                          ImageId(static_cast<uint32_t>(id2)),
                          {},
                          {},
                          {},
                          {},
                          {},
                          {}};
  DecodeTwoViewGeometry(row, contents_.path, name, &pair);
  contents_.pairs.push_back(std::move(pair));
}

void DatabaseReader::CheckMatches() const {
  const auto num_keypoints = [this](ImageId id) {
    return contents_.images[*FindImage(id.value())].keypoints_px.size();
  };
  const std::vector<TwoViewGeometryRow>& pairs = contents_.pairs;
  Mask is_in_range(pairs.size());
  ParallelFor(pairs.size(), context_.num_threads, [&](size_t i) {
    const size_t size1 = num_keypoints(pairs[i].image_id1);
    const size_t size2 = num_keypoints(pairs[i].image_id2);
    is_in_range[i] = std::all_of(
        pairs[i].matches.begin(), pairs[i].matches.end(),
        [&](const Match& match) {
          return match.keypoint_idx1 < size1 && match.keypoint_idx2 < size2;
        });
  });
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (is_in_range[i] == 0) {
      Throw(PairName(pairs[i].image_id1.value(), pairs[i].image_id2.value()) +
            " has a match with a keypoint that does not exist" + kMatchAgain);
    }
  }
}

void DatabaseReader::ReadRigsAndFrames() {
  if (!database_.HasTable("rigs")) return;
  ReadRigs();
  ReadFrames();
}

void DatabaseReader::ReadRigs() {
  SqliteStatement row = database_.Prepare(
      "SELECT rig_id, ref_sensor_id, ref_sensor_type FROM rigs "
      "ORDER BY rig_id");
  while (Next(&row)) {
    const std::string what = "rig " + std::to_string(row.Int(0));
    RigRow rig{CheckedId<RigId>(row.Int(0), what), {}, {}};
    if (row.Int(2) == kCameraSensorType) {
      rig.ref_camera_id =
          CheckedId<CameraId>(row.Int(1), "the reference of " + what);
      rig.sensors.push_back({*rig.ref_camera_id, Rigid3()});
    }
    contents_.rigs.push_back(std::move(rig));
  }
  ReadRigSensors();
}

void DatabaseReader::ReadRigSensors() {
  SqliteStatement row = database_.Prepare(
      "SELECT rig_id, sensor_id, sensor_from_rig FROM rig_sensors "
      "WHERE sensor_type = ?1 ORDER BY rig_id, sensor_id");
  row.BindInt(1, kCameraSensorType);
  auto rig = contents_.rigs.begin();
  while (Next(&row)) {
    const std::string what = "camera " + std::to_string(row.Int(1)) +
                             " of rig " + std::to_string(row.Int(0));
    while (rig != contents_.rigs.end() && rig->id.value() < row.Int(0)) ++rig;
    if (rig == contents_.rigs.end() || rig->id.value() != row.Int(0)) {
      Throw(what + " is in a rig that does not exist" + kConfigureAgain);
    }
    RigSensorRow sensor{CheckedId<CameraId>(row.Int(1), what), std::nullopt};
    const BlobView blob = row.Blob(2);
    if (blob.size != 0) {
      double numbers[7];
      if (blob.size != sizeof(numbers)) {
        Throw("sensor_from_rig of " + what +
              " is damaged: " + std::to_string(blob.size) +
              " bytes instead of 56" + kConfigureAgain);
      }
      std::memcpy(numbers, blob.data, sizeof(numbers));
      sensor.sensor_from_rig = PoseFromNumbers(numbers, numbers + 4);
    }
    const auto& pose = sensor.sensor_from_rig;
    if (const auto problem = pose ? WhyImplausible(*pose) : std::nullopt) {
      Throw("sensor_from_rig of " + what + ' ' + *problem + kConfigureAgain);
    }
    rig->sensors.push_back(std::move(sensor));
  }
}

void DatabaseReader::ReadFrames() {
  std::unordered_map<int64_t, size_t> positions;
  SqliteStatement row = database_.Prepare(
      "SELECT frame_id, rig_id FROM frames ORDER BY frame_id");
  while (Next(&row)) {
    const std::string what = "frame " + std::to_string(row.Int(0));
    positions[row.Int(0)] = contents_.frames.size();
    contents_.frames.push_back({CheckedId<FrameId>(row.Int(0), what),
                                CheckedId<RigId>(row.Int(1), what),
                                {}});
  }
  SqliteStatement data = database_.Prepare(
      "SELECT frame_id, sensor_id, data_id FROM frame_data "
      "WHERE sensor_type = ?1 ORDER BY frame_id, data_id");
  data.BindInt(1, kCameraSensorType);
  while (Next(&data)) {
    const std::string what = "frame " + std::to_string(data.Int(0));
    const auto position = positions.find(data.Int(0));
    if (position == positions.end()) {
      Throw(what + " in frame_data does not exist" + kConfigureAgain);
    }
    if (IsLeftOut(data.Int(2))) continue;
    if (FindImage(data.Int(2)) == nullptr) {
      Throw(what + " has the image " + std::to_string(data.Int(2)) +
            ", which does not exist" + kConfigureAgain);
    }
    contents_.frames[position->second].data.push_back(
        {CheckedId<CameraId>(data.Int(1), what),
         CheckedId<ImageId>(data.Int(2), what)});
  }
  if (left_out_ids_.empty()) return;
  auto& frames = contents_.frames;
  frames.erase(
      std::remove_if(frames.begin(), frames.end(),
                     [](const FrameRow& frame) { return frame.data.empty(); }),
      frames.end());
}

}  // namespace

void SwapImages(TwoViewGeometryRow* pair) {
  std::swap(pair->image_id1, pair->image_id2);
  if (pair->F) pair->F->transposeInPlace();
  if (pair->E) pair->E->transposeInPlace();
  if (pair->H) pair->H = pair->H->inverse().eval();
  if (pair->cam2_from_cam1) {
    pair->cam2_from_cam1 = pair->cam2_from_cam1->Inverse();
  }
  for (Match& match : pair->matches) {
    std::swap(match.keypoint_idx1, match.keypoint_idx2);
  }
}

DatabaseContents ReadStructure(const SqliteDatabase& database,
                               const Context& context) {
  return DatabaseReader(database, {}, context).ReadStructure();
}

std::vector<std::string> ReadImageNames(const std::string& path) {
  const SqliteSnapshot snapshot(path);
  std::vector<std::string> names;
  if (!snapshot.database().HasTable("images")) {
    ThrowDatabaseError(path, "has no table 'images'; check the path");
  }
  SqliteStatement row =
      snapshot.database().Prepare("SELECT name FROM images ORDER BY image_id");
  while (row.Step()) names.push_back(row.Text(0));
  snapshot.CheckUnchanged();
  return names;
}

DatabaseContents ReadDatabase(const std::string& path, const Context& context,
                              const DatabaseSelection& selection) {
  const SqliteSnapshot snapshot(path);
  DatabaseContents contents =
      DatabaseReader(snapshot.database(), selection, context).Read();
  snapshot.CheckUnchanged();
  contents.path = path;
  return contents;
}

}  // namespace mgsfm
