// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/calibration.h"

#include <cmath>

#include "fuzz/fuzz_target.h"
#include "priors/body_calibration.h"

namespace mgsfm {

// The first byte selects the kind of file.
void FuzzCalibration(const std::string& input) {
  if (input.empty()) return;
  constexpr const char* kNames[] = {"in.yaml", "in.json", "in.txt"};
  const std::string path =
      (FuzzFolder() / kNames[static_cast<uint8_t>(input[0]) % 3]).string();
  WriteTextFile(path, input.substr(1));
  (void)Accepts([&] { CheckBodyCalibration(path); });
  std::vector<CalibratedCamera> cameras;
  if (!Accepts([&] { cameras = ReadCalibration(path); })) return;
  for (const CalibratedCamera& camera : cameras) {
    FUZZ_CHECK(!camera.names.empty());
    FUZZ_CHECK(camera.model.has_value() == camera.why_no_model.empty());
    for (const double param : camera.params) FUZZ_CHECK(std::isfinite(param));
    if (!camera.cam_from_base) continue;
    FUZZ_CHECK(camera.cam_from_base->translation.allFinite());
    FUZZ_CHECK(std::abs(camera.cam_from_base->rotation.norm() - 1.0) < 1e-9);
  }
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(calibration, mgsfm::FuzzCalibration)
