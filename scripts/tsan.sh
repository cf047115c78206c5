#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs the tests that use several threads under the thread sanitizer. All
# parallel code of mgsfm uses std::thread, which the sanitizer follows; threads
# of libraries, which are not instrumented, are ignored.
#   scripts/tsan.sh [further arguments of ctest]
set -euo pipefail
cd "$(dirname "$0")/.."

tests=(base math rig_solver bundle_adjustment rotation_averaging tracks translation_averaging view_graph
  matching feature_extraction model_io database rig_configuration registration
  soft_rig positions simulator baselines report_page
  imaging pair_filtering frame_depths mapper
  hard_scenes live_view)
targets=("${tests[@]/#/mgsfm_}")
targets=("${targets[@]/%/_test}")
scripts/build.sh tsan --target "${targets[@]}"
names=$(IFS='|'; echo "${tests[*]}")
ctest --preset tsan -R "^($names)\$" "$@"
