#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
set -euo pipefail
cmake -G Ninja -S . -B build/conda ${CMAKE_ARGS:-} \
  -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$PREFIX" \
  -DMGSFM_BUILD_PYTHON=ON -DPython3_EXECUTABLE="$PYTHON" \
  -DMGSFM_PYTHON_INSTALL_DIR="${SP_DIR#"$PREFIX"/}"
cmake --build build/conda -j "${CPU_COUNT:-2}"
cmake --install build/conda
