#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails if docs/reference/options.md is stale, if a document names a command,
# option or value that the program lacks, or if a relative link in a Markdown
# file leads nowhere. Needs the program in build/release. The test docs runs the
# commands and checks of the pages.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/gen_docs.sh --check
python3 scripts/check_options.py

git ls-files --cached --others --exclude-standard '*.md' |
  xargs grep -oHE '\]\([^)# ]+' | sed 's/\](/ /' | {
  num_broken=0
  while read -r file target; do
    file=${file%:}
    case $target in *://* | mailto:*) continue ;; esac
    if [ ! -e "$(dirname "$file")/$target" ]; then
      echo "$file: no such file: $target" >&2
      num_broken=$((num_broken + 1))
    fi
  done
  [ "$num_broken" = 0 ]
}
echo "options and links are up to date"
