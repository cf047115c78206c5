#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# From nothing to a model: installs what is missing, builds, reconstructs the
# drive in data/demo (four cameras that hardly share any view, two of them
# fisheyes, with unknown poses in the rig), and compares the result with the
# truth. Everything is written to build/demo.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh
scripts/build.sh release

mgsfm=build/release/apps/mgsfm/mgsfm
out=build/demo
"$mgsfm" mapper --database_path data/demo/database.db --output_path "$out"
"$mgsfm" model_evaluator --input_path "$out/0" --gt_path data/demo/truth

echo
echo "model:          $out/0"
echo "calibrated rig: $out/0/rig_config.json"
echo "report:         $out/report.json"
