#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Simulates drives along the trajectories TRAJECTORIES/*.txt (poses in KITTI's
# format) with the rigs stereo and kitti360, maps them, and compares with the
# oracles of bench/oracle/oracle.h. Prints the tables of docs/accuracy.md.
#   scripts/oracle_table.sh TRAJECTORIES [OUTPUT [standard|aliased [STEP]]]
# Finished runs in OUTPUT (build/oracle) are not done again.
set -euo pipefail
cd "$(dirname "$0")/.."

trajectories=${1:?folder with trajectories}
output=${2:-build/oracle}
setting=${3:-standard}
step=${4:-2}
case $setting in
  standard) duplicated=0 ;;
  aliased) duplicated=0.02 ;;
  *) echo "unknown setting '$setting'" >&2; exit 1 ;;
esac

scripts/build.sh release --target mgsfm_oracle_benchmark mgsfm_benchmark_report \
  >/dev/null
mkdir -p "$output/$setting"
for trajectory in "$trajectories"/*.txt; do
  for rig in stereo kitti360; do
    name="$(basename "$trajectory" .txt) $rig"
    json="$output/$setting/${name/ /_}.json"
    [ -e "$json" ] && continue
    build/release/bench/mgsfm_oracle_benchmark --name "$name" \
      --trajectory_path "$trajectory" --json_path "$json" --log_level error \
      --Simulation.rig "$rig" --Simulation.frame_step "$step" \
      --Simulation.duplicated_pair_ratio "$duplicated" >&2
  done
done
# Of the aliased drives the aim is a mapper that is not folded.
ratios=(--max_oracle_ratio 1.1 --max_full_oracle_ratio 1.3)
[ "$setting" = standard ] ||
  ratios=(--max_oracle_ratio 1.5 --max_full_oracle_ratio 1.5)
build/release/bench/mgsfm_benchmark_report --input_path "$output/$setting" \
  "${ratios[@]}"
