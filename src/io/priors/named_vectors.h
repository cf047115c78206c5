// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "files/other_images.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Three numbers of an image, and their line in the file.
struct NamedVector {
  int image_idx = 0;
  Eigen::Vector3d value;
  int line_number = 0;
};

// Reads the lines "image_name A B C" of a file, in its order; empty lines and
// those that start with '#' are skipped. Names may contain blanks. Throws
// Error, naming file and line, for malformed lines, unknown or repeated images
// and an unreadable file; its message uses `columns` ("X Y Z") and `option`
// ("ref_images_path").
std::vector<NamedVector> ReadNamedVectors(
    const Scene& scene, const std::string& path, const std::string& columns,
    const std::string& option, OtherImages others = OtherImages::kReject);

}  // namespace mgsfm
