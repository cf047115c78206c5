// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/imaging/views.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

enum class ViewNaming {
  kFolders,  // cam0/a.jpg becomes cam0_left/a.jpg
  // cam0/a.jpg becomes cam0_left_a.jpg. Names stay unique even if a program
  // cuts off everything after the first dot.
  kFlat,
};

struct UndistortedModel {
  Scene scene;
  Reconstruction reconstruction;
  // Per image of `scene`: its original image.
  struct Source {
    int image_idx;  // of the original scene
    int view_idx;   // of the views of its camera
  };
  std::vector<Source> sources;
};

// The model of the views of all registered images: each sensor of a rig becomes
// one sensor per view of its camera, at a known pose relative to the original.
// Frames and their poses stay. A keypoint moves to the view that shows it, or
// is dropped with its observation; points need at least two observations.
//
// `views_of_camera` belongs to scene.cameras, with the intrinsics of the
// reconstruction. Throws Error, naming the images, if two images of the result
// would have one name, or if a name would lead out of its folder.
UndistortedModel UndistortModel(
    const Scene& scene, const Reconstruction& reconstruction,
    const std::vector<std::vector<View>>& views_of_camera, ViewNaming naming,
    const Context& context);

// The name of a view of an image, with folders.
std::string NameOfView(const std::string& image_name,
                       const std::string& view_name);

}  // namespace mgsfm
