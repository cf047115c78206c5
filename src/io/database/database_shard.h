// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>

#include "database/sqlite_database.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/ids.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/database/shard.h"

namespace mgsfm {

// The tables of a shard. `mgsfm_shard_cameras` lists the cameras whose
// intrinsics come from images of other shards, with the name of the first image
// of each.

// nullopt if the database is not a shard. Throws Error if the row is damaged.
std::optional<ShardManifest> ReadShardManifest(const SqliteDatabase& database);
void WriteShardManifest(const ShardManifest& manifest,
                        SqliteDatabase* database);
std::map<CameraId, std::string> ReadShardCameras(
    const SqliteDatabase& database);
void WriteShardCamera(CameraId camera_id, const std::string& image_name,
                      SqliteDatabase* database);

// Makes a new database a shard, or checks that an existing database is this
// shard. Throws Error if it is another shard, or holds anything else. Returns
// whether it is complete.
bool BeginShard(const ShardManifest& manifest, FeatureDatabase* database);

// A hash of everything that matches refer to: ids and names of images, cameras,
// rigs, frames, and numbers of keypoints.
std::string FingerprintOfStructure(const FeatureDatabase& database,
                                   const Context& context);

}  // namespace mgsfm
