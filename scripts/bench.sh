#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Measures the speed of whole mappers and of the solvers. Needs the program and
# the benchmarks (cmake --preset release -DMGSFM_BUILD_BENCHMARKS=ON, then
# scripts/build.sh); `scripts/bench.sh --help` lists the options.
set -euo pipefail
cd "$(dirname "$0")/.."

exec python3 -m experiments bench "$@"
