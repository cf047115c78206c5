#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs workflow/Snakefile on the rendered drive: with the profile `local`
# undisturbed, and with the profile `slurm` on a Slurm of its own, while jobs and
# once Snakemake itself are killed. Databases must be equal row by row, models
# byte by byte.
#   tests/workflow/workflow_test.sh MGSFM [IMAGES [KEY=VALUE ...]]
# KEY=VALUE override workflow/config.yaml. Without images, for instance for a
# simulated drive, start with its database:
#   workflow_test.sh MGSFM . database=/path/database.db num_clusters=6
# Exit code 77: something is not
# installed (ctest skips the test).
set -euo pipefail
source_folder=$(cd "$(dirname "$0")/../.." && pwd)
mgsfm=$(realpath "$1")
images=$(realpath "${2:-$source_folder/data/rendered_rig/images}")
shift $(($# < 2 ? $# : 2))
for program in snakemake slurmctld slurmd munged sbatch; do
  if ! PATH=$PATH:/usr/sbin command -v $program >/dev/null; then
    echo "$program is not installed; scripts/setup.sh --all installs it"
    exit 77
  fi
done
export PATH=$PATH:/usr/sbin
source "$source_folder/tests/workflow/slurm.sh"

folder=$(mktemp -d /tmp/mgsfm_workflow.XXXXXX)
snakemake_pid=
killer_pid=
end() {
  for pid in $killer_pid $(cat "$folder"/*_work.pid 2>/dev/null); do
    kill "$pid" 2>/dev/null || true
  done
  [ ! -e "$folder/slurm" ] || stop_slurm "$folder/slurm"
  rm -rf "$folder"
}
trap end EXIT

# run_workflow PROFILE WORK [FLAG ...]. WORK.pid has the process id of Snakemake
# while it runs.
run_workflow() {
  local profile=$1 work=$2 result=0
  shift 2
  (cd "$folder" && echo "$BASHPID" >"$work.pid" && exec snakemake \
    --snakefile "$source_folder/workflow/Snakefile" \
    --profile "$source_folder/workflow/profiles/$profile" --nolock "$@" \
    --config mgsfm="$mgsfm" images="$images" work="$work" \
    "${settings[@]}" >>"$work.log" 2>&1) || result=$?
  rm -f "$work.pid"
  return $result
}
settings=(threads=1 images_per_shard=20 images_per_match_shard=30 num_clusters=1
  "rig_options=--rig_config_path $source_folder/data/rendered_rig/rig_config.json"
  "extraction_options=--ImageReader.camera_params_path $source_folder/data/rendered_rig/cameras.txt"
  "$@")

# Kills a random process of the program every second or so.
kill_jobs() {
  local pids
  while sleep "0.$((RANDOM % 9 + 1))"; do
    mapfile -t pids < <(pgrep -f "^$mgsfm .*$folder/slurm_work/" || true)
    [ ${#pids[@]} -gt 0 ] || continue
    kill -KILL "${pids[RANDOM % ${#pids[@]}]}" 2>/dev/null || continue
    echo x >>"$folder/kills"
    [ "$(wc -l <"$folder/kills")" -lt "${MAX_KILLS:-10}" ] || return 0
  done
}

fail() {
  echo "$1"
  tail -n 60 "$folder"/*_work.log
  tail -n 5 "$folder"/*_work/logs/*.log "$folder"/*_work/logs/*/*.log || true
  exit 1
}

run_workflow local "$folder/local_work" --cores 2 ||
  fail "the local profile failed"

start_slurm "$folder/slurm"
kill_jobs &
killer_pid=$!
run_workflow slurm "$folder/slurm_work" --retries 8 --latency-wait 20 \
  --jobs 2 &
snakemake_pid=$!
# Kill Snakemake when some jobs are done.
until [ -e "$folder/slurm_work/features.db" ] ||
  [ -e "$folder/slurm_work/pairs.txt" ] ||
  [ -e "$folder/slurm_work/clusters/clusters.json" ]; do
  kill -0 $snakemake_pid 2>/dev/null || fail "Snakemake ended early"
  sleep 0.2
done
kill -KILL "$(cat "$folder/slurm_work.pid")" 2>/dev/null || true
wait $snakemake_pid 2>/dev/null || true
# Jobs of the killed Snakemake may still run; it would start them twice.
scancel --user="$(id -un)"
while [ -n "$(squeue -h)" ]; do sleep 0.2; done
run_workflow slurm "$folder/slurm_work" --retries 8 --latency-wait 20 \
  --jobs 2 || fail "the slurm profile failed"
kill $killer_pid 2>/dev/null || true
killer_pid=

echo "$(wc -l <"$folder/kills") processes and Snakemake were killed"
python3 "$source_folder/tests/workflow/compare.py" "$folder/local_work" \
  "$folder/slurm_work"
