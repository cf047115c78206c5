#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails if a module includes one that it must not (docs/development/architecture.md) or
# a private header that another module does not name as its API, if a public header
# includes a third-party header other than Eigen's, or if the library prints, ends
# the program or asks the environment.
set -euo pipefail
cd "$(dirname "$0")/.."

# group/module: the modules it may include, besides itself; a group stands for all
# of its modules. The compiler sees to the groups (mgsfm_add_group).
table='
foundation/base:
foundation/math: base
foundation/geometry: base
foundation/scene: base math geometry
estimation/rig_solver: base math geometry
estimation/pair_filtering: base math geometry scene
estimation/view_graph: base math geometry scene
estimation/georegistration: base math geometry scene
estimation/rotation_averaging: base math geometry scene pair_filtering georegistration
estimation/tracks: base math geometry scene pair_filtering
estimation/translation_averaging: base math geometry scene rig_solver pair_filtering
estimation/moving_objects: base math geometry scene pair_filtering view_graph translation_averaging
estimation/seams: base math geometry scene pair_filtering
estimation/bundle_adjustment: base math geometry scene rig_solver
estimation/registration: base math geometry scene bundle_adjustment
estimation/incremental: base math geometry scene pair_filtering tracks georegistration bundle_adjustment registration
estimation/lenses: base math geometry scene view_graph bundle_adjustment
estimation/soft_rig: base math geometry scene rig_solver bundle_adjustment
estimation/input_check: base math geometry scene view_graph rotation_averaging tracks bundle_adjustment soft_rig
mapper/mapper: base math geometry scene rig_solver pair_filtering view_graph georegistration rotation_averaging tracks translation_averaging moving_objects seams registration bundle_adjustment incremental lenses soft_rig input_check
io/files: base
io/database: base math geometry scene files
io/hloc: base math geometry scene files database
io/rigs: base math geometry scene files database
io/calibration: base math geometry scene files database rigs
io/models: base math geometry scene files database rigs calibration
io/priors: base math geometry scene files database rigs calibration models
frontend/features: base math geometry scene io
frontend/matching: base math geometry scene io
frontend/video: base io
frontend/imaging: base math geometry scene io
baselines/baselines: base math geometry scene rig_solver pair_filtering rotation_averaging translation_averaging mapper
simulator/simulator: base math geometry scene
addons/evaluation: base math geometry scene io
addons/model_tools: base math geometry scene evaluation
addons/fleet: base math geometry scene pair_filtering evaluation model_tools
addons/exchange: base math geometry scene files rigs models
addons/report_page: base math geometry scene io evaluation
addons/recordings: base geometry io video imaging
'

# Only cpu_features.h asks, for MGSFM_PORTABLE: what runs, not what it does.
if find include src -name '*.h' -o -name '*.cc' | sort |
  xargs grep -nE '\<(getenv|abort|exit|_Exit|quick_exit|printf|puts|cout|cerr) *(\(|<<)' |
  grep -v 'MGSFM_PORTABLE'; then
  echo 'the library must not do this; options and Context are for it'
  exit 1
fi

# MODULE/HEADER of the private headers that modules name as their API.
api=$(find src -name CMakeLists.txt | sort | xargs awk '
  FNR == 1 { named = 0; split(FILENAME, folders, "/") }
  !/^ *#/ {
    for (i = 1; i <= NF; ++i) {
      word = $i
      sub(/\)$/, "", word)
      if (word ~ /^[A-Z]+$/) named = word == "API"
      else if (named) print folders[3] "/" word
    }
  }')

find include src apps python -name '*.h' -o -name '*.cc' | sort |
  xargs grep -nE '^ *# *include' |
  awk -v table="$table" -v api="$api" '
    BEGIN {
      num_rows = split(table, rows, "\n")
      for (i = 1; i <= num_rows; ++i) {
        num_words = split(rows[i], words, "[: ]+")
        if (num_words == 0) continue
        split(words[1], names, "/")
        group_of[names[2]] = names[1]
        for (j = 2; j <= num_words; ++j) allowed[names[2] " " words[j]] = 1
      }
      num_headers = split(api, headers, "\n")
      for (i = 1; i <= num_headers; ++i) is_api[headers[i]] = 1
    }
    # $0 is FILE:LINE:#include "PATH" or <PATH>.
    {
      split($0, place, ":")
      split(place[1], folders, "/")
      module = folders[1] ~ /^(include|src)$/ ? folders[3] : "apps"
      path = $0
      sub(/^[^"<]*["<]/, "", path)
      sub(/[">].*$/, "", path)
      is_public = sub(/^mgsfm\//, "", path)
      split(path, parts, "/")
      included = parts[1]
    }
    module != "apps" && !(module in group_of) {
      print place[1] ": module " module " is not in the table"
      num_errors++
    }
    folders[1] == "include" && !is_public && path !~ /^Eigen\// && path ~ /[.\/]/ {
      print place[1] ":" place[2] ": public header includes " path
      num_errors++
    }
    included in group_of && path ~ /\// && included != module {
      if (module != "apps" && !((module " " included) in allowed) &&
          !((module " " group_of[included]) in allowed)) {
        print place[1] ":" place[2] ": " module " must not include " included
        num_errors++
      }
      if (!is_public) {
        used[path] = 1
        if (!(path in is_api)) {
          print place[1] ":" place[2] ": " path " is not in the API of its module"
          num_errors++
        }
      }
    }
    END {
      for (path in is_api) {
        if (path in used) continue
        print path " is in the API of its module, and no other includes it"
        num_errors++
      }
      if (num_errors > 0) exit 1
      print NR " includes respect the layers; modules share " num_headers \
        " private headers"
    }'
