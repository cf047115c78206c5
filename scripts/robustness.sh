#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Error and registered share of the mapper against the share of mismatches,
# wrong pairs and missing images, and against trigger jitter: the pictures of
# docs/accuracy.md, from simulated drives of 60 frames.
#   scripts/robustness.sh [OUTPUT [PICTURES]]
# Finished runs in OUTPUT (build/robustness) are not done again.
set -euo pipefail
cd "$(dirname "$0")/.."

output=${1:-build/robustness}
pictures=${2:-docs/pictures}
scripts/build.sh release --target mgsfm_oracle_benchmark mgsfm_benchmark_report \
  >/dev/null
mkdir -p "$pictures"

# sweep OPTION X_LABEL X_FACTOR TITLE VALUES...
sweep() {
  local option=$1 x_label=$2 x_factor=$3 title=$4
  shift 4
  mkdir -p "$output/$option"
  for rig in stereo kitti360; do
    for value in "$@"; do
      for seed in 1 2 3; do
        local name="${rig}_${value}_$seed"
        local json="$output/$option/$name.json"
        [ -e "$json" ] && continue
        # Exit code 2, nothing reconstructed, is a point of the curve, too.
        build/release/bench/mgsfm_oracle_benchmark --name "$name" \
          --json_path "$json" --log_level error --random_seed "$seed" \
          --Simulation.rig "$rig" --Simulation.path curve \
          --Simulation.num_frames 60 "--Simulation.$option" "$value" >&2 ||
          [ $? -eq 2 ]
      done
    done
  done
  build/release/bench/mgsfm_benchmark_report --input_path "$output/$option" \
    --svg_path "$pictures/$option.svg" --setting "$option" \
    --x_label "$x_label" --x_factor "$x_factor" --title "$title"
}

sweep mismatch_ratio "mismatches before verification, %" 100 \
  "Mismatches" 0 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8
sweep isolated_wrong_pair_ratio "wrong image pairs, %" 100 \
  "Wrong pairs" 0 0.05 0.1 0.15 0.2 0.25 0.3
sweep missing_image_ratio "missing images, %" 100 \
  "Missing images" 0 0.1 0.2 0.3 0.4 0.5
sweep trigger_jitter "largest trigger jitter, ms" 1 \
  "Trigger jitter at 10 m/s" 0 10 20 30 40 50
