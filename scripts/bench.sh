#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Measures speed, prints tables and writes all numbers as JSON:
# - whole mappers, from the database to the model on disk, with the time of each
#   stage, peak memory and accuracy: of kitti06_stereo, euroc_v101_stereo and
#   simulated drives of all rigs, the fastest of 3 runs each;
# - the solvers of bundle adjustment on the same problem: native, Ceres with the
#   same derivatives, Ceres with six blocks and automatic derivatives.
# Ratios are of one run, so they hold on a busy machine; seconds do not.
#   scripts/bench.sh                      to build/release/bench.json
#   scripts/bench.sh --output NEW.json --compare OLD.json
#   scripts/bench.sh --threads 4 --data FOLDER --runs 1
#   scripts/bench.sh --only end_to_end    or solvers
#   scripts/bench.sh --colmap             also the mapper of COLMAP, in turn
# FOLDER has kitti06_stereo/, euroc_v101_stereo/ and kitti_trajectories/07.txt;
# what is absent is left out, and a simulated curve stands in for the
# trajectory. Inner loops alone: build/release/bench/mgsfm_micro_benchmark.
set -euo pipefail
cd "$(dirname "$0")/.."

usage() {
  sed -n '/^# Measures/,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0" >&2
  exit 1
}
output=build/release/bench.json
compare=
threads=2
runs=3
only=
colmap=()
data=${MGSFM_SHARED_DATA:-../shared/data}
while [ $# -gt 0 ]; do
  case "$1" in
    --colmap) colmap=(--colmap); shift; continue ;;
    --output | --compare | --threads | --data | --runs | --only) ;;
    *) usage ;;
  esac
  [ $# -ge 2 ] || { echo "bench.sh: $1 needs a value" >&2; exit 1; }
  declare "${1#--}=$2"
  shift 2
done
case "$only" in "" | solvers | end_to_end) ;; *) usage ;; esac

program=build/release/bench/mgsfm_solver_benchmark
mgsfm=build/release/apps/mgsfm/mgsfm
for built in "$program" "$mgsfm"; do
  if [ ! -x "$built" ]; then
    echo "bench.sh: $built is not built; run scripts/build.sh" >&2
    exit 1
  fi
done
parts=$(mktemp -d)
trap 'rm -rf "$parts"' EXIT

solve() {
  local name=$1
  shift
  "$program" --name "$name" --json_path "$parts/$name.json" \
    --num_threads "$threads" --log_level warning --max_num_iterations 30 \
    --Mapper.BundleAdjustment.refine_focal_length no \
    --Mapper.BundleAdjustment.refine_extra_params no "$@"
}
if [ "$only" != solvers ]; then
  python3 scripts/bench_end_to_end.py "$parts" --program "$mgsfm" \
    --data "$data" --threads "$threads" --runs "$runs" "${colmap[@]}"
fi
if [ "$only" != end_to_end ]; then
  if [ -e "$data/kitti06_stereo/database.db" ]; then
    solve solvers_kitti06 --database_path "$data/kitti06_stereo/database.db"
  else
    echo "no $data/kitti06_stereo: left out"
  fi
  if [ -e "$data/kitti_trajectories/07.txt" ]; then
    solve solvers_simulated_kitti07 \
      --trajectory_path "$data/kitti_trajectories/07.txt" \
      --Simulation.max_num_features 400
  else
    solve solvers_simulated_curve --Simulation.num_frames 300 \
      --Simulation.max_num_features 400
  fi
fi
python3 scripts/bench_table.py "$output" "$parts" ${compare:+"$compare"}
