#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the Debian 12 packages that mgsfm needs; does nothing if they are
# present. Without root, it tells which are missing and how to install them.
#   scripts/setup.sh            to build and run the program
#   scripts/setup.sh --python   also to build the Python package
#   scripts/setup.sh --test     also to build and run the tests and benchmarks
#   scripts/setup.sh --package  also to build Debian packages and the wheel
#   scripts/setup.sh --dev      also for all checks of .ci/run and for experiments/
#   scripts/setup.sh --all      also for fuzzing and the workflow on Slurm
# With --prefix FOLDER, it then builds the program, with --python also the Python
# package, and installs them in FOLDER, for example ~/.local.
set -euo pipefail

packages=(
  cmake ninja-build g++
  libeigen3-dev libceres-dev libsuitesparse-dev libopenblas0-serial
  libsqlite3-dev nlohmann-json3-dev
  libopencv-core-dev libopencv-imgcodecs-dev libopencv-imgproc-dev
  libexiv2-dev libflann-dev libre2-dev libyaml-cpp-dev
  libbz2-dev liblz4-dev libzstd-dev
  libhdf5-dev libavformat-dev libavcodec-dev libswscale-dev libavutil-dev
  libmicrohttpd-dev
)
python_packages=(pybind11-dev python3-dev python3-numpy)
test_packages=(libgtest-dev libgmock-dev libbenchmark-dev locales python3)
package_packages=(
  debootstrap dpkg-dev file git
  python3-build python3-setuptools python3-venv python3-wheel
)
dev_packages=(
  ccache chromium clang-format clang-tidy colmap
  python3-pytest python3-matplotlib python3-mypy python3-pil python3-yaml
  doxygen libjs-katex mkdocs-material
  python3-ipykernel python3-nbclient python3-nbformat
)
all_packages=(
  clang-14 libclang-rt-14-dev
  snakemake slurmctld slurmd slurm-client munge
)

usage() {
  sed -n '3,/^set/s/^# \?//p' "$0" >&2
  exit 1
}

prefix=
with_python=OFF
while [ $# -gt 0 ]; do
  case $1 in
    --python) packages+=("${python_packages[@]}"); with_python=ON ;;
    --test) packages+=("${test_packages[@]}") ;;
    --package)
      packages+=("${python_packages[@]}" "${package_packages[@]}") ;;
    --dev)
      packages+=("${python_packages[@]}" "${test_packages[@]}"
        "${dev_packages[@]}") ;;
    --all)
      packages+=("${python_packages[@]}" "${test_packages[@]}"
        "${package_packages[@]}" "${dev_packages[@]}" "${all_packages[@]}") ;;
    --prefix)
      [ $# -gt 1 ] || usage
      prefix=$2
      shift ;;
    *) usage ;;
  esac
  shift
done

install_packages() {
  if ! command -v dpkg-query >/dev/null; then
    echo "This system has no Debian packages. CMake tells which libraries are" \
      "missing; scripts/setup.sh names their packages." >&2
    return
  fi
  local missing=() package status
  for package in "${packages[@]}"; do
    status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null ||
      true)
    [ "$status" = installed ] || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0

  if [ "$(id -u)" != 0 ]; then
    echo "Missing packages; install them with" >&2
    echo "  sudo apt-get install --no-install-recommends ${missing[*]}" >&2
    exit 1
  fi
  echo "Installing ${missing[*]}"
  apt-get update -q
  DEBIAN_FRONTEND=noninteractive \
    apt-get install -q -y --no-install-recommends "${missing[@]}"
}

# In a build folder of its own, so that those of developers keep their settings.
install_mgsfm() {
  mkdir -p "$prefix"
  prefix=$(cd "$prefix" && pwd)
  cd "$(dirname "$0")/.."
  cmake -G Ninja -S . -B build/install -DCMAKE_BUILD_TYPE=Release \
    -DMGSFM_BUILD_PYTHON=$with_python -DCMAKE_INSTALL_PREFIX="$prefix"
  cmake --build build/install -j "$(getconf _NPROCESSORS_ONLN)"
  cmake --install build/install --strip >/dev/null
  echo "installed $prefix/bin/mgsfm; the folder $prefix/bin should be in PATH"
  if [ $with_python = ON ]; then
    echo "for Python: export PYTHONPATH=$prefix/lib/python3/dist-packages"
  fi
}

install_packages
[ -z "$prefix" ] || install_mgsfm
