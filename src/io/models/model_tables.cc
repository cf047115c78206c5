// SPDX-License-Identifier: BSD-3-Clause
#include "io/models/model_tables.h"

#include <map>
#include <utility>

namespace mgsfm {

void AddModelTables(const PoseModel& poses, DatabaseContents* contents) {
  std::map<ImageId, CameraId> camera_of_image;
  for (const ModelImage& image : poses.images) {
    camera_of_image.emplace(image.id, image.camera_id);
  }
  for (const ModelFrame& frame : poses.frames) {
    FrameRow row{frame.id, frame.rig_id, {}};
    for (const ImageId id : frame.image_ids) {
      const auto image = camera_of_image.find(id);
      if (image == camera_of_image.end()) continue;
      row.data.push_back({image->second, id});
    }
    if (!row.data.empty()) contents->frames.push_back(std::move(row));
  }
  for (const ModelRig& rig : poses.rigs) {
    RigRow row{rig.id, {}, {}};
    for (const ModelSensor& sensor : rig.sensors) {
      if (sensor.is_reference) row.ref_camera_id = sensor.camera_id;
      row.sensors.push_back({sensor.camera_id, sensor.sensor_from_rig});
    }
    contents->rigs.push_back(std::move(row));
  }
}

}  // namespace mgsfm
