// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Measured positions and gravity of the images of a finished model.
struct ReferencePositions {
  PositionPriors positions;
  GravityPriors gravity;  // empty if it is not wanted
};

struct ReferenceSource {
  std::string ref_images_path;  // or
  std::string database_path;
  PositionKind ref_is_gps = PositionKind::kAuto;
  double position_std_m = 1.0;
  bool uses_positions = true;
  bool uses_gravity = false;
};

// Finds the positions of the images of a model by their names. The origin of
// GPS positions in a database is that of the mapper, the first of all images by
// name, so that all models of a database have the same world. Throws Error,
// naming the file and the image, if the database lacks an image of the model,
// and for bad values.
ReferencePositions ReadReference(const ReferenceSource& source,
                                 const Scene& scene, const Context& context);

}  // namespace mgsfm
