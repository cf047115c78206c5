#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# COLMAP continues from databases and models of mgsfm, and mgsfm from those of
# COLMAP 3.8:
#   exchange_with_colmap.sh IMAGES WORK [--ImageReader.OPTION VALUE ...]
# IMAGES holds a folder for each camera; WORK is a new folder for the results.
# On the processor; about 3 minutes for 40 images of 0.5 megapixels.
set -euo pipefail
images=$(realpath "$1")
work=$2
shift 2
cd "$(dirname "$0")/.."
mgsfm=$PWD/build/release/apps/mgsfm/mgsfm
command -v colmap >/dev/null || {
  echo "colmap is not there; install the package colmap" >&2
  exit 1
}
export QT_QPA_PLATFORM=offscreen
mkdir "$work"
cd "$work"

echo "== features and matches of mgsfm, mapper of COLMAP"
"$mgsfm" feature_extractor --database_path mgsfm.db --image_path "$images" "$@"
"$mgsfm" sequential_matcher --database_path mgsfm.db \
  --SequentialMatching.overlap 5
mkdir colmap_model
status=0
if colmap mapper --database_path mgsfm.db --image_path "$images" \
  --output_path colmap_model --Mapper.ba_refine_focal_length 0 \
  --Mapper.ba_refine_extra_params 0 >colmap_mapper.log 2>&1; then
  colmap model_analyzer --path colmap_model/0
else
  echo "colmap mapper made no model, see $PWD/colmap_mapper.log; short and" \
    "straight drives have no first pair for it" >&2
  status=1
fi

echo "== features and matches of COLMAP, mapper of mgsfm"
colmap feature_extractor --database_path colmap.db --image_path "$images" \
  --ImageReader.single_camera_per_folder 1 --SiftExtraction.use_gpu 0 "$@" \
  >colmap_features.log 2>&1
colmap sequential_matcher --database_path colmap.db \
  --SequentialMatching.overlap 3 --SequentialMatching.quadratic_overlap 0 \
  --SiftMatching.use_gpu 0 >colmap_matches.log 2>&1
"$mgsfm" mapper --database_path colmap.db --output_path mgsfm_model

echo "== model of mgsfm, tools of mgsfm and COLMAP"
"$mgsfm" model_aligner --input_path mgsfm_model/0 --output_path aligned \
  --alignment_type plane
mkdir triangulated undistorted
colmap model_converter --input_path aligned --output_path points.ply \
  --output_type PLY >colmap_tools.log 2>&1
colmap point_triangulator --database_path colmap.db --image_path "$images" \
  --input_path aligned --output_path triangulated >>colmap_tools.log 2>&1
colmap image_undistorter --image_path "$images" --input_path aligned \
  --output_path undistorted >>colmap_tools.log 2>&1
"$mgsfm" model_analyzer --path triangulated
exit $status
