#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes web/dist/report_page.html, the template of the report page, from web/src.
#   scripts/report_page.sh          needs Node.js, and npm's registry the first time
#   scripts/report_page.sh --check  fails if the file is of other sources
set -euo pipefail
cd "$(dirname "$0")/../web"

page=dist/report_page.html
if [ "${1:-}" = --check ]; then
  head -n 2 "$page" | grep -q "$(./source_hash.sh)" || {
    echo "web/$page is stale; run scripts/report_page.sh" >&2
    exit 1
  }
else
  [ -d node_modules ] || npm ci
  node build.mjs
fi
