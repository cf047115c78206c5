#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds and runs a fuzz target of tests/fuzz, or all of them one by one, with
# libFuzzer and the address and undefined-behavior sanitizers. New inputs go to
# build/fuzz/corpus/TARGET, failures to build/fuzz/failures/TARGET.
#   scripts/fuzz.sh TARGET|all SECONDS [further arguments of libFuzzer]
set -euo pipefail
cd "$(dirname "$0")/.."

if [ $# -lt 2 ]; then
  sed -n 's/^# \?//p' "$0" | sed 1d >&2
  exit 1
fi
target=$1
seconds=$2
shift 2

if [ "$target" = all ]; then
  for corpus in tests/fuzz/corpus/*; do
    "$0" "${corpus##*/}" "$seconds" "$@"
  done
  exit
fi
scripts/build.sh fuzz --target "mgsfm_fuzz_$target"
mkdir -p "build/fuzz/corpus/$target" "build/fuzz/failures/$target"
dictionary=tests/fuzz/dictionaries/$target.dict
[ -f "$dictionary" ] && set -- -dict="$dictionary" "$@"
log=build/fuzz/$target.log
status=0
# Limits per input, also of time and memory: a reader that exceeds them fails.
"build/fuzz/tests/fuzz/mgsfm_fuzz_$target" -max_total_time="$seconds" \
  -timeout=10 -rss_limit_mb=1024 -malloc_limit_mb=256 -max_len=4096 \
  -print_final_stats=1 -artifact_prefix="build/fuzz/failures/$target/" "$@" \
  "build/fuzz/corpus/$target" "tests/fuzz/corpus/$target" \
  >"$log" 2>&1 || status=$?
echo "$target: $(sed -n 's/^stat::number_of_executed_units: *//p' "$log") runs"
if [ $status -ne 0 ]; then
  tail -40 "$log" >&2
  exit $status
fi
