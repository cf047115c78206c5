// SPDX-License-Identifier: BSD-3-Clause
#include "priors/urdf.h"

#include <cmath>

#include "fuzz/fuzz_target.h"
#include "priors/body_calibration.h"

namespace mgsfm {

void FuzzUrdf(const std::string& input) {
  const std::string path = (FuzzFolder() / "robot.urdf").string();
  WriteTextFile(path, input);
  (void)Accepts([&] { CheckBodyCalibration(path); });
  Urdf urdf;
  if (!Accepts([&] { urdf = ReadUrdf(path); })) return;
  for (const std::string& link : urdf.links) {
    const auto [root, root_from_link] = urdf.fixed.RootFrom(link);
    FUZZ_CHECK(urdf.fixed.FindParent(root) == nullptr);
    FUZZ_CHECK(urdf.fixed.Between(root, link).has_value());
    FUZZ_CHECK(root_from_link.translation.allFinite());
    FUZZ_CHECK(std::abs(root_from_link.rotation.norm() - 1.0) < 1e-9);
  }
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(urdf, mgsfm::FuzzUrdf)
