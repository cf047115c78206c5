#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds the Debian packages mgsfm, libmgsfm-dev and python3-mgsfm in
# build/package/packages, and tests them in a new Debian 12 below FOLDER:
# installs them with their dependencies, runs a program in Python and the
# program, builds an example against the library, removes the packages, and fails
# if a file is left behind.
#   scripts/packages.sh build
#   scripts/packages.sh test FOLDER [MIRROR]   as root; needs debootstrap
# MGSFM_BUILD_DIR names another build folder, which must be built, with the
# prefix /usr.
set -euo pipefail
cd "$(dirname "$0")/.."

build=${MGSFM_BUILD_DIR:-build/package}

build_packages() {
  [ -n "${MGSFM_BUILD_DIR:-}" ] || scripts/build.sh package
  rm -rf "$build/packages"
  (cd "$build" && cpack)
  rm -rf "$build/packages/_CPack_Packages"
  ls -l "$build"/packages/*.deb
}

in_chroot() {
  chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
    LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive bash -euo pipefail -c "$1"
}

make_chroot() {
  if [ ! -f "$folder/base.tar" ]; then
    debootstrap --variant=minbase bookworm "$folder/base" "$mirror"
    tar -C "$folder/base" -cf "$folder/base.tar" .
    rm -rf "$folder/base"
  fi
  rm -rf "$root"
  mkdir -p "$root"
  tar -C "$root" -xf "$folder/base.tar"
  mkdir "$root/packages" "$root/examples"
  cp "$build"/packages/*.deb packaging/demo.py "$root/packages"
  cp examples/* "$root/examples"
  [ ! -f /etc/resolv.conf ] || cp -L /etc/resolv.conf "$root/etc"
  # A chroot has no terminals.
  echo 'Dpkg::Use-Pty "0";' >"$root/etc/apt/apt.conf.d/90packages"
  in_chroot 'apt-get update -qq'
}

# What the packages may change for good: the records of dpkg and apt.
list_files() {
  in_chroot 'find / -xdev \( -path /proc -o -path /sys -o -path /dev \
    -o -path /tmp -o -path /var/lib/dpkg -o -path /var/lib/apt \
    -o -path /var/cache -o -path /var/log \) -prune -o -print | sort'
}

run_demo() {
  in_chroot 'cd "$(mktemp -d)" && python3 /packages/demo.py >out 2>&1 ||
    { cat out; exit 1; }
    tail -n 2 out
    mgsfm --version | head -n 1
    mgsfm mapper --quiet --database_path drive/database.db --output_path program
    cmp sparse/0/points3D.bin program/0/points3D.bin'
}

build_example() {
  in_chroot 'cd "$(mktemp -d)"
    apt-get install -qq --no-install-recommends cmake g++ make >/dev/null
    cmake /examples >/dev/null
    make -s map_database'
}

remove_packages() {
  in_chroot 'apt-get purge -qq mgsfm libmgsfm-dev python3-mgsfm >/dev/null'
}

fail_if_not_empty() {
  [ -z "$2" ] || {
    echo "$1:" >&2
    echo "$2" >&2
    exit 1
  }
}

test_packages() {
  make_chroot
  echo "== install and run"
  local start=$SECONDS downloaded
  # This is the command of docs/guides/install.md, with recommended packages.
  local install='cd /packages && apt-get install -qq \
    ./mgsfm_*.deb ./python3-mgsfm_*.deb >/var/log/install.log'
  in_chroot "${install/install -qq/install -qq --download-only}"
  downloaded=$SECONDS
  in_chroot "$install"
  echo "installed with all dependencies in $((SECONDS - start)) s," \
    "$((downloaded - start)) s of them to download"
  run_demo
  in_chroot 'man=$(dpkg -L mgsfm | grep man1/mgsfm-mapper.1.gz); gzip -t "$man"
    test -f /usr/share/bash-completion/completions/mgsfm'
  echo "== the C++ library"
  in_chroot 'cd /packages && apt-get install -qq --no-install-recommends \
    ./libmgsfm-dev_*.deb >/var/log/install.log'
  build_example
  echo "== remove and purge"
  remove_packages
  fail_if_not_empty "left behind" \
    "$(list_files | grep mgsfm | grep -v '^/packages\|^/examples' || true)"
  list_files >"$folder/before.txt"
  in_chroot 'apt-get install -qq /packages/*.deb >/var/log/install.log'
  run_demo
  remove_packages
  list_files >"$folder/after.txt"
  fail_if_not_empty "changed by installation and removal" \
    "$(diff "$folder/before.txt" "$folder/after.txt" || true)"
  echo "nothing is left behind"
  rm -rf "$root"
}

case "${1:-}" in
  build) build_packages ;;
  test)
    folder=$(realpath "${2:?FOLDER}")
    root=$folder/root
    mirror=${3:-http://deb.debian.org/debian}
    mkdir -p "$folder"
    test_packages ;;
  *) sed -n '3,/^set/s/^# \?//p' "$0" >&2; exit 1 ;;
esac
