// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_shard.h"

#include <re2/re2.h>

#include <limits>

#include "base/fingerprint.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr const char* kKindNames[] = {"features", "matches"};

void AddPose(const std::optional<Rigid3>& pose, Fingerprint* fingerprint) {
  fingerprint->Add(pose.has_value());
  if (!pose) return;
  for (const double value : pose->rotation.coeffs()) fingerprint->Add(value);
  for (const double value : pose->translation) fingerprint->Add(value);
}

void AddCameras(const std::vector<Camera>& cameras, Fingerprint* fingerprint) {
  for (const Camera& camera : cameras) {
    fingerprint->Add(camera.id.value())
        .Add(static_cast<int>(camera.model))
        .Add(camera.width_px)
        .Add(camera.height_px)
        .Add(camera.has_prior_focal_length);
    for (const double param : camera.params) fingerprint->Add(param);
  }
}

void AddRigs(const DatabaseContents& contents, Fingerprint* fingerprint) {
  for (const RigRow& rig : contents.rigs) {
    fingerprint->Add(rig.id.value());
    for (const RigSensorRow& sensor : rig.sensors) {
      fingerprint->Add(sensor.camera_id.value());
      AddPose(sensor.sensor_from_rig, fingerprint);
    }
  }
  for (const FrameRow& frame : contents.frames) {
    fingerprint->Add(frame.id.value()).Add(frame.rig_id.value());
    for (const FrameDataRow& data : frame.data) {
      fingerprint->Add(data.camera_id.value()).Add(data.image_id.value());
    }
  }
}

}  // namespace

std::string Share::ToString() const {
  return std::to_string(number) + "/" + std::to_string(count);
}

Share ParseShare(const std::string& text) {
  Share share;
  if (!RE2::FullMatch(text, "(\\d+)/(\\d+)", &share.number, &share.count) ||
      share.number < 1 || share.number > share.count) {
    throw Error("--shard '" + text +
                "' is not i/n with 1 <= i <= n; the shares of 8 processes are "
                "1/8 to 8/8");
  }
  return share;
}

std::optional<ShardManifest> ReadShardManifest(const SqliteDatabase& database) {
  if (!database.HasTable("mgsfm_shard")) return std::nullopt;
  SqliteStatement row = database.Prepare(
      "SELECT kind, number, count, fingerprint, is_complete FROM mgsfm_shard");
  if (!row.Step()) return std::nullopt;
  ShardManifest manifest;
  const std::string kind = row.Text(0);
  manifest.kind =
      kind == kKindNames[0] ? ShardKind::kFeatures : ShardKind::kMatches;
  const int64_t number = row.Int(1), count = row.Int(2);
  manifest.share = {static_cast<int>(number), static_cast<int>(count)};
  manifest.fingerprint = row.Text(3);
  manifest.is_complete = row.Int(4) != 0;
  const bool is_sound = (kind == kKindNames[0] || kind == kKindNames[1]) &&
                        number >= 1 && number <= count &&
                        count <= std::numeric_limits<int>::max();
  if (!is_sound) {
    ThrowDatabaseError(database.path(),
                       "the table mgsfm_shard is damaged; delete the file and "
                       "run its share again");
  }
  return manifest;
}

void WriteShardManifest(const ShardManifest& manifest,
                        SqliteDatabase* database) {
  database->Execute(
      "CREATE TABLE IF NOT EXISTS mgsfm_shard (id INTEGER PRIMARY KEY, kind "
      "TEXT, number INTEGER, count INTEGER, fingerprint TEXT, is_complete "
      "INTEGER);"
      "CREATE TABLE IF NOT EXISTS mgsfm_shard_cameras (camera_id INTEGER "
      "PRIMARY KEY, image_name TEXT)");
  SqliteStatement row = database->Prepare(
      "INSERT OR REPLACE INTO mgsfm_shard VALUES (1, ?1, ?2, ?3, ?4, ?5)");
  row.Run(kKindNames[manifest.kind == ShardKind::kFeatures ? 0 : 1],
          manifest.share.number, manifest.share.count, manifest.fingerprint,
          manifest.is_complete);
}

std::map<CameraId, std::string> ReadShardCameras(
    const SqliteDatabase& database) {
  std::map<CameraId, std::string> names;
  if (!database.HasTable("mgsfm_shard_cameras")) return names;
  SqliteStatement row =
      database.Prepare("SELECT camera_id, image_name FROM mgsfm_shard_cameras");
  while (row.Step()) {
    names.emplace(CameraId(static_cast<uint32_t>(row.Int(0))), row.Text(1));
  }
  return names;
}

void WriteShardCamera(CameraId camera_id, const std::string& image_name,
                      SqliteDatabase* database) {
  database
      ->Prepare("INSERT OR REPLACE INTO mgsfm_shard_cameras VALUES (?1, ?2)")
      .Run(camera_id, image_name);
}

bool BeginShard(const ShardManifest& manifest, FeatureDatabase* database) {
  const std::optional<ShardManifest> begun = database->ReadShard();
  if (!begun) {
    if (!database->ReadStructure(Context()).images.empty() ||
        !database->CountMatches().empty()) {
      ThrowDatabaseError(
          database->path(),
          "is not a shard, but holds images or matches; choose a "
          "new file for share " +
              manifest.share.ToString());
    }
    database->WriteShard(manifest);
    return false;
  }
  if (begun->kind != manifest.kind || !(begun->share == manifest.share)) {
    ThrowDatabaseError(
        database->path(),
        "holds share " + begun->share.ToString() + " of " +
            kKindNames[begun->kind == ShardKind::kFeatures ? 0 : 1] +
            ", not share " + manifest.share.ToString() + " of " +
            kKindNames[manifest.kind == ShardKind::kFeatures ? 0 : 1] +
            "; choose another file");
  }
  if (begun->fingerprint != manifest.fingerprint) {
    ThrowDatabaseError(database->path(),
                       "was begun with other images or options; delete it, or "
                       "run with those");
  }
  return begun->is_complete;
}

std::string FingerprintOfStructure(const FeatureDatabase& database,
                                   const Context& context) {
  const DatabaseContents contents = database.ReadStructure(context);
  Fingerprint fingerprint;
  AddCameras(contents.cameras, &fingerprint);
  for (const ImageRow& image : contents.images) {
    fingerprint.Add(image.id.value())
        .Add(image.name)
        .Add(image.camera_id.value());
  }
  AddRigs(contents, &fingerprint);
  for (const auto& [image_id, num_keypoints] : database.CountKeypoints()) {
    fingerprint.Add(image_id.value()).Add(num_keypoints);
  }
  return fingerprint.ToString();
}

}  // namespace mgsfm
