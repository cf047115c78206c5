#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes data/demo anew: a simulated drive with a rig of four cameras, a stereo
# pair ahead and two fisheyes to the sides, that hardly share any view.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh
scripts/build.sh release

rm -rf data/demo
build/release/apps/mgsfm/mgsfm simulate --output_path data/demo \
  --rig kitti360 --path curve --num_frames 24 \
  --num_points_per_frame 120 --max_num_features 200 --num_matched_frames 2 \
  --pixel_noise 0.5 --mismatch_ratio 0.05 --random_seed 1
