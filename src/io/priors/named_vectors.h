// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Three numbers of an image, and the line that they were on.
struct NamedVector {
  int image_idx = 0;
  Eigen::Vector3d value;
  int line_number = 0;
};

// The lines "image_name A B C" of a file, in its order; empty lines and those
// that start with '#' are skipped. Names may have blanks. Throws Error, naming
// file and line, for other lines, unknown images and images that come twice,
// and for a file that cannot be read; `columns` ("X Y Z") and `option`
// ("ref_images_path") are what it then speaks of.
std::vector<NamedVector> ReadNamedVectors(const Scene& scene,
                                          const std::string& path,
                                          const std::string& columns,
                                          const std::string& option);

}  // namespace mgsfm
