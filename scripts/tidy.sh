#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs clang-tidy, with warnings as errors.
#   scripts/tidy.sh              all source files
#   scripts/tidy.sh FILE...      these
#   scripts/tidy.sh --since REF  those that differ from the git revision REF
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "${1:-}" = --since ]; then
  mapfile -t files < <(git diff --name-only --diff-filter=d "$2" -- \
    'src/*.cc' 'apps/*.cc')
elif [ $# -gt 0 ]; then
  files=("$@")
else
  mapfile -t files < <(git ls-files --cached --others --exclude-standard \
    'src/*.cc' 'apps/*.cc')
fi
[ ${#files[@]} -gt 0 ] || exit 0

cmake --preset tidy >/dev/null
cmake --build build/tidy --target mgsfm_commit >/dev/null
printf '%s\0' "${files[@]}" |
  xargs -0 -n 1 -P "$(getconf _NPROCESSORS_ONLN)" clang-tidy -p build/tidy --quiet
