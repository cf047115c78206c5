#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Repeats the paper's experiments on KITTI odometry as it is downloaded:
#   scripts/kitti_odometry.sh ROOT [--sequences 00,06] [--methods all]
#       [--work FOLDER] [--threads N] [--time_limit SECONDS]
# ROOT/sequences/00/{image_0,image_1,calib.txt}, ROOT/poses/00.txt; masks, if
# any, in sequences/00/masks/image_0/000000.png.png. A sequence with database.db
# and truth/ instead, as scripts/make_kitti_tree.sh simulates, needs no images.
# Methods: paper (ours, the baselines, colmap and glomap if they are installed),
# ablation, all, or names. What is done is not done again.
# docs/experiments.md says more.
set -euo pipefail
# That of Debian, which has matplotlib.
exec /usr/bin/python3 -B "$(dirname "$0")/kitti_odometry.py" "$@"
