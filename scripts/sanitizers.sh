#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs tests under the address and undefined-behavior sanitizers.
#   scripts/sanitizers.sh          the tests of all modules
#   scripts/sanitizers.sh --short  those of code that reads and writes files, and
#                                  of the geometry below it: the part of .ci/run.
#                                  Without the core and the add-ons, which take
#                                  most of the time to compile
# Further arguments are those of ctest.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "${1:-}" != --short ]; then
  scripts/build.sh asan-ubsan
  exec ctest --preset asan-ubsan -j2 "$@"
fi
shift

# mgsfm_NAME_test of tests/foundation (but math), io, frontend/features and fuzz.
tests=(base geometry scene
  calibration database model_io pose_priors rig_configuration
  feature_extraction feature_import image_tags sift fuzz_corpus)
targets=("${tests[@]/#/mgsfm_}")
targets=("${targets[@]/%/_test}")
scripts/build.sh asan-ubsan --target "${targets[@]}"
names=$(IFS='|'; echo "${tests[*]}")
ctest --preset asan-ubsan -j2 -R "^($names)\$" "$@"
