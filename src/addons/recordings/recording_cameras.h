// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "files/image_reading.h"
#include "geometry/frame_tree.h"
#include "mgsfm/base/context.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/rigs/rig_config.h"
#include "recordings/recording.h"

namespace mgsfm {

// A topic whose images become a folder.
struct RecordedCamera {
  int topic_idx = 0;
  int info_topic_idx = -1;  // of sensor_msgs/CameraInfo; -1: none
  std::string folder;
  bool is_rectified = false;  // image_rect, image_rect_color, ...
  // From the messages:
  std::string frame_id;
  ImageSize size_px;
  std::optional<CameraInfoMessage> info;
};

// The cameras of a list of topics separated by commas, in its order; of an
// empty list, those of all topics of images, by name, one topic per camera and
// without depth images; logs which topics are left out. A folder is named after
// the parts of its topic that differ from those of the others: cam0 for
// /cam0/image_raw. Throws Error if a topic is missing, has no images or cannot
// be read, and if there is none.
std::vector<RecordedCamera> ChooseCameras(const Recording& recording,
                                          const std::string& image_topics,
                                          const Context& context);

// From the frame of a camera to its images, which rectification turns; nullopt
// if the rotation is unknown.
std::optional<Rigid3> ImageFromFrame(const RecordedCamera& camera);

// The rig of the cameras, the first of which is the reference, whose poses and
// gravity other files have: intrinsics of CameraInfo and poses of the frames,
// where they are known. nullopt for one camera without intrinsics. Logs what is
// known, and warns of what is unusable.
std::optional<RigConfig> MakeRecordedRig(
    const std::vector<RecordedCamera>& cameras, const FrameTree& frames,
    const std::vector<RecordingTopic>& topics, const Context& context);

}  // namespace mgsfm
