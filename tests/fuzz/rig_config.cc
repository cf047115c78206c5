// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rigs/rig_config.h"

#include <cmath>

#include "fuzz/fuzz_target.h"

namespace mgsfm {

void FuzzRigConfig(const std::string& input) {
  const std::string paths[] = {(FuzzFolder() / "in.json").string(),
                               (FuzzFolder() / "out.json").string(),
                               (FuzzFolder() / "again.json").string()};
  WriteTextFile(paths[0], input);
  std::vector<RigConfig> rigs;
  if (!Accepts([&] { rigs = ReadRigConfig(paths[0]); })) return;
  for (const RigConfig& rig : rigs) {
    for (const RigConfigCamera& camera : rig.cameras) {
      if (camera.cam_from_rig) {
        FUZZ_CHECK(camera.cam_from_rig->translation.allFinite());
        FUZZ_CHECK(std::abs(camera.cam_from_rig->rotation.norm() - 1.0) < 1e-9);
      }
      for (const double param : camera.camera_params) {
        FUZZ_CHECK(std::isfinite(param));
      }
    }
  }
  WriteRigConfig(paths[1], rigs);
  WriteRigConfig(paths[2], ReadRigConfig(paths[1]));
  FUZZ_CHECK(ReadTextFile(paths[1]) == ReadTextFile(paths[2]));
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(rig_config, mgsfm::FuzzRigConfig)
