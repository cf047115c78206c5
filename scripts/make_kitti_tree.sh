#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes a folder as kitti_odometry.sh takes it, of simulated drives along the
# trajectories of KITTI and of recorded images if there are any:
#   scripts/make_kitti_tree.sh DATA TREE [--sequences 00,04] [--rig stereo]
#       [--frame_step 1] [--program MGSFM] [-- OPTIONS of mgsfm simulate]
# DATA has kitti_trajectories/00.txt ... and, perhaps, kitti06_stereo/ (images/
# cam0, images/cam1, calib.txt, gt_poses.txt), which becomes sequence
# 06_recorded of a stereo tree. What is there is not made again.
set -euo pipefail
data=${1:?folder of data}
tree=${2:?folder to make}
shift 2
sequences=
rig=stereo
frame_step=1
program=$(dirname "$0")/../build/release/apps/mgsfm/mgsfm
while [ $# -gt 0 ]; do
  case "$1" in
    --) shift; break ;;
    --sequences | --rig | --frame_step | --program) ;;
    *) echo "make_kitti_tree.sh: unknown option $1" >&2; exit 1 ;;
  esac
  [ $# -ge 2 ] || { echo "make_kitti_tree.sh: $1 needs a value" >&2; exit 1; }
  declare "${1#--}=$2"
  shift 2
done
recorded=$data/kitti06_stereo
if [ -z "$sequences" ]; then
  sequences=$(cd "$data/kitti_trajectories" && ls ./*.txt |
    sed 's/^..//;s/.txt$//' | paste -sd,)
  if [ "$rig" = stereo ] && [ -d "$recorded" ]; then
    sequences=$sequences,06_recorded
  fi
fi

link_recorded() {
  if [ ! -d "$recorded" ]; then
    echo "make_kitti_tree.sh: no folder $recorded for 06_recorded" >&2
    exit 1
  fi
  mkdir "$1"
  ln -s "$(realpath "$recorded/images/cam0")" "$1/image_0"
  ln -s "$(realpath "$recorded/images/cam1")" "$1/image_1"
  # KITTI names the matrices.
  awk 'NF == 12 { print "P" NR - 1 ": " $0 }' "$recorded/calib.txt" \
    >"$1/calib.txt"
  cp "$recorded/gt_poses.txt" "$tree/poses/06_recorded.txt"
}

mkdir -p "$tree/sequences" "$tree/poses"
for name in ${sequences//,/ }; do
  folder=$tree/sequences/$name
  if [ "$name" = 06_recorded ]; then
    [ -e "$folder" ] || link_recorded "$folder"
    continue
  fi
  [ -e "$folder/database.db" ] && continue
  echo "simulating $name"
  "$program" simulate --log_level warning --output_path "$folder" \
    --preset standard --rig "$rig" --frame_step "$frame_step" \
    --trajectory_path "$data/kitti_trajectories/$name.txt" "$@"
done
