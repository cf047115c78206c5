#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs the tests in a build that counts executed lines, and prints the share of
# each module, and of readers and writers file by file.
#   scripts/coverage.sh [further arguments of ctest]
# Details are in build/coverage/html/index.html.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/build.sh coverage
find build/coverage -name '*.gcda' -delete
ctest --preset coverage -j2 "$@" || true
mkdir -p build/coverage/html
gcovr --root . --filter 'src/|apps/' --object-directory build/coverage \
  --gcov-ignore-parse-errors --exclude-throw-branches \
  --html-details build/coverage/html/index.html \
  --json-summary build/coverage/summary.json >/dev/null
python3 - build/coverage/summary.json <<'PYTHON'
import collections
import json
import sys

files = json.load(open(sys.argv[1]))["files"]


def table(title, key):
    sums = collections.defaultdict(lambda: [0, 0])
    for file in files:
        name = key(file["filename"])
        if name:
            sums[name][0] += file["line_covered"]
            sums[name][1] += file["line_total"]
    print(f"| {title} | lines | executed |\n|---|---|---|")
    for name, (covered, total) in sorted(sums.items()):
        print(f"| `{name}` | {total} | {100 * covered / max(total, 1):.1f} % |")
    print()


table("module", lambda name: "/".join(name.split("/")[:2]))
table("file", lambda name: name if name.startswith("src/io/") else None)
PYTHON
