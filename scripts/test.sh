#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds and runs all tests.
#   scripts/test.sh [further arguments of ctest]
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh
scripts/build.sh release
ctest --preset release -j2 "$@"
