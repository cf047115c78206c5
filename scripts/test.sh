#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs missing packages, builds and runs all tests.
#   scripts/test.sh [further arguments of ctest]
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh --test
cmake --preset release -DMGSFM_BUILD_TESTS=ON >/dev/null
scripts/build.sh release
ctest --preset release -j2 "$@"
