#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails if docs/reference/options.md is stale, a relative link in a Markdown file
# leads nowhere, code and documents name what does not exist, or the results
# have grown beyond a short read. Needs the program in build/release.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/gen_docs.sh --check

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
# Pages that comments name, and constants that the table of constants names.
grep -rhoE 'docs/[a-z_/]+\.md' src include apps tests bench cmake scripts experiments |
  sort -u | while read -r page; do
  [ -e "$page" ] || { echo "comments name $page, which does not exist" >&2; exit 1; }
done
grep -oE '`k[A-Z][A-Za-z_]+`' docs/results/constants.md | tr -d '`' | sort -u |
  while read -r name; do
    grep -rqwE "(constexpr|const) .*$name" src apps include || {
      echo "docs/results/constants.md names $name, which does not exist" >&2
      exit 1
    }
  done
if [ "$(cat docs/results/*.md | wc -l)" -gt 800 ]; then
  echo 'docs/results has more than 800 lines' >&2
  exit 1
fi
echo "options, links and names are up to date"
