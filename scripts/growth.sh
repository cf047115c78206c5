#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# How time and memory of the mapper grow: simulates the first so many images of
# one street (stereo, 400 features an image), maps them from the database to
# the model on disk, and prints time and peak memory of each stage and the
# exponents of their growth with the observations.
#   scripts/growth.sh                                   1k to 36k images
#   scripts/growth.sh --sizes "1000 2000" --output build/growth
#   scripts/growth.sh --trajectory 00.txt   poses in KITTI's format, the first
#                                           so many of them
#   scripts/growth.sh --svg docs/growth.svg --threads 2
# Finished sizes in the output folder are not done again; databases and models
# are removed. 36k images take some 10 GB of disk.
set -euo pipefail
cd "$(dirname "$0")/.."

sizes="1000 2000 4000 9000 18000 36000"
output=build/growth
svg=
threads=2
trajectory=
while [ $# -gt 0 ]; do
  case "$1" in
    --sizes | --output | --svg | --threads | --trajectory) ;;
    *) sed -n '3,15s/^# \{0,1\}//p' "$0" >&2; exit 1 ;;
  esac
  [ $# -ge 2 ] || { echo "growth.sh: $1 needs a value" >&2; exit 1; }
  declare "${1#--}=$2"
  shift 2
done

mgsfm=build/release/apps/mgsfm/mgsfm
report=build/release/bench/mgsfm_growth_report
for built in "$mgsfm" "$report"; do
  if [ ! -x "$built" ]; then
    echo "growth.sh: $built is not built; run scripts/build.sh" >&2
    exit 1
  fi
done
mkdir -p "$output"
scratch=$(mktemp -d -p "$output")
trap 'rm -rf "$scratch"' EXIT

for size in $sizes; do
  [ -e "$output/$size.json" ] && continue
  frames=$((size / 2))
  drive=(--num_frames "$frames")
  if [ -n "$trajectory" ]; then
    head -n "$frames" "$trajectory" >"$scratch/path.txt"
    drive=(--trajectory_path "$scratch/path.txt")
  fi
  common=(--num_threads "$threads" --log_level warning)
  "$mgsfm" simulate --output_path "$scratch/input" --preset standard \
    --rig stereo --max_num_features 400 "${drive[@]}" "${common[@]}"
  "$mgsfm" mapper --database_path "$scratch/input/database.db" \
    --output_path "$scratch/model" "${common[@]}"
  cp "$scratch/model/report.json" "$output/$size.json"
  rm -rf "$scratch/input" "$scratch/model"
  echo "$size images are done" >&2
done
"$report" --input_path "$output" ${svg:+--svg_path "$svg"}
