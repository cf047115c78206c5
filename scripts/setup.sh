#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the Debian 12 packages that mgsfm needs; does nothing if all are
# there.
#   scripts/setup.sh        to build, run and test
#   scripts/setup.sh --dev  and to check format, lint and COLMAP compatibility,
#                           for the tables of scripts/bench.sh, and for the
#                           tables and pictures of docs/experiments.md
set -euo pipefail

packages=(
  cmake ninja-build g++ ccache
  libeigen3-dev libceres-dev libsuitesparse-dev libopenblas0-serial
  libsqlite3-dev
  nlohmann-json3-dev libopencv-core-dev libopencv-imgcodecs-dev
  libopencv-imgproc-dev libexiv2-dev
  libflann-dev
  libgtest-dev libgmock-dev libbenchmark-dev
)
case "${1:-}" in
  "") ;;
  --dev) packages+=(clang-format clang-tidy colmap python3 python3-matplotlib) ;;
  *) echo "usage: scripts/setup.sh [--dev]" >&2; exit 1 ;;
esac

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$status" = installed ] || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

echo "Installing ${missing[*]}"
as_root=()
[ "$(id -u)" = 0 ] || as_root=(sudo)
"${as_root[@]}" apt-get update -q
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
  apt-get install -q -y --no-install-recommends "${missing[@]}"
