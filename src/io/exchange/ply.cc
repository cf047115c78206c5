// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "io/exchange/formats.h"

namespace mgsfm {

// Little-endian, as on every machine that Debian's COLMAP runs on.
std::vector<ExportedFile> WritePly(const ExportInput& input) {
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement vertex " +
      std::to_string(input.model.points.size()) +
      "\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n";
  for (const Point3D& point : input.model.points) {
    const Eigen::Vector3f position = point.point_in_world.cast<float>();
    text.append(reinterpret_cast<const char*>(position.data()),
                3 * sizeof(float));
    text.append(reinterpret_cast<const char*>(point.color.data()), 3);
  }
  return {{"", std::move(text)}};
}

}  // namespace mgsfm
