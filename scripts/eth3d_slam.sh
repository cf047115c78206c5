#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Repeats the paper's experiments on ETH3D-SLAM's stereo training sets:
#   scripts/eth3d_slam.sh ROOT [--sequences desk_3,repetitive] [--methods all]
#       [--frame_step N]
# and the options of scripts/kitti_odometry.sh. ROOT, or ROOT/training, has
# desk_3/{rgb,rgb2,calibration.txt,calibration2.txt,extrinsics_1_2.txt,
# groundtruth.txt}. Images of equal names are a frame.
set -euo pipefail
# That of Debian, which has matplotlib.
exec /usr/bin/python3 -B "$(dirname "$0")/eth3d_slam.py" "$@"
