#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes data/demo and data/rendered_rig anew: simulated drives with rigs of four
# cameras, a stereo pair ahead and two fisheyes to the sides, that hardly share
# any view. The first is a database, the second are images of the rig that
# data/rendered_rig/rig_config.json describes.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh
scripts/build.sh release

rm -rf data/demo
build/release/apps/mgsfm/mgsfm simulate --output_path data/demo \
  --rig kitti360 --path curve --num_frames 24 \
  --num_points_per_frame 120 --max_num_features 200 --num_matched_frames 2 \
  --pixel_noise 0.5 --mismatch_ratio 0.05 --random_seed 1

rm -rf data/rendered_rig/{images,truth,cameras.txt}
build/release/apps/mgsfm/mgsfm simulate --output_path data/rendered_rig \
  --rig_config_path data/rendered_rig/rig_config.json --num_frames 24 \
  --render 1 --render_format jpg --render_jpeg_quality 92 --random_seed 1
