#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Formats all C++ files, or with --check, fails if one is not formatted.
set -euo pipefail
cd "$(dirname "$0")/.."

mode=(-i)
if [ "${1:-}" = --check ]; then mode=(--dry-run --Werror); fi
git ls-files -z --cached --others --exclude-standard '*.cc' '*.h' |
  xargs -0 clang-format "${mode[@]}" -style=file
