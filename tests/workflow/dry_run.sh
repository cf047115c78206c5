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
ln -s "$source_folder/tests/workflow/fake_mgsfm.sh" mgsfm
export PATH=$folder:$PATH
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
  num_clusters=3 work=w prior_options="--use_prior_position 1" >plan.txt 2>&1 || { cat plan.txt; exit 1; }
# The cluster that calibrates comes first, and its model is passed to others.
expect "$(grep -c -- '--image_list_path w/clusters/' calls)" 3
expect "$(grep -m1 -o -- '--image_list_path .*/..txt' calls)" \
  "--image_list_path w/clusters/1.txt"
expect "$(grep -c -- '--calibration_path w/maps/1/0/rig_config.json' calls)" 2
expect "$(grep -c '^model_merger --graph 1 .*--input_path w/maps ' calls)" 1
# The join gets the positions of the maps, and the images for the colors.
expect "$(grep -c '^model_merger .*--image_path monday .*--use_prior_position 1' \
  calls)" 1
# Each output has a record; the digest of an input is that of its own record.
python3 - <<EOF
import json
def record(name):
    with open(f"w/provenance/{name}.json") as file:
        return json.load(file)
joined, database = record("model"), record("database.db")
assert joined["program"] == "mgsfm 1.0, commit abc", joined
assert joined["options"] == "--use_prior_position 1", joined
assert joined["inputs"]["w/database.db"] == database["sha256"], joined
assert "w/maps/1" in joined["inputs"], joined
for name in ("features.db", "pairs.txt", "clusters", "maps/0", "report"):
    assert len(record(name)["sha256"]) == 64, name
EOF

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

# A drive is added to a finished workflow: only it is extracted, only its pairs
# are matched, and the model of before stays, or is one more sub-map.
rm calls
cat >more.yaml <<EOF
sessions:
  tuesday: {images: tuesday, vehicle: van}
extends: w
work: x
num_clusters: 3
EOF
snakemake --snakefile "$source_folder/workflow/Snakefile" \
  --profile "$source_folder/workflow/profiles/local" --configfile more.yaml \
  >plan.txt 2>&1 || { cat plan.txt; exit 1; }
expect "$(grep '^feature_extractor' calls | grep -vc -- '--image_path tuesday')" 0
expect "$(head -n 1 x/features.txt)" w/database.db
expect "$(grep -c '^vocab_tree_builder' calls)" 0
expect "$(grep -c tuesday x/pairs.txt)" 2
expect "$(grep -vc tuesday x/pairs.txt)" 0
expect "$(grep -c -- '--partition 3 .*--image_list_path x/new_images.txt' \
  calls)" 1
expect "$(cut -d / -f 1 x/new_images.txt | sort -u)" tuesday
expect "$(grep -c -- '--calibration_path w/model/0/rig_config.json' calls)" 0
expect "$(grep -c '^model_merger .*--cluster_path x/clusters --existing_path w/model ' \
  calls)" 1
echo "adjusts_extended: true" >>more.yaml
snakemake --snakefile "$source_folder/workflow/Snakefile" \
  --profile "$source_folder/workflow/profiles/local" --configfile more.yaml \
  --config work=u >plan.txt 2>&1 || { cat plan.txt; exit 1; }
expect "$(grep -c -- '^model_merger .*--existing_path' calls)" 1
expect "$(readlink u/maps/3)" "$folder/w/model"

# Faults of the configuration are listed before the first job: those of values,
# then those of files and flags.
rm calls
# expect_faults "SETTING ..." LINE ...
expect_faults() {
  local settings line
  read -ra settings <<<"$1"
  shift
  snakemake --snakefile "$source_folder/workflow/Snakefile" \
    --profile "$source_folder/workflow/profiles/local" --config work=y \
    "${settings[@]}" >plan.txt 2>&1 &&
    { echo "faults were ignored"; exit 1; }
  for line in "$@"; do expect "$(grep -c "^$line" plan.txt)" 1; done
}
expect_faults "matcher=sequential threads=0 image_per_shard=3 database=7" \
  "image_per_shard: 3: .* 'images_per_shard'?" \
  "matcher: 'sequential': did you mean 'sequential_matcher'?" \
  "threads: 0: give a whole number of at least 1" \
  "database: 7: give a text"
expect_faults "images=none mapper_options=--use_prior_positions \
  join_options=--output_path" \
  "images: 'none': there is no such folder with images" \
  "mapper_options: '--use_prior_positions': .* 'use_prior_position'?" \
  "join_options: '--output_path': the workflow sets it; remove it"
expect "$(ls calls 2>&1 | grep -c '^calls$')" 0

# Two runs in one folder exclude each other; a killed one needs no unlocking.
run() {
  "$source_folder/workflow/run.sh" \
    --profile "$source_folder/workflow/profiles/local" \
    --config images=monday num_clusters=1 work=z
}
mkdir -p .snakemake/locks
flock .snakemake/mgsfm_workflow.lock sleep 60 &
until ! flock --nonblock .snakemake/mgsfm_workflow.lock true; do sleep 0.1; done
run >plan.txt 2>&1 && { echo "the lock was ignored"; exit 1; }
expect "$(grep -c 'wait for it' plan.txt)" 1
pkill -KILL -P $! || true
kill -KILL $! 2>/dev/null || true
until flock --nonblock .snakemake/mgsfm_workflow.lock true; do sleep 0.1; done
run >plan.txt 2>&1 || { cat plan.txt; exit 1; }
