#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Configures and builds a preset of CMakePresets.json in build/PRESET.
#   scripts/build.sh [PRESET] [further arguments of cmake --build]
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:-release}
[ $# -eq 0 ] || shift
cmake --preset "$preset" >/dev/null
cmake --build --preset "$preset" -j "$(getconf _NPROCESSORS_ONLN)" "$@"
