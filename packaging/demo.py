# SPDX-License-Identifier: BSD-3-Clause
import pymgsfm

pymgsfm.simulate("drive", {"preset": "standard", "num_frames": 12})
models = pymgsfm.global_mapping("drive/database.db", None, "sparse")
print(models[0].summary())
errors = pymgsfm.evaluate("sparse/0", "drive/truth")
print("median errors:", errors["position_m"]["median"], "m,",
      errors["rotation_deg"]["median"], "deg")
assert models[0].num_frames() == 12
assert errors["position_m"]["median"] < 0.1
