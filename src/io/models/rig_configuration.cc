// SPDX-License-Identifier: BSD-3-Clause
#include "models/rig_configuration.h"

#include <map>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"
#include "models/rows_to_scene.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

// Cameras that are new, or have other intrinsics than before, are written. Ids
// become those of the database.
void WriteCameras(const std::vector<Camera>& before, FeatureDatabase* database,
                  DatabaseContents* after) {
  std::map<CameraId, Camera> camera_before;
  for (const Camera& camera : before) camera_before.emplace(camera.id, camera);
  std::map<CameraId, CameraId> new_id;
  for (const Camera& camera : after->cameras) {
    const auto known = camera_before.find(camera.id);
    if (known == camera_before.end()) {
      new_id.emplace(camera.id, database->AddCamera(camera));
      continue;
    }
    new_id.emplace(camera.id, camera.id);
    if (!HaveEqualIntrinsics(known->second, camera)) {
      database->UpdateCamera(camera);
    }
  }
  for (RigRow& rig : after->rigs) {
    if (rig.ref_camera_id) rig.ref_camera_id = new_id.at(*rig.ref_camera_id);
    for (RigSensorRow& sensor : rig.sensors) {
      sensor.camera_id = new_id.at(sensor.camera_id);
    }
  }
  for (FrameRow& frame : after->frames) {
    for (FrameDataRow& data : frame.data) {
      data.camera_id = new_id.at(data.camera_id);
    }
  }
}

void SetCamerasOfImages(const std::vector<ImageRow>& before,
                        const std::vector<FrameRow>& frames,
                        FeatureDatabase* database) {
  std::map<ImageId, CameraId> camera_before;
  for (const ImageRow& image : before) {
    camera_before.emplace(image.id, image.camera_id);
  }
  for (const FrameRow& frame : frames) {
    for (const FrameDataRow& data : frame.data) {
      if (camera_before.at(data.image_id) != data.camera_id) {
        database->SetImageCamera(data.image_id, data.camera_id);
      }
    }
  }
}

}  // namespace

RigConfigurationSummary ConfigureRigs(const SceneLoadingOptions& options,
                                      FeatureDatabase* database,
                                      const Context& context) {
  DatabaseContents before = database->ReadStructure(context);
  before.rigs.clear();
  before.frames.clear();
  if (before.images.empty()) {
    throw Error("database '" + database->path() +
                "' has no images; run feature_extractor first");
  }
  const SceneOfRows found =
      BuildSceneOfRows("database", before, options, context);
  DatabaseContents after = MakeDatabaseContents(found.scene, ViewGraph());
  DatabaseTransaction transaction(database);
  WriteCameras(before.cameras, database, &after);
  SetCamerasOfImages(before.images, after.frames, database);
  database->WriteRigsAndFrames(after.rigs, after.frames);
  transaction.Commit();
  return {found.scene.rigs.size(), found.scene.sensors.size(),
          found.scene.frames.size(), found.scene.images.size(),
          found.rig_source};
}

}  // namespace mgsfm
