#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails if a public header does not compile by itself, with Eigen alone.
set -euo pipefail
cd "$(dirname "$0")/.."

find include -name '*.h' -printf '%P\0' | sort -z |
  xargs -0 -I HEADER -P "$(getconf _NPROCESSORS_ONLN)" "${CXX:-g++}" -std=c++17 -fsyntax-only \
    -Wall -Wextra -Werror -I include -isystem /usr/include/eigen3 \
    -include HEADER -x c++ /dev/null
