#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs missing packages, builds the program, reconstructs the images in
# data/rendered_rig (four cameras with hardly any common field of view, two of
# them fisheyes, with unknown poses in the rig), and compares the result with
# the ground truth. All output is in build/demo.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh
# Several files as one compile faster; an existing build keeps its settings.
[ -e build/release ] || cmake --preset release -DMGSFM_UNITY_BUILD=ON >/dev/null
scripts/build.sh release --target mgsfm_app

mgsfm=build/release/apps/mgsfm/mgsfm
out=build/demo
data=data/rendered_rig
"$mgsfm" automatic_reconstructor --image_path "$data/images" \
  --ImageReader.camera_params_path "$data/cameras.txt" --workspace_path "$out"
"$mgsfm" model_evaluator --input_path "$out/sparse/0" --gt_path "$data/truth" \
  --svg_path "$out/path.svg"

echo
echo "features, matches: $out/database.db"
echo "model:             $out/sparse/0"
echo "calibrated rig:    $out/sparse/0/rig_config.json"
echo "report:            $out/sparse/report.json"
echo "picture:           $out/path.svg"
echo
echo "Open $PWD/$out/sparse/0/report.html in a browser to look at the result."
