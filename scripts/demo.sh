#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# From nothing to a model: installs what is missing, builds, simulates a drive
# with a rig of four cameras without common view (two fisheyes), reconstructs it
# with the poses of the cameras in the rig unknown, and compares the result with
# the truth. Everything is written to build/demo.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh
scripts/build.sh release

mgsfm=build/release/apps/mgsfm/mgsfm
out=build/demo
rm -rf "$out"
"$mgsfm" simulate --output_path "$out" --rig kitti360 --path curve \
  --num_frames 40 --pixel_noise 0.5 --mismatch_ratio 0.05
"$mgsfm" mapper --database_path "$out/database.db" --output_path "$out/model"
"$mgsfm" model_evaluator --input_path "$out/model/0" --gt_path "$out/truth"

echo
echo "database:       $out/database.db"
echo "model:          $out/model/0"
echo "calibrated rig: $out/model/0/rig_config.json"
echo "report:         $out/model/report.json"
