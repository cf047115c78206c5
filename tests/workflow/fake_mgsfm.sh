#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Stands for the program in a test of the rules: writes empty outputs, and the
# command lines to `calls`. Of three clusters, the second is mapped first and the
# third has nothing to reconstruct.
set -euo pipefail
case "$*" in
  --version) echo "mgsfm 1.0, commit abc" && exit ;;
  "mapper --help_all") echo "  --use_prior_position" && exit ;;
  *--help_all) exit ;;
esac
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
  database_merger)
    python3 - "${option[merged_database_path]}" <<EOF
import sqlite3, sys
with sqlite3.connect(sys.argv[1]) as database:
    database.execute("CREATE TABLE IF NOT EXISTS images (name TEXT)")
    database.executemany("INSERT INTO images VALUES (?)", [
        (f"{drive}/cam0/{i}.jpg",) for drive in ("monday", "tuesday")
        for i in range(5)])
EOF
    ;;
  vocab_tree_builder) touch "${option[vocab_tree_path]}" ;;
  sequential_matcher)
    printf '%s\n' "monday/cam0/1.jpg monday/cam0/2.jpg" \
      "monday/cam0/1.jpg tuesday/cam0/2.jpg" \
      "tuesday/cam0/1.jpg tuesday/cam0/2.jpg" \
      >"${option[output_pairs_path]}" ;;
  matches_importer) touch "${option[shard_path]}" ;;
  report) touch "${option[output_path]}" ;;
  model_merger) mkdir -p "${option[output_path]}/0" ;;
  mapper)
    case "${option[partition]-}:${option[image_list_path]-}" in
      *: | ?*:*)
        mkdir -p "${option[output_path]}"
        echo '{"clusters": [{}, {}, {}], "calibration_clusters": [1]}' \
          >"${option[output_path]}/clusters.json" ;;
      */2.txt) exit 2 ;;
      *)
        mkdir -p "${option[output_path]}/0"
        touch "${option[output_path]}/0/rig_config.json" ;;
    esac ;;
esac
