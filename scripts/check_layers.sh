#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails if a module includes one that it must not (docs/development/architecture.md), if a
# public header includes a third-party header other than Eigen's, or if the
# library prints, ends the program or asks the environment.
set -euo pipefail
cd "$(dirname "$0")/.."

# module: the modules it may include, besides itself.
table='
base:
math: base
geometry: base
scene: base math geometry
least_squares: base math geometry
io: base math geometry scene
io/files: base
io/database: base math geometry scene io/files
io/rigs: base math geometry scene io/files io/database
io/hloc: base math geometry scene io/files io/database
io/calibration: base math geometry scene io/files io/database io/rigs
io/models: base math geometry scene io/files io/database io/rigs io/calibration
io/exchange: base math geometry scene io/files io/rigs io/models
io/priors: base math geometry scene io/files io/database io/rigs io/models
features: base math geometry scene io
matching: base math geometry scene io
synthetic: base math geometry scene
undistortion: base math geometry scene io
video: base io
eval: base math geometry scene
priors: base math geometry scene
model_tools: base math geometry scene eval
report_page: base math geometry scene eval io
pair_filtering: base math geometry scene
view_graph: base math geometry scene
rotation: base math geometry scene priors
tracks: base math geometry scene pair_filtering
translation: base math geometry least_squares scene pair_filtering
confidence: base math geometry scene pair_filtering
extension: base math geometry scene io
bundle: base math geometry least_squares scene
soft_rig: base math geometry least_squares scene bundle
health: base math geometry scene view_graph rotation tracks soft_rig
pipeline: base math geometry least_squares scene priors pair_filtering view_graph rotation tracks translation confidence extension bundle soft_rig health
baselines: base math geometry least_squares scene pair_filtering rotation translation pipeline
'

# Only cpu_features.h asks, for MGSFM_PORTABLE: what runs, not what it does.
if find include src -name '*.h' -o -name '*.cc' | sort |
  xargs grep -nE '\<(getenv|abort|exit|_Exit|quick_exit|printf|puts|cout|cerr) *(\(|<<)' |
  grep -v 'MGSFM_PORTABLE'; then
  echo 'the library must not do this; options and Context are for it'
  exit 1
fi

find include src apps -name '*.h' -o -name '*.cc' | sort |
  xargs grep -nE '^ *# *include' |
  awk -v table="$table" '
    BEGIN {
      num_rows = split(table, rows, "\n")
      for (i = 1; i <= num_rows; ++i) {
        num_words = split(rows[i], words, "[: ]+")
        if (num_words == 0) continue
        known[words[1]] = 1
        for (j = 1; j <= num_words; ++j) allowed[words[1] " " words[j]] = 1
      }
    }
    # $0 is FILE:LINE:#include "PATH" or <PATH>.
    {
      split($0, place, ":")
      num_folders = split(place[1], folders, "/")
      first = folders[1] == "include" ? 3 : 2
      module = folders[first]
      if (module == "io") module = "io/" folders[first + 1]
      path = $0
      sub(/^[^"<]*["<]/, "", path)
      sub(/[">].*$/, "", path)
    }
    folders[1] != "apps" && !(module in known) {
      print place[1] ": module " module " is not in the table"
      num_errors++
    }
    folders[1] == "include" && path !~ /^(mgsfm|Eigen)\// && path ~ /[.\/]/ {
      print place[1] ":" place[2] ": public header includes " path
      num_errors++
    }
    folders[1] != "apps" {
      sub(/^mgsfm\//, "", path)
      split(path, parts, "/")
      included = parts[1]
      # Modules outside io may use all of it.
      if (included == "io" && module ~ /^io\//) included = "io/" parts[2]
      if (included in known && path ~ /\// && included != module &&
          !((module " " included) in allowed)) {
        print place[1] ":" place[2] ": " module " must not include " included
        num_errors++
      }
    }
    END {
      if (num_errors > 0) exit 1
      print NR " includes respect the layers"
    }'
