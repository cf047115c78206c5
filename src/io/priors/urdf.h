// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "geometry/frame_tree.h"

namespace mgsfm {

// The links of a robot. Those that fixed joints connect are in `fixed`, below
// the topmost one.
struct Urdf {
  std::string path;
  std::vector<std::string> links;
  FrameTree fixed;
};

// Reads the elements link and joint of a URDF (https://wiki.ros.org/urdf/XML),
// whose origins are x, y, z in meters, and roll, pitch and yaw about the fixed
// axes x, y and z of the parent. Throws Error, naming the joint, for other
// origins, and for files that have no end, cycles or macros of xacro.
Urdf ReadUrdf(const std::string& path);

}  // namespace mgsfm
