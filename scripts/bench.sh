#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Compares the solvers of bundle adjustment (native, Ceres with the same
# derivatives, Ceres with six blocks and automatic derivatives), prints a table
# and writes it as JSON. Ratios are of one run, so they hold on a busy machine;
# seconds do not.
#   scripts/bench.sh                      to build/release/bench.json
#   scripts/bench.sh --output NEW.json --compare OLD.json
#   scripts/bench.sh --threads 4 --data FOLDER
# FOLDER has kitti06_stereo/database.db and kitti_trajectories/07.txt; what is
# absent is left out, and a simulated curve stands in for the trajectory.
set -euo pipefail
cd "$(dirname "$0")/.."

output=build/release/bench.json
compare=
threads=2
data=${MGSFM_SHARED_DATA:-../shared/data}
while [ $# -gt 0 ]; do
  case "$1" in
    --output) output=$2 ;;
    --compare) compare=$2 ;;
    --threads) threads=$2 ;;
    --data) data=$2 ;;
    *) echo "usage: scripts/bench.sh [--output NEW.json] [--compare OLD.json]" \
            "[--threads N] [--data FOLDER]" >&2; exit 1 ;;
  esac
  [ $# -ge 2 ] || { echo "bench.sh: $1 needs a value" >&2; exit 1; }
  shift 2
done

program=build/release/bench/mgsfm_solver_benchmark
if [ ! -x "$program" ]; then
  echo "bench.sh: $program is not built; run scripts/build.sh" >&2
  exit 1
fi
parts=$(mktemp -d)
trap 'rm -rf "$parts"' EXIT

run() {
  local name=$1
  shift
  "$program" --name "$name" --json_path "$parts/$name.json" \
    --num_threads "$threads" --log_level warning --max_num_iterations 60 \
    --Mapper.BundleAdjustment.refine_focal_length no \
    --Mapper.BundleAdjustment.refine_extra_params no "$@"
}
if [ -e "$data/kitti06_stereo/database.db" ]; then
  run kitti06_stereo --database_path "$data/kitti06_stereo/database.db"
else
  echo "no $data/kitti06_stereo: left out"
fi
if [ -e "$data/kitti_trajectories/07.txt" ]; then
  run simulated_kitti07 \
    --trajectory_path "$data/kitti_trajectories/07.txt" \
    --Simulation.max_num_features 400
else
  run simulated_curve --Simulation.num_frames 300 \
    --Simulation.max_num_features 400
fi

python3 scripts/bench_table.py "$output" "$parts" ${compare:+"$compare"}
