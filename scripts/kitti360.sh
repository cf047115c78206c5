#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Repeats the paper's experiments on KITTI-360 as it is downloaded:
#   scripts/kitti360.sh ROOT [--sequences 0000,0002] [--methods all]
#       [--cameras image_00,image_01,image_02,image_03] [--frame_step N]
# and the options of scripts/kitti_odometry.sh. ROOT has data_2d_raw/
# 2013_05_28_drive_0000_sync/image_00/data_rect ... image_03/data_rgb,
# calibration/, and data_poses/2013_05_28_drive_0000_sync/cam0_to_world.txt;
# masks, if any, in data_2d_raw/DRIVE/masks/image_00/data_rect/NAME.png.png.
# Frames with a true pose are taken. The fisheyes' model is fitted by one that
# COLMAP knows; how well is printed.
set -euo pipefail
# That of Debian, which has matplotlib.
exec /usr/bin/python3 -B "$(dirname "$0")/kitti360.py" "$@"
