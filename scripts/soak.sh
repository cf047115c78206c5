#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Maps random small drives with random options and numbers of threads; fails if
# a model is incomplete, inaccurate or depends on the threads.
#   scripts/soak.sh MINUTES [--first_seed N] [--num_drives N]
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/build.sh release --target mgsfm_app
nice -n 19 python3 tests/soak/soak.py build/release/apps/mgsfm/mgsfm "$@"
