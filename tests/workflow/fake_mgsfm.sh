#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Stands for the program in a test of the rules: writes empty outputs, and the
# command lines to `calls`. Of three clusters, the second is mapped first and the
# third has nothing to reconstruct.
set -euo pipefail
echo "$*" >>calls
command=$1
shift
declare -A option
while [ $# -gt 0 ]; do
  option[${1#--}]=$2
  shift 2
done
case "$command" in
  feature_extractor) touch "${option[database_path]}" ;;
  database_merger) touch "${option[merged_database_path]}" ;;
  vocab_tree_builder) touch "${option[vocab_tree_path]}" ;;
  sequential_matcher) touch "${option[output_pairs_path]}" ;;
  matches_importer) touch "${option[shard_path]}" ;;
  report) touch "${option[output_path]}" ;;
  model_merger) mkdir -p "${option[output_path]}/0" ;;
  mapper)
    case "${option[image_list_path]-}" in
      "")
        mkdir -p "${option[output_path]}"
        echo '{"clusters": [{}, {}, {}], "calibration_clusters": [1]}' \
          >"${option[output_path]}/clusters.json" ;;
      */2.txt) exit 2 ;;
      *)
        mkdir -p "${option[output_path]}/0"
        touch "${option[output_path]}/0/rig_config.json" ;;
    esac ;;
esac
