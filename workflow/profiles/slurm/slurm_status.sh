#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# The state of a job in the words of Snakemake (cluster-status).
state=$(scontrol show job "$1" 2>/dev/null | sed -n 's/.*JobState=\([A-Z_]*\).*/\1/p')
if [ -z "$state" ]; then
  # The controller forgets jobs (MinJobAge); the accounting database does not.
  state=$(sacct -n -X -P -o State -j "$1" 2>/dev/null | head -1)
fi
case "$state" in
  COMPLETED) echo success ;;
  PENDING|CONFIGURING|RUNNING|COMPLETING|SUSPENDED|REQUEUED|RESIZING|STOPPED)
    echo running ;;
  *) echo failed ;;
esac
