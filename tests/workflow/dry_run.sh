#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Plans the workflow and checks the numbers of jobs; and runs all rules, with
# fake_mgsfm.sh for the program. Exit code 77: Snakemake is not installed.
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/../.." && pwd)
command -v snakemake >/dev/null || exit 77
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for session in monday tuesday; do
  mkdir -p $session/cam0
  touch $session/cam0/{1,2,3,4,5}.jpg
done
cat >sessions.yaml <<EOF
sessions:
  monday: {images: monday, vehicle: van}
  tuesday: {images: tuesday, vehicle: van}
EOF

# count PROFILE RULE [CONFIG ...]: the number of jobs of a rule.
count() {
  local profile=$1 rule=$2
  shift 2
  snakemake --snakefile "$source_folder/workflow/Snakefile" --dry-run \
    --profile "$source_folder/workflow/profiles/$profile" "$@" 2>&1 |
    tee plan.txt | awk -v rule="$rule" '$1 == rule { print $2; exit }'
}
expect() {
  [ "$1" = "$2" ] || { cat plan.txt; echo "expected $2, not '$1'"; exit 1; }
}
# 10 images: two sessions of 5 with shards of 2, match shards of 4.
expect "$(count local extract --configfile sessions.yaml \
  --config images_per_shard=2)" 6
expect "$(count slurm match --config images=monday images_per_match_shard=2)" 3

snakemake --snakefile "$source_folder/workflow/Snakefile" \
  --profile "$source_folder/workflow/profiles/local" --config images=monday \
  num_clusters=3 work=w mgsfm="$source_folder/tests/workflow/fake_mgsfm.sh" \
  >plan.txt 2>&1 || { cat plan.txt; exit 1; }
# The cluster that calibrates comes first, and its model is passed to others.
expect "$(grep -c -- '--image_list_path w/clusters/' calls)" 3
expect "$(grep -m1 -o -- '--image_list_path .*/..txt' calls)" \
  "--image_list_path w/clusters/1.txt"
expect "$(grep -c -- '--calibration_path w/maps/1/0/rig_config.json' calls)" 2
expect "$(grep -c '^model_merger --graph 1 .*--input_path w/maps ' calls)" 1

# From a database, nothing is extracted or matched.
python3 - <<EOF
import sqlite3
with sqlite3.connect("given.db") as database:
    database.execute("CREATE TABLE images (image_id INTEGER)")
    database.executemany("INSERT INTO images VALUES (?)",
                         [(i,) for i in range(5)])
EOF
expect "$(count local extract --config database=given.db work=v)" ""
expect "$(count local clusters --config database=given.db work=v \
  images_per_cluster=2)" 1
expect "$(count local map_all --config database=given.db work=v)" 1
