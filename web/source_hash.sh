#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Prints a hash of everything that web/dist/report_page.html is made of.
set -euo pipefail
cd "$(dirname "$0")"
cat build.mjs package.json package-lock.json source_hash.sh \
  $(find src -type f | LC_ALL=C sort) | sha256sum | cut -d ' ' -f 1
