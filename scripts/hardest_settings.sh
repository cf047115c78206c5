#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Compares methods where it is hardest, over several seeds of the noise, as one
# drive does not tell which of two is better by a percent: 01 with the stereo
# rig, the same with few and wrong features, and the rig kitti360 without loops.
#   scripts/hardest_settings.sh DATA [--sequences stereo_01,kitti360_03]
#       [--seeds 8] [--methods mgsfm,dmra_mgp,mma] [--work FOLDER] [--threads N]
# DATA has kitti_trajectories/01.txt ... What is done is not done again.
# docs/experiments.md shows what it gave.
set -euo pipefail
exec /usr/bin/python3 -B "$(dirname "$0")/hardest_settings.py" "$@"
