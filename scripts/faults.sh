#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes every n-th system call of small runs of the commands go wrong, and every
# n-th allocation of readers and writers and call stack of the mapper fail. The
# tests `faults` and `allocations` do the same with a few of them.
#   scripts/faults.sh [N]    N = 1 by default: all of them
set -euo pipefail
cd "$(dirname "$0")/.."

export MGSFM_FAULT_STRIDE=${1:-1}
scripts/build.sh release --target mgsfm_faults_test mgsfm_allocations_test
if [ -d /dev/shm ]; then export TMPDIR=/dev/shm; fi
build/release/tests/faults/mgsfm_faults_test
build/release/tests/allocations/mgsfm_allocations_test
