#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs tests in a build that counts how often each line runs, and prints the
# share of lines that they reach, by module.
#   scripts/coverage.sh [arguments of ctest]
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/build.sh coverage
find build/coverage -name '*.gcda' -delete
ctest --preset coverage -j "$(nproc)" "$@"
scripts/coverage.py build/coverage
