#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs the tests that use several threads under the thread sanitizer.
#   scripts/tsan.sh [further arguments of ctest]
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/build.sh tsan
ctest --preset tsan -j2 "$@"
