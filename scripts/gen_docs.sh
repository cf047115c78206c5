#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Writes docs/reference/options.md from the program, or with --check, fails if
# the file is not what the program prints.
set -euo pipefail
cd "$(dirname "$0")/.."

mgsfm=build/release/apps/mgsfm/mgsfm
if [ "${1:-}" = --check ]; then
  diff -u docs/reference/options.md <("$mgsfm" print_options_markdown) || {
    echo "docs/reference/options.md is stale; run scripts/gen_docs.sh" >&2
    exit 1
  }
else
  "$mgsfm" print_options_markdown >docs/reference/options.md
fi
