#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the Debian 12 packages that mgsfm needs; does nothing if they are
# present. Without root, it tells which are missing and how to install them.
#   scripts/setup.sh         to build and run the program
#   scripts/setup.sh --test  also to build and run the tests and benchmarks
#   scripts/setup.sh --dev   also for all checks of .ci/run and for experiments/
#   scripts/setup.sh --all   also for fuzzing and the workflow on Slurm
set -euo pipefail

packages=(
  cmake ninja-build g++
  libeigen3-dev libceres-dev libsuitesparse-dev libopenblas0-serial
  libsqlite3-dev nlohmann-json3-dev
  libopencv-core-dev libopencv-imgcodecs-dev libopencv-imgproc-dev
  libexiv2-dev libflann-dev libre2-dev libyaml-cpp-dev
  libhdf5-dev
)
test_packages=(libgtest-dev libgmock-dev libbenchmark-dev python3)
dev_packages=(
  ccache chromium clang-format clang-tidy colmap
  pybind11-dev python3-dev python3-numpy
  python3-pytest python3-matplotlib python3-mypy
)
all_packages=(
  clang-14 libclang-rt-14-dev
  snakemake slurmctld slurmd slurm-client munge
)
case "${1:-}" in
  "") ;;
  --test) packages+=("${test_packages[@]}") ;;
  --dev) packages+=("${test_packages[@]}" "${dev_packages[@]}") ;;
  --all)
    packages+=("${test_packages[@]}" "${dev_packages[@]}" "${all_packages[@]}") ;;
  *) echo "usage: scripts/setup.sh [--test|--dev|--all]" >&2; exit 1 ;;
esac

if ! command -v dpkg-query >/dev/null; then
  echo "This system has no Debian packages. CMake tells which libraries are" \
    "missing; scripts/setup.sh names their packages." >&2
  exit 0
fi
missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$status" = installed ] || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

if [ "$(id -u)" != 0 ]; then
  echo "Missing packages; install them with" >&2
  echo "  sudo apt-get install --no-install-recommends ${missing[*]}" >&2
  exit 1
fi
echo "Installing ${missing[*]}"
apt-get update -q
DEBIAN_FRONTEND=noninteractive \
  apt-get install -q -y --no-install-recommends "${missing[@]}"
