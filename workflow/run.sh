#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs the workflow with the arguments of Snakemake:
#   workflow/run.sh --profile workflow/profiles/local --configfile my.yaml
# A run that was killed needs no --unlock: the kernel releases the lock of this
# script when Snakemake and its jobs on this machine end. It keeps two runs out
# of one working folder.
set -euo pipefail
mkdir -p .snakemake
exec 9>.snakemake/mgsfm_workflow.lock
if ! flock --nonblock 9; then
  echo "a workflow, or a job of a killed one, runs in $PWD; wait for it, or" \
    "end it, and start again" >&2
  exit 1
fi
exec snakemake --snakefile "$(dirname "$0")/Snakefile" --nolock "$@"
