// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_reader.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <unordered_map>

#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "database/database_rows.h"
#include "database/sqlite_database.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

template <class T, class Predicate>
void EraseUnless(const Predicate& is_kept, std::vector<T>* items) {
  EraseIf(items, [&](const T& item) { return !is_kept(item); });
}

// The database and the run that reads it.
struct Source {
  const SqliteDatabase& database;
  const Context& context;

  [[noreturn]] void Throw(const std::string& problem) const {
    ThrowDatabaseError(database.path(), problem);
  }
  bool Next(SqliteStatement* row) const {
    context.CheckInterrupted();
    return row->Step();
  }
};

// The images that are selected, and the ids of the others.
struct ImageTable {
  std::vector<ImageRow> rows;
  std::unordered_map<int64_t, size_t> positions;  // in `rows`, by id
  std::vector<int64_t> left_out_ids;              // ascending

  bool IsLeftOut(int64_t id) const {
    return std::binary_search(left_out_ids.begin(), left_out_ids.end(), id);
  }
  // nullptr if the image does not exist.
  const ImageRow* Find(int64_t id) const {
    const auto it = positions.find(id);
    return it == positions.end() ? nullptr : &rows[it->second];
  }
};

// The id in a column; `what` names the row.
template <class IdType>
IdType CheckedId(const Source& source, int64_t value, const std::string& what) {
  if (value < 0 || value >= kMaxNumIds) {
    source.Throw(what + " has the id " + std::to_string(value) +
                 ", which is out of range; create the database again");
  }
  return IdType(static_cast<uint32_t>(value));
}

// Returns the name of the table of verified pairs.
std::string CheckTables(const Source& source) {
  for (const char* table : {"cameras", "images", "keypoints"}) {
    if (!source.database.HasTable(table)) {
      source.Throw(
          std::string("has no table '") + table +
          "', so it is not a COLMAP database; give the one that COLMAP's "
          "feature extractor made");
    }
  }
  std::string pair_table = "two_view_geometries";
  if (!source.database.HasTable(pair_table)) pair_table = "inlier_matches";
  if (!source.database.HasTable(pair_table)) {
    source.Throw("has no table 'two_view_geometries'; match its images first");
  }
  if (!source.database.HasTable("rigs")) return pair_table;
  for (const char* table : {"rig_sensors", "frames", "frame_data"}) {
    if (!source.database.HasTable(table)) {
      source.Throw(std::string("has the table 'rigs' but no table '") + table +
                   "'" + kConfigureAgain);
    }
  }
  return pair_table;
}

Camera DecodeCamera(const Source& source, const SqliteStatement& row) {
  const std::string name = "camera " + std::to_string(row.Int(0));
  const CameraModelInfo* model = nullptr;
  const int64_t model_id = row.Int(1);
  if (model_id >= 0 && model_id <= std::numeric_limits<int32_t>::max()) {
    model = FindCameraModel(static_cast<int32_t>(model_id));
  }
  if (model == nullptr) {
    source.Throw(
        name + " has the unknown camera model " + std::to_string(model_id) +
        "; extract the features again with one of COLMAP's camera models");
  }
  const auto id = CheckedId<CameraId>(source, row.Int(0), "a camera");
  const int64_t width = row.Int(2);
  const int64_t height = row.Int(3);
  constexpr int64_t kMaxSize = std::numeric_limits<int>::max();
  if (width <= 0 || height <= 0 || width > kMaxSize || height > kMaxSize) {
    source.Throw(name + " has the image size " + SizeText(width, height) +
                 kExtractAgain);
  }
  Camera camera{
      id, model->id,      static_cast<int>(width), static_cast<int>(height),
      {}, row.Int(5) != 0};
  const BlobView params = row.Blob(4);
  const auto num_params = static_cast<size_t>(model->num_params);
  if (params.size != num_params * sizeof(double)) {
    source.Throw(name + " has " + std::to_string(params.size) +
                 " bytes of parameters, but " + std::string(model->name) +
                 " has " + std::to_string(num_params) + " parameters" +
                 kExtractAgain);
  }
  camera.params.resize(num_params);
  std::memcpy(camera.params.data(), params.data, params.size);
  if (const auto problem = WhyImplausible(camera)) {
    source.Throw(name + ' ' + *problem + kExtractAgain);
  }
  return camera;
}

std::vector<Camera> ReadCameras(const Source& source) {
  std::vector<Camera> cameras;
  SqliteStatement row = source.database.Prepare(
      "SELECT camera_id, model, width, height, params, prior_focal_length "
      "FROM cameras ORDER BY camera_id");
  while (source.Next(&row)) cameras.push_back(DecodeCamera(source, row));
  return cameras;
}

ImageTable ReadImages(const Source& source, const DatabaseSelection& selection,
                      const std::vector<Camera>& cameras) {
  std::set<int64_t> camera_ids;
  for (const Camera& camera : cameras) camera_ids.insert(camera.id.value());
  ImageTable images;
  std::set<std::string> names;
  SqliteStatement row = source.database.Prepare(
      "SELECT image_id, name, camera_id FROM images ORDER BY image_id");
  while (source.Next(&row)) {
    const std::string name = row.Text(1);
    const std::string what =
        "image " + std::to_string(row.Int(0)) + " '" + Printable(name) + "'";
    if (const auto problem = WhyUnusable(name)) {
      source.Throw("the name of " + what + ' ' + *problem +
                   "; rename the file and extract the features again");
    }
    if (name.empty() || !names.insert(name).second) {
      source.Throw(what + (name.empty() ? " has no name" : " is there twice") +
                   kExtractAgain);
    }
    if (camera_ids.count(row.Int(2)) == 0) {
      source.Throw(what + " has the camera " + std::to_string(row.Int(2)) +
                   ", which does not exist" + kExtractAgain);
    }
    if (!selection.image_names.empty() &&
        selection.image_names.count(name) == 0) {
      images.left_out_ids.push_back(row.Int(0));
      continue;
    }
    images.positions[row.Int(0)] = images.rows.size();
    images.rows.push_back({CheckedId<ImageId>(source, row.Int(0), what),
                           name,
                           CheckedId<CameraId>(source, row.Int(2), what),
                           {}});
  }
  return images;
}

void ReadKeypoints(const Source& source, ImageTable* images) {
  SqliteStatement row = source.database.Prepare(
      "SELECT image_id, rows, cols, data FROM keypoints ORDER BY image_id");
  while (source.Next(&row)) {
    // Rows of a deleted image are harmless.
    const auto position = images->positions.find(row.Int(0));
    if (position == images->positions.end()) continue;
    ImageRow& image = images->rows[position->second];
    const KeypointBlob blob =
        DecodeKeypoints(row, "the keypoints of image '" + image.name + "'");
    image.keypoints_px.resize(blob.rows);
    for (size_t i = 0; i < blob.rows; ++i) {
      // x and y come first in all layouts.
      std::memcpy(image.keypoints_px[i].data(),
                  blob.data + i * blob.cols * sizeof(float), 2 * sizeof(float));
    }
  }
}

void CheckKeypoints(const Source& source, const std::vector<ImageRow>& images) {
  Mask is_finite(images.size());
  ParallelFor(images.size(), source.context.num_threads, [&](size_t i) {
    is_finite[i] = AllOf(
        images[i].keypoints_px,
        [](const Eigen::Vector2f& keypoint) { return keypoint.allFinite(); });
  });
  for (size_t i = 0; i < images.size(); ++i) {
    if (is_finite[i] == 0) {
      source.Throw("image '" + images[i].name +
                   "' has a keypoint that is not finite" + kExtractAgain);
    }
  }
}

// For messages: "the pair of images 3 'a.jpg' and 7 'b.jpg'".
std::string PairName(const ImageTable& images, int64_t id1, int64_t id2) {
  const auto name_of = [&](int64_t id) {
    const ImageRow* image = images.Find(id);
    return std::to_string(id) +
           (image == nullptr ? std::string() : " '" + image->name + "'");
  };
  return "the pair of images " + name_of(id1) + " and " + name_of(id2);
}

// nullopt for unselected pairs.
std::optional<TwoViewGeometryRow> DecodePair(const Source& source,
                                             const DatabaseSelection& selection,
                                             const ImageTable& images,
                                             const std::string& pair_table,
                                             const SqliteStatement& row) {
  const int64_t pair_id = row.Int(0);
  const int64_t id1 = pair_id / kMaxNumIds;
  const int64_t id2 = pair_id % kMaxNumIds;
  if (images.IsLeftOut(id1) || images.IsLeftOut(id2)) return std::nullopt;
  const std::string name = PairName(images, id1, id2);
  const ImageRow* image1 = images.Find(id1);
  const ImageRow* image2 = images.Find(id2);
  if (pair_id < 0 || image1 == nullptr || image2 == nullptr) {
    source.Throw(name + " in " + pair_table +
                 " names an image that does not exist" + kMatchAgain);
  }
  if (id1 >= id2) {
    source.Throw(name + " in " + pair_table + " has the invalid pair id " +
                 std::to_string(pair_id) + kMatchAgain);
  }
  if (selection.has_pair && !selection.has_pair(image1->name, image2->name)) {
    return std::nullopt;
  }
  TwoViewGeometryRow pair{image1->id, image2->id};
  DecodeTwoViewGeometry(row, name, &pair);
  return pair;
}

void ReadPairs(const Source& source, const DatabaseSelection& selection,
               const ImageTable& images, const std::string& pair_table,
               DatabaseContents* contents) {
  SqliteStatement row = source.database.Prepare(
      TwoViewGeometryQuery(source.database, pair_table) + " ORDER BY pair_id");
  while (source.Next(&row)) {
    auto pair = DecodePair(source, selection, images, pair_table, row);
    if (!pair) continue;
    if (selection.has_geometries) {
      contents->pairs.push_back(std::move(*pair));
    } else {
      contents->matches.push_back(
          {pair->image_id1, pair->image_id2, std::move(pair->matches)});
    }
  }
}

// Adds the other matches before verification to verified pairs, which are
// ordered by id.
void ReadOutliers(const Source& source, const ImageTable& images,
                  std::vector<TwoViewGeometryRow>* pairs) {
  if (!source.database.HasTable("matches")) return;
  SqliteStatement row = source.database.Prepare(
      "SELECT pair_id, rows, cols, data FROM matches ORDER BY pair_id");
  auto pair = pairs->begin();
  while (source.Next(&row)) {
    const int64_t id1 = row.Int(0) / kMaxNumIds, id2 = row.Int(0) % kMaxNumIds;
    const auto ids = [&] {
      return std::pair<int64_t, int64_t>(pair->image_id1.value(),
                                         pair->image_id2.value());
    };
    while (pair != pairs->end() && ids() < std::pair(id1, id2)) ++pair;
    if (pair == pairs->end()) break;
    if (ids() != std::pair(id1, id2) || pair->matches.empty()) continue;
    pair->outliers = OutliersOf(DecodeMatches(row, PairName(images, id1, id2)),
                                pair->matches);
  }
}

template <class PairRow>
void CheckMatches(const Source& source, const ImageTable& images,
                  const std::vector<PairRow>& pairs,
                  std::vector<Match> PairRow::*matches) {
  const auto num_keypoints = [&](ImageId id) {
    return images.Find(id.value())->keypoints_px.size();
  };
  Mask is_in_range(pairs.size());
  ParallelFor(pairs.size(), source.context.num_threads, [&](size_t i) {
    const size_t size1 = num_keypoints(pairs[i].image_id1);
    const size_t size2 = num_keypoints(pairs[i].image_id2);
    is_in_range[i] = AllOf(pairs[i].*matches, [&](const Match& match) {
      return match.keypoint_idx1 < size1 && match.keypoint_idx2 < size2;
    });
  });
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (is_in_range[i] == 0) {
      source.Throw(PairName(images, pairs[i].image_id1.value(),
                            pairs[i].image_id2.value()) +
                   " has a match with a keypoint that does not exist" +
                   kMatchAgain);
    }
  }
}

// Adds the sensors of rigs to `rigs`, which are ordered by id.
void ReadRigSensors(const Source& source, std::vector<RigRow>* rigs) {
  SqliteStatement row = source.database.Prepare(
      "SELECT rig_id, sensor_id, sensor_from_rig FROM rig_sensors "
      "WHERE sensor_type = ?1 ORDER BY rig_id, sensor_id",
      kCameraSensorType);
  auto rig = rigs->begin();
  while (source.Next(&row)) {
    const std::string what = "camera " + std::to_string(row.Int(1)) +
                             " of rig " + std::to_string(row.Int(0));
    while (rig != rigs->end() && rig->id.value() < row.Int(0)) ++rig;
    if (rig == rigs->end() || rig->id.value() != row.Int(0)) {
      source.Throw(what + " is in a rig that does not exist" + kConfigureAgain);
    }
    RigSensorRow sensor{CheckedId<CameraId>(source, row.Int(1), what),
                        std::nullopt};
    const BlobView blob = row.Blob(2);
    if (blob.size != 0) {
      double numbers[7];
      if (blob.size != sizeof(numbers)) {
        source.Throw("sensor_from_rig of " + what +
                     " is damaged: " + std::to_string(blob.size) +
                     " bytes instead of 56" + kConfigureAgain);
      }
      std::memcpy(numbers, blob.data, sizeof(numbers));
      sensor.sensor_from_rig = PoseFromNumbers(numbers, numbers + 4);
    }
    const auto& pose = sensor.sensor_from_rig;
    if (const auto problem = pose ? WhyImplausible(*pose) : std::nullopt) {
      source.Throw("sensor_from_rig of " + what + ' ' + *problem +
                   kConfigureAgain);
    }
    rig->sensors.push_back(std::move(sensor));
  }
}

std::vector<RigRow> ReadRigs(const Source& source) {
  std::vector<RigRow> rigs;
  if (!source.database.HasTable("rigs")) return rigs;
  SqliteStatement row = source.database.Prepare(
      "SELECT rig_id, ref_sensor_id, ref_sensor_type FROM rigs "
      "ORDER BY rig_id");
  while (source.Next(&row)) {
    const std::string what = "rig " + std::to_string(row.Int(0));
    RigRow rig{CheckedId<RigId>(source, row.Int(0), what), {}, {}};
    if (row.Int(2) == kCameraSensorType) {
      rig.ref_camera_id =
          CheckedId<CameraId>(source, row.Int(1), "the reference of " + what);
      rig.sensors.push_back({*rig.ref_camera_id, Rigid3()});
    }
    rigs.push_back(std::move(rig));
  }
  ReadRigSensors(source, &rigs);
  return rigs;
}

std::vector<FrameRow> ReadFrames(const Source& source,
                                 const ImageTable& images) {
  std::vector<FrameRow> frames;
  if (!source.database.HasTable("rigs")) return frames;
  std::unordered_map<int64_t, size_t> positions;
  SqliteStatement row = source.database.Prepare(
      "SELECT frame_id, rig_id FROM frames ORDER BY frame_id");
  while (source.Next(&row)) {
    const std::string what = "frame " + std::to_string(row.Int(0));
    positions[row.Int(0)] = frames.size();
    frames.push_back({CheckedId<FrameId>(source, row.Int(0), what),
                      CheckedId<RigId>(source, row.Int(1), what),
                      {}});
  }
  SqliteStatement data = source.database.Prepare(
      "SELECT frame_id, sensor_id, data_id FROM frame_data "
      "WHERE sensor_type = ?1 ORDER BY frame_id, data_id",
      kCameraSensorType);
  while (source.Next(&data)) {
    const std::string what = "frame " + std::to_string(data.Int(0));
    const auto position = positions.find(data.Int(0));
    if (position == positions.end()) {
      source.Throw(what + " in frame_data does not exist" + kConfigureAgain);
    }
    if (images.IsLeftOut(data.Int(2))) continue;
    if (images.Find(data.Int(2)) == nullptr) {
      source.Throw(what + " has the image " + std::to_string(data.Int(2)) +
                   ", which does not exist" + kConfigureAgain);
    }
    frames[position->second].data.push_back(
        {CheckedId<CameraId>(source, data.Int(1), what),
         CheckedId<ImageId>(source, data.Int(2), what)});
  }
  if (images.left_out_ids.empty()) return frames;
  EraseUnless([](const FrameRow& frame) { return !frame.data.empty(); },
              &frames);
  return frames;
}

DatabaseContents ReadContents(const SqliteDatabase& database,
                              const DatabaseSelection& selection,
                              const Context& context) {
  const Source source{database, context};
  const std::string pair_table = CheckTables(source);
  DatabaseContents contents;
  contents.path = database.path();
  contents.cameras = ReadCameras(source);
  ImageTable images = ReadImages(source, selection, contents.cameras);
  contents.is_selection = !images.left_out_ids.empty();
  if (images.rows.empty() && !contents.is_selection) {
    source.Throw("has no images; run the feature extractor first");
  }
  if (selection.has_keypoints) {
    ReadKeypoints(source, &images);
    CheckKeypoints(source, images.rows);
  }
  ReadPairs(source, selection, images, pair_table, &contents);
  if (selection.has_keypoints) {
    ReadOutliers(source, images, &contents.pairs);
    CheckMatches(source, images, contents.pairs, &TwoViewGeometryRow::matches);
    CheckMatches(source, images, contents.pairs, &TwoViewGeometryRow::outliers);
    CheckMatches(source, images, contents.matches, &MatchesRow::matches);
  }
  contents.rigs = ReadRigs(source);
  contents.frames = ReadFrames(source, images);
  contents.images = std::move(images.rows);
  return contents;
}

}  // namespace

std::vector<std::string> ReadImageList(const std::string& path) {
  TextLines lines(path, "'" + path + "' (image_list_path)");
  std::vector<std::string> names;
  while (lines.NextContent()) {
    names.emplace_back(lines.line());
    if (const auto problem = WhyUnusable(names.back())) {
      lines.Throw("the name " + *problem);
    }
  }
  return names;
}

void KeepListedImages(const std::set<std::string>& names,
                      const std::string& list_path,
                      DatabaseContents* contents) {
  const std::string list = "'" + list_path + "' (image_list_path)";
  if (names.empty()) throw Error(list + " lists no image");
  EraseUnless(
      [&](const ImageRow& image) { return names.count(image.name) > 0; },
      &contents->images);
  std::set<std::string> missing = names;
  std::set<ImageId> ids;
  for (const ImageRow& image : contents->images) {
    missing.erase(image.name);
    ids.insert(image.id);
  }
  if (!missing.empty()) {
    throw Error(list + " names '" + *missing.begin() +
                "', which the database '" + contents->path +
                "' does not have; correct the list, or extract and match the "
                "features of the image");
  }
  const auto has = [&](ImageId id) { return ids.count(id) > 0; };
  const auto has_pair = [&](const auto& pair) {
    return has(pair.image_id1) && has(pair.image_id2);
  };
  EraseUnless(has_pair, &contents->pairs);
  EraseUnless(has_pair, &contents->matches);
  for (FrameRow& frame : contents->frames) {
    EraseUnless([&](const FrameDataRow& data) { return has(data.image_id); },
                &frame.data);
  }
  EraseUnless([](const FrameRow& frame) { return !frame.data.empty(); },
              &contents->frames);
  contents->is_selection = true;
}

void SwapImages(std::vector<Match>* matches) {
  for (Match& match : *matches) {
    std::swap(match.keypoint_idx1, match.keypoint_idx2);
  }
}

void SwapImages(TwoViewGeometryRow* pair) {
  std::swap(pair->image_id1, pair->image_id2);
  if (pair->F) pair->F->transposeInPlace();
  if (pair->E) pair->E->transposeInPlace();
  if (pair->H) pair->H = pair->H->inverse().eval();
  if (pair->cam2_from_cam1) {
    pair->cam2_from_cam1 = pair->cam2_from_cam1->Inverse();
  }
  SwapImages(&pair->matches);
  SwapImages(&pair->outliers);
}

DatabaseContents ReadStructure(const SqliteDatabase& database,
                               const Context& context) {
  const Source source{database, context};
  CheckTables(source);
  DatabaseContents contents;
  contents.path = database.path();
  contents.cameras = ReadCameras(source);
  ImageTable images = ReadImages(source, {}, contents.cameras);
  contents.rigs = ReadRigs(source);
  contents.frames = ReadFrames(source, images);
  contents.images = std::move(images.rows);
  return contents;
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

bool DatabaseContents::HasRigs() const {
  return AnyOf(rigs,
               [](const RigRow& rig) { return rig.sensors.size() > 1; }) ||
         AnyOf(frames,
               [](const FrameRow& frame) { return frame.data.size() > 1; });
}

DatabaseContents ReadDatabase(const std::string& path, const Context& context,
                              const DatabaseSelection& selection) {
  const SqliteSnapshot snapshot(path);
  DatabaseContents contents =
      ReadContents(snapshot.database(), selection, context);
  snapshot.CheckUnchanged();
  contents.path = path;
  return contents;
}

}  // namespace mgsfm
