// SPDX-License-Identifier: BSD-3-Clause
#include "io/database/database_merging.h"

#include <filesystem>
#include <map>
#include <system_error>
#include <vector>

#include "io/database/database_pair_id.h"
#include "io/database/database_reader.h"
#include "io/database/database_rows.h"
#include "io/database/feature_keypoints.h"
#include "io/database/sqlite_snapshot.h"
#include "io/files/file_operations.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/database/feature_database.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Copies the rows of one database after another.
class DatabaseCopier {
 public:
  DatabaseCopier(FeatureDatabase* output, const Context& context)
      : output_(*output), context_(context) {}

  void Copy(const std::string& path) {
    const SqliteSnapshot snapshot(path);
    database_ = &snapshot.database();
    camera_ids_.clear();
    image_ids_.clear();
    CopyStructure(ReadStructure(*database_, context_));
    CopyFeatures();
    CopyMatches();
    CopyTwoViewGeometries();
    CopyPriors();
    snapshot.CheckUnchanged();
  }

  DatabaseMergeSummary Finish() {
    output_.WriteRigsAndFrames(rigs_, frames_);
    summary_.num_images = path_of_name_.size();
    summary_.num_rigs = rigs_.size();
    return summary_;
  }

 private:
  void CopyStructure(const DatabaseContents& contents);
  void CopyRigs(const DatabaseContents& contents);
  void CopyFeatures();
  void CopyMatches();
  void CopyTwoViewGeometries();
  void CopyPriors();
  // The new id; nullptr for rows left behind by an image that was deleted.
  const ImageId* FindImage(int64_t id) const {
    const auto found = image_ids_.find(id);
    return found == image_ids_.end() ? nullptr : &found->second;
  }
  CameraId NewCamera(CameraId id, const std::string& of) const;
  std::string NameOf(int64_t id) const { return "image " + std::to_string(id); }

  FeatureDatabase& output_;
  const Context& context_;
  const SqliteDatabase* database_ = nullptr;
  std::map<CameraId, CameraId> camera_ids_;
  std::map<int64_t, ImageId> image_ids_;
  std::map<std::string, std::string> path_of_name_;
  std::vector<RigRow> rigs_;
  std::vector<FrameRow> frames_;
  DatabaseMergeSummary summary_;
};

void DatabaseCopier::CopyStructure(const DatabaseContents& contents) {
  for (const Camera& camera : contents.cameras) {
    camera_ids_.emplace(camera.id, output_.AddCamera(camera));
  }
  for (const ImageRow& image : contents.images) {
    const auto [other, is_new] =
        path_of_name_.emplace(image.name, database_->path());
    if (!is_new) {
      ThrowDatabaseError(database_->path(),
                         "has an image '" + image.name + "', as '" +
                             other->second +
                             "' has; put the images of one of them into "
                             "another folder");
    }
    image_ids_.emplace(
        image.id.value(),
        output_.AddImage(image.name, camera_ids_.at(image.camera_id)));
  }
  CopyRigs(contents);
}

CameraId DatabaseCopier::NewCamera(CameraId id, const std::string& of) const {
  const auto found = camera_ids_.find(id);
  if (found != camera_ids_.end()) return found->second;
  ThrowDatabaseError(database_->path(),
                     of + " has the camera " + std::to_string(id.value()) +
                         ", which does not exist" + kConfigureAgain);
}

void DatabaseCopier::CopyRigs(const DatabaseContents& contents) {
  const auto num_rigs = static_cast<uint32_t>(rigs_.size());
  std::map<RigId, RigId> rig_ids;
  for (RigRow rig : contents.rigs) {
    const std::string name = "rig " + std::to_string(rig.id.value());
    const RigId new_id(num_rigs + static_cast<uint32_t>(rig_ids.size()) + 1);
    rig_ids.emplace(rig.id, new_id);
    rig.id = new_id;
    if (!rig.ref_camera_id) {
      ThrowDatabaseError(
          database_->path(),
          name + " has a reference that is no camera" + kConfigureAgain);
    }
    rig.ref_camera_id = NewCamera(*rig.ref_camera_id, name);
    for (RigSensorRow& sensor : rig.sensors) {
      sensor.camera_id = NewCamera(sensor.camera_id, name);
    }
    rigs_.push_back(std::move(rig));
  }
  for (FrameRow frame : contents.frames) {
    const std::string name = "frame " + std::to_string(frame.id.value());
    const auto rig_id = rig_ids.find(frame.rig_id);
    if (rig_id == rig_ids.end()) {
      ThrowDatabaseError(database_->path(),
                         name + " has the rig " +
                             std::to_string(frame.rig_id.value()) +
                             ", which does not exist" + kConfigureAgain);
    }
    frame.id = FrameId(static_cast<uint32_t>(frames_.size()) + 1);
    frame.rig_id = rig_id->second;
    for (FrameDataRow& data : frame.data) {
      data.camera_id = NewCamera(data.camera_id, name);
      data.image_id = image_ids_.at(data.image_id.value());
    }
    frames_.push_back(std::move(frame));
  }
}

void DatabaseCopier::CopyFeatures() {
  SqliteStatement keypoints = database_->Prepare(
      "SELECT image_id, rows, cols, data FROM keypoints ORDER BY image_id");
  while (keypoints.Step()) {
    context_.CheckInterrupted();
    const ImageId* id = FindImage(keypoints.Int(0));
    if (id == nullptr) continue;
    output_.WriteKeypoints(
        *id, MakeFeatureKeypoints(DecodeKeypoints(
                 keypoints, database_->path(),
                 "the keypoints of " + NameOf(keypoints.Int(0)))));
  }
  if (!database_->HasTable("descriptors")) return;
  SqliteStatement descriptors = database_->Prepare(
      "SELECT image_id, rows, cols, data FROM descriptors ORDER BY image_id");
  while (descriptors.Step()) {
    context_.CheckInterrupted();
    const ImageId* id = FindImage(descriptors.Int(0));
    if (id == nullptr) continue;
    output_.WriteDescriptors(*id,
                             DecodeDescriptors(descriptors, database_->path(),
                                               NameOf(descriptors.Int(0))));
  }
}

void DatabaseCopier::CopyMatches() {
  if (!database_->HasTable("matches")) return;
  SqliteStatement row = database_->Prepare(
      "SELECT pair_id, rows, cols, data FROM matches ORDER BY pair_id");
  while (row.Step()) {
    context_.CheckInterrupted();
    const int64_t id1 = row.Int(0) / kMaxNumIds, id2 = row.Int(0) % kMaxNumIds;
    const ImageId* new_id1 = FindImage(id1);
    const ImageId* new_id2 = FindImage(id2);
    if (new_id1 == nullptr || new_id2 == nullptr) continue;
    output_.WriteMatches(*new_id1, *new_id2,
                         DecodeMatches(row, database_->path(),
                                       NameOf(id1) + " and " + NameOf(id2)));
  }
}

void DatabaseCopier::CopyTwoViewGeometries() {
  const std::string table = database_->HasTable("two_view_geometries")
                                ? "two_view_geometries"
                                : "inlier_matches";
  SqliteStatement row = database_->Prepare(
      TwoViewGeometryQuery(*database_, table) + " ORDER BY pair_id");
  while (row.Step()) {
    context_.CheckInterrupted();
    const int64_t id1 = row.Int(0) / kMaxNumIds, id2 = row.Int(0) % kMaxNumIds;
    const ImageId* new_id1 = FindImage(id1);
    const ImageId* new_id2 = FindImage(id2);
    if (new_id1 == nullptr || new_id2 == nullptr) continue;
    TwoViewGeometryRow pair{
        *new_id1, *new_id2, TwoViewConfig::kUndefined, {}, {}, {}, {}, {}};
    DecodeTwoViewGeometry(row, database_->path(),
                          NameOf(id1) + " and " + NameOf(id2), &pair);
    output_.WriteTwoViewGeometry(pair);
    ++summary_.num_pairs;
  }
}

void DatabaseCopier::CopyPriors() {
  if (!database_->HasTable("pose_priors")) return;
  SqliteStatement row = database_->Prepare(PosePriorQuery(*database_));
  while (row.Step()) {
    PosePriorRow prior = DecodePosePrior(row);
    const ImageId* id = FindImage(prior.image_id.value());
    if (id == nullptr || !prior.position.allFinite()) continue;
    prior.image_id = *id;
    output_.WritePosePrior(prior);
  }
  const std::string query = PriorGravityQuery(*database_);
  if (query.empty()) return;
  SqliteStatement gravity = database_->Prepare(query);
  while (gravity.Step()) {
    const auto direction = DecodeVector3(gravity.Blob(1));
    if (!direction || !direction->allFinite()) continue;
    context_.Warning("the directions of gravity in '" + database_->path() +
                     "' are not copied; provide them as a file (gravity_path)");
    return;
  }
}

// Removes a file that was not finished.
class PartialFile {
 public:
  explicit PartialFile(const std::string& target) {
    const fs::path path(target);
    path_ =
        (path.parent_path() / ("." + path.filename().string() + ".mgsfm_merge"))
            .string();
    Remove();
  }
  ~PartialFile() { Remove(); }
  PartialFile(const PartialFile&) = delete;
  PartialFile& operator=(const PartialFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  void Remove() const {
    std::error_code ignored;
    for (const char* side : {"", "-journal"}) fs::remove(path_ + side, ignored);
  }
  std::string path_;
};

}  // namespace

DatabaseMergeSummary MergeDatabases(const std::string& path1,
                                    const std::string& path2,
                                    const std::string& merged_path,
                                    const Context& context) {
  if (fs::exists(merged_path)) {
    ThrowDatabaseError(merged_path, "exists already; choose another name");
  }
  const PartialFile partial(merged_path);
  DatabaseMergeSummary summary;
  {
    FeatureDatabase output(partial.path(),
                           FeatureDatabase::OpenMode::kOrCreate);
    DatabaseTransaction transaction(&output);
    DatabaseCopier copier(&output, context);
    copier.Copy(path1);
    copier.Copy(path2);
    summary = copier.Finish();
    transaction.Commit();
  }
  // SQLite has synced the file; its name must last, too.
  FileOperations operations;
  operations.Rename(partial.path(), merged_path);
  operations.Sync(fs::absolute(merged_path).parent_path());
  return summary;
}

}  // namespace mgsfm
