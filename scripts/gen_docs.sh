#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Writes docs/reference/options.md and the table of rules in
# docs/maths/pair_filtering.md from the program, or with --check, fails if they
# are not what the program prints.
set -euo pipefail
cd "$(dirname "$0")/.."

mgsfm=build/release/apps/mgsfm/mgsfm
# The page of rules with the table that the program prints.
rules_page() {
  sed '/^| rule | follows /,/^$/d' docs/maths/pair_filtering.md |
    sed '/^<!-- rules: /r '<("$mgsfm" print_rules_markdown && echo)
}
# update PAGE: replaces it by standard input, or compares both.
update() {
  local new
  new=$(mktemp)
  cat >"$new"
  if [ "$check" = --check ]; then
    diff -u "$1" "$new" || {
      echo "$1 is stale; run scripts/gen_docs.sh" >&2
      rm "$new"
      exit 1
    }
  else
    cp "$new" "$1"
  fi
  rm "$new"
}

check=${1:-}
"$mgsfm" print_options_markdown | update docs/reference/options.md
rules_page | update docs/maths/pair_filtering.md
