#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# What users bring beside images, with and without its use: prints a table, one
# line for each case, with an error without and with it.
#   scripts/use_cases.sh [--data FOLDER] [--output FOLDER] [CASE...]
# Cases: known_rig positions drift gap gravity covariances focal_lengths
# panorama going_on loose_triggers portability. FOLDER has kitti06_stereo/ and
# euroc_v101_stereo/; what is absent is left out. Simulated
# drives are made with seed 0. Finished runs in the output folder
# (build/use_cases) are not done again.
set -euo pipefail
cd "$(dirname "$0")/.."

data=${MGSFM_SHARED_DATA:-../shared/data}
output=build/use_cases
cases=()
while [ $# -gt 0 ]; do
  case "$1" in
    --data | --output)
      [ $# -ge 2 ] || { echo "use_cases.sh: $1 needs a value" >&2; exit 1; }
      declare "${1#--}=$2"
      shift 2
      ;;
    *) cases+=("$1"); shift ;;
  esac
done
[ ${#cases[@]} -gt 0 ] ||
  cases=(known_rig positions drift gap gravity covariances focal_lengths
    panorama going_on loose_triggers portability)
mgsfm=${MGSFM:-build/release/apps/mgsfm/mgsfm}
mkdir -p "$output"

# simulate NAME OPTIONS...
simulate() {
  local folder=$output/$1
  shift
  [ -e "$folder/database.db" ] ||
    "$mgsfm" simulate --output_path "$folder" --log_level error "$@" >&2
}

# map NAME DATABASE OPTIONS...
map() {
  local folder=$output/$1 database=$2
  shift 2
  [ -e "$folder/report.json" ] || "$mgsfm" mapper --database_path "$database" \
    --output_path "$folder" --log_level error "$@" >&2
}

# evaluate NAME OPTIONS...: the errors as JSON on stdout
evaluate() {
  local name=$1
  shift
  "$mgsfm" model_evaluator --input_path "$output/$name/0" \
    --json "$output/$name/evaluation.json" "$@" >/dev/null
  cat "$output/$name/evaluation.json"
}

# get JSON EXPRESSION: of the value e
get() { python3 -c "import json,sys; e=json.loads(sys.argv[1]); print($2)" "$1"; }

row() { echo "| $1 | $2 | $3 | $4 |"; }

known_rig_json() { # FILE TRANSLATION ROTATION
  cat >"$1" <<JSON
[{"cameras": [{"image_prefix": "cam0/", "ref_sensor": true},
  {"image_prefix": "cam1/", "cam_from_rig_rotation": [$3],
   "cam_from_rig_translation": [$2]}]}]
JSON
}

known_rig() {
  simulate rig_unknown --preset standard --rig stereo --num_frames 60
  simulate rig_known --preset standard --rig stereo --num_frames 60 \
    --extrinsics_are_known 1 --database_schema 3.12
  for name in rig_unknown rig_known; do
    map "$name/map" "$output/$name/database.db"
  done
  local before after
  before=$(evaluate rig_unknown/map --gt_path "$output/rig_unknown/truth" \
    --alignment rigid)
  after=$(evaluate rig_known/map --gt_path "$output/rig_known/truth" \
    --alignment rigid)
  local error="'%.3f m' % e['position_m']['mean']"
  row "known rig, simulated stereo" "position, mean, rigid alignment" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
  local kitti=$data/kitti06_stereo
  if [ -d "$kitti" ]; then
    known_rig_json "$output/kitti_rig.json" "-0.537150653, 0, 0" "1, 0, 0, 0"
    map kitti_unknown "$kitti/database.db"
    map kitti_known "$kitti/database.db" \
      --rig_config_path "$output/kitti_rig.json"
    local truth=(--gt_path "$kitti/gt_poses.txt" --gt_format kitti
      --calib_path "$kitti/calib.txt")
    before=$(evaluate kitti_unknown "${truth[@]}" --alignment rigid)
    after=$(evaluate kitti_known "${truth[@]}" --alignment rigid)
    error="'%.2f %% of the path' % (100 * e['position_m']['mean'] / e['path_m'])"
    row "known rig, KITTI 06" "position, mean, rigid alignment" \
      "$(get "$before" "$error")" "$(get "$after" "$error")"
    after=$(evaluate kitti_known "${truth[@]}")
    row "known rig, KITTI 06" "scale" "arbitrary" \
      "$(get "$after" "'%+.2f %%' % (100 * (1 / e['world_from_model']['scale'] - 1))")"
  fi
  local euroc=$data/euroc_v101_stereo
  if [ -d "$euroc" ]; then
    euroc_rig "$euroc" >"$output/euroc_rig.json"
    map euroc_unknown "$euroc/database.db"
    map euroc_known "$euroc/database.db" \
      --rig_config_path "$output/euroc_rig.json"
    local rig=(--gt_format rig --calib_path
      "$euroc/sensor0.yaml,$euroc/sensor1.yaml")
    before=$(evaluate euroc_unknown "${rig[@]}")
    after=$(evaluate euroc_known "${rig[@]}")
    error="'%.3f deg' % e['sensors'][0]['direction_deg']"
    row "known rig, EuRoC V1_01" "direction of the baseline" \
      "$(get "$before" "$error")" "$(get "$after" "$error")"
    local px="'%.3f px' % e['models'][0]['mean_reprojection_error_px']"
    row "known rig, EuRoC V1_01" "reprojection error, mean" \
      "$(get "$(cat "$output/euroc_unknown/report.json")" "$px")" \
      "$(get "$(cat "$output/euroc_known/report.json")" "$px")"
  fi
}

# rig_config.json of the poses in the body that EuRoC gives.
euroc_rig() {
  python3 - "$1" <<'PY'
import json, re, sys
def pose(path):
    numbers = re.search(r"data: \[([^\]]*)\]", open(path).read()).group(1)
    m = [float(x) for x in numbers.split(",")]
    return [m[0:3], m[4:7], m[8:11]], [m[3], m[7], m[11]]
def mul(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)]
            for i in range(3)]
R0, t0 = pose(sys.argv[1] + "/sensor0.yaml")
R1, t1 = pose(sys.argv[1] + "/sensor1.yaml")
R1t = [list(c) for c in zip(*R1)]
R = mul(R1t, R0)
d = [t0[i] - t1[i] for i in range(3)]
t = [sum(R1t[i][k] * d[k] for k in range(3)) for i in range(3)]
w = 0.5 * (1 + R[0][0] + R[1][1] + R[2][2]) ** 0.5
q = [w, (R[2][1] - R[1][2]) / (4 * w), (R[0][2] - R[2][0]) / (4 * w),
     (R[1][0] - R[0][1]) / (4 * w)]
print(json.dumps([{"cameras": [
    {"image_prefix": "cam0/", "ref_sensor": True},
    {"image_prefix": "cam1/", "cam_from_rig_rotation": q,
     "cam_from_rig_translation": t}]}]))
PY
}

positions() {
  simulate gps --preset standard --rig mono --num_frames 300 --path curve \
    --prior_sigma 1 --prior_outlier_ratio 0.1
  map gps/without "$output/gps/database.db"
  map gps/with "$output/gps/database.db" --use_prior_position 1
  local before after error
  before=$(evaluate gps/without --gt_path "$output/gps/truth")
  after=$(evaluate gps/with --gt_path "$output/gps/truth" --alignment none)
  error="'%.2f m' % e['position_m']['mean']"
  row "GPS of 1 m, 10 % gross outliers, simulated" \
    "position, mean; with: not aligned" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
  row "the same" "outliers found" "-" "$(get "$(cat \
    "$output/gps/with/report.json")" \
    "'%d of %d' % (len(e['models'][0]['position_priors']['outliers']), \
     e['models'][0]['position_priors']['num_given'])")"
}

# scale_focal_lengths FROM TO FACTOR PRIOR: focal lengths times a factor
scale_focal_lengths() {
  [ -e "$2" ] || python3 - "$@" <<'PY'
import shutil, sqlite3, struct, sys
shutil.copy(sys.argv[1], sys.argv[2])
db = sqlite3.connect(sys.argv[2])
# Positions of focal lengths by camera model.
focal = {0: [0], 1: [0, 1], 2: [0], 3: [0], 4: [0, 1], 5: [0, 1], 8: [0]}
rows = db.execute("SELECT camera_id, model, params FROM cameras").fetchall()
for camera_id, model, blob in rows:
    params = list(struct.unpack("<%dd" % (len(blob) // 8), blob))
    for i in focal[model]:
        params[i] *= float(sys.argv[3])
    db.execute("UPDATE cameras SET params = ?, prior_focal_length = ? WHERE "
               "camera_id = ?", (struct.pack("<%dd" % len(params), *params),
                                 int(sys.argv[4]), camera_id))
db.commit()
PY
}

# Cameras that are taken for 3 % longer than they are make turns too short.
drift() {
  simulate drift --preset standard --rig mono --num_frames 400 --path curve \
    --prior_sigma 0.5 --prior_outlier_ratio 0.1
  scale_focal_lengths "$output/drift/database.db" "$output/drift/wrong.db" \
    1.03 1
  map drift/without "$output/drift/wrong.db"
  map drift/with "$output/drift/wrong.db" --use_prior_position 1
  local case="GPS of 0.5 m, 10 % gross outliers; intrinsics 3 % wrong and held"
  local before after error
  before=$(evaluate drift/without --gt_path "$output/drift/truth")
  after=$(evaluate drift/with --gt_path "$output/drift/truth" --alignment none)
  error="'%.2f m' % e['position_m']['mean']"
  row "$case" "position, mean; with: not aligned" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
  row "the same" "outliers found; bent by" "-" "$(get "$(cat \
    "$output/drift/with/report.json")" \
    "'%d of %d; %s' % (len(e['models'][0]['position_priors']['outliers']), \
     e['models'][0]['position_priors']['num_given'], \
     '%.1f m' % e['models'][0]['position_priors']['bending']['largest_shift'] \
     if e['models'][0]['position_priors']['bending'] else 'nothing')")"
}

# without_frames FROM TO FIRST LAST: no pairs of these frames nor across them
without_frames() {
  [ -e "$2" ] || python3 - "$@" <<'PY'
import re, shutil, sqlite3, sys
shutil.copy(sys.argv[1], sys.argv[2])
db = sqlite3.connect(sys.argv[2])
first, last = int(sys.argv[3]), int(sys.argv[4])
frame = {i: int(re.search(r"(\d+)\.\w+$", name).group(1))
         for i, name in db.execute("SELECT image_id, name FROM images")}
for (pair,) in db.execute("SELECT pair_id FROM two_view_geometries").fetchall():
    a, b = sorted((frame[pair // 2147483647], frame[pair % 2147483647]))
    if b >= first and a <= last:
        db.execute("DELETE FROM two_view_geometries WHERE pair_id = ?", (pair,))
db.commit()
PY
}

gap() {
  simulate gap --preset standard --rig stereo --num_frames 120 --path curve \
    --prior_sigma 0.5 --prior_outlier_ratio 0.1
  without_frames "$output/gap/database.db" "$output/gap/parted.db" 55 64
  map gap/without "$output/gap/parted.db"
  map gap/with "$output/gap/parted.db" --use_prior_position 1
  local errors=() model
  for model in without/0 without/1 with/0 with/1; do
    "$mgsfm" model_evaluator --input_path "$output/gap/$model" \
      --gt_path "$output/gap/truth" --alignment none \
      --json "$output/gap/evaluation.json" >/dev/null
    errors+=("$(get "$(cat "$output/gap/evaluation.json")" \
      "'%.2f m' % e['position_m']['mean']")")
  done
  row "GPS of 0.5 m, 10 % gross outliers; a gap of 10 frames, two models" \
    "position, mean, of each, not aligned" \
    "${errors[0]}, ${errors[1]}" "${errors[2]}, ${errors[3]}"
}

gravity() {
  simulate gravity --preset standard --rig mono --num_frames 300 --path curve \
    --max_num_features 150 --num_matched_frames 3 --pixel_noise 2 \
    --gravity_sigma 0.5 --gravity_outlier_ratio 0.1
  map gravity/without "$output/gravity/database.db"
  map gravity/with "$output/gravity/database.db" \
    --gravity_path "$output/gravity/gravity.txt"
  local case="gravity of 0.5 deg, 10 % gross outliers; few and weak pairs"
  local before after error
  before=$(evaluate gravity/without --gt_path "$output/gravity/truth")
  after=$(evaluate gravity/with --gt_path "$output/gravity/truth")
  error="'%.2f deg' % e['rotation_deg']['mean']"
  row "$case" "rotation, mean" "$(get "$before" "$error")" \
    "$(get "$after" "$error")"
  row "the same" "outliers found" "-" "$(get "$(cat \
    "$output/gravity/with/report.json")" \
    "'%d of %d' % (len(e['models'][0]['gravity']['outliers']), \
     e['models'][0]['gravity']['num_given'])")"
}

covariances() {
  simulate covariance --preset street --pixel_noise 0.7 --rig stereo \
    --num_frames 40
  map covariance/map "$output/covariance/database.db" --compute_covariances 1
  local errors
  errors=$(evaluate covariance/map --gt_path "$output/covariance/truth")
  row "covariances, simulated stereo" "rotation in the rig: error, sigma" \
    "$(get "$errors" "'%.4f deg' % e['sensors'][0]['rotation_deg']")" \
    "$(get "$(cat "$output/covariance/map/report.json")" \
      "'%.4f deg' % (sum(x * x for s in e['models'][0]['rigs'][0]['sensors'] \
       if not s['is_reference'] for x in s['sigma']['turns_deg']) ** 0.5)")"
}

# Largest relative error of the focal lengths of a model, by its rig_config.json
focal_error() { # MODEL TRUTH...
  python3 - "$@" <<'PY'
import json, sys
truth = [float(x) for x in sys.argv[2:]]
cameras = json.load(open(sys.argv[1] + "/rig_config.json"))[0]["cameras"]
print("%.2f %%" % max(100 * abs(c["camera_params"][0] / f - 1)
                      for c, f in zip(cameras, truth)))
PY
}

focal_lengths() {
  simulate focal --preset standard --rig stereo --path loop --num_frames 60
  scale_focal_lengths "$output/focal/database.db" "$output/focal/wrong.db" 2 0
  map focal/without "$output/focal/wrong.db" --FocalLengths.calibrate 0
  map focal/with "$output/focal/wrong.db"
  local truth
  truth=$(python3 -c "
import json
print(*[c['camera_params'][0] for c in json.load(open(
    '$output/focal/truth/rig_config.json'))[0]['cameras']])")
  local case="focal lengths twice too long, not trusted, simulated loop"
  # shellcheck disable=SC2086
  row "$case" "focal length, worst, after bundle adjustment" \
    "$(focal_error "$output/focal/without/0" $truth)" \
    "$(focal_error "$output/focal/with/0" $truth)"
  local error="'%.3f m' % e['position_m']['mean']"
  row "$case" "position, mean" \
    "$(get "$(evaluate focal/without --gt_path "$output/focal/truth")" \
      "$error")" \
    "$(get "$(evaluate focal/with --gt_path "$output/focal/truth")" "$error")"
  local kitti=$data/kitti06_stereo
  [ -d "$kitti" ] || return 0
  scale_focal_lengths "$kitti/database.db" "$output/kitti_wrong.db" 1.2 0
  map kitti_focal_without "$output/kitti_wrong.db" --FocalLengths.calibrate 0
  map kitti_focal_with "$output/kitti_wrong.db"
  row "focal lengths 20 % wrong, not trusted, KITTI 06" \
    "focal length, worst, after bundle adjustment" \
    "$(focal_error "$output/kitti_focal_without/0" 707.0912 707.0912)" \
    "$(focal_error "$output/kitti_focal_with/0" 707.0912 707.0912)"
  row "the same" "what the report says" "nothing" \
    "$(get "$(cat "$output/kitti_focal_with/report.json")" \
      "e['focal_lengths'][0]['message'] or 'found'")"
  row "the same" "relative standard deviation after bundle adjustment" "-" \
    "$(get "$(cat "$output/kitti_focal_with/report.json")" \
      "'%.3f' % e['models'][0]['focal_lengths'][0]['relative_sigma']")"
}

panorama() {
  cat >"$output/panorama_rig.json" <<'JSON'
[{"cameras": [
  {"image_prefix": "cam0/", "ref_sensor": true,
   "camera_model_name": "PINHOLE", "camera_params": [400, 400, 320, 240]},
  {"image_prefix": "cam1/",
   "cam_from_rig_rotation": [0.866025404, 0, 0.5, 0],
   "cam_from_rig_translation": [0, 0, 0],
   "camera_model_name": "PINHOLE", "camera_params": [400, 400, 320, 240]},
  {"image_prefix": "cam2/",
   "cam_from_rig_rotation": [0.866025404, 0, -0.5, 0],
   "cam_from_rig_translation": [0, 0, 0],
   "camera_model_name": "EQUIRECTANGULAR", "camera_params": [1600, 800]}]}]
JSON
  simulate panorama --preset standard --num_frames 60 \
    --rig_config_path "$output/panorama_rig.json"
  map panorama/single "$output/panorama/database.db" --rig_name_rule none
  map panorama/rig "$output/panorama/database.db"
  local before after error
  before=$(evaluate panorama/single --gt_path "$output/panorama/truth" \
    --rig_name_rule none)
  after=$(evaluate panorama/rig --gt_path "$output/panorama/truth")
  error="'%.3f m, %d of %d' % (e['position_m']['mean'], e['num_registered'], \
   e['num_images'])"
  row "cameras that share a centre, one EQUIRECTANGULAR; without: no rig" \
    "position, mean; registered" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
}

# Two rigs of two cameras each; the second, wider and tilted, for the mapper's
# purposes drove by at another time. The poses are for simulate only.
two_rigs() { # FILE RIGS [POSES]
  python3 - "$@" <<'PY'
import json, math, sys
def turn(x, y):
    return [math.cos(x / 2) * math.cos(y / 2), math.sin(x / 2) * math.cos(y / 2),
            math.cos(x / 2) * math.sin(y / 2), math.sin(x / 2) * math.sin(y / 2)]
poses = [([1, 0, 0, 0], [0, 0, 0]), ([1, 0, 0, 0], [-0.54, 0, 0]),
         (turn(0.05, 0.1), [0.2, 0.3, 0.1]), (turn(0.05, 0.1), [-0.7, 0.3, 0.1])]
def camera(i, is_reference):
    c = {"image_prefix": "cam%d/" % i}
    if is_reference:
        c["ref_sensor"] = True
    elif len(sys.argv) > 3:
        c["cam_from_rig_rotation"], c["cam_from_rig_translation"] = poses[i]
    if len(sys.argv) > 3:
        f = 700 if i < 2 else 560
        c["camera_model_name"] = "PINHOLE"
        c["camera_params"] = [f, f, 620, 188]
    return c
rigs = {"all": [[0, 1, 2, 3]], "first": [[0, 1]], "both": [[0, 1], [2, 3]]}
json.dump([{"cameras": [camera(i, i == rig[0]) for i in rig]}
           for rig in rigs[sys.argv[2]]], open(sys.argv[1], "w"))
PY
}

# list_images DATABASE CONDITION: names for which Python finds it true
list_images() {
  python3 - "$1" "$2" <<'PY'
import re, sqlite3, sys
for (name,) in sqlite3.connect("file:%s?mode=ro" % sys.argv[1], uri=True).execute(
        "SELECT name FROM images ORDER BY name"):
    number = int(re.search(r"(\d+)\.\w+$", name).group(1))
    if eval(sys.argv[2]):
        print(name)
PY
}

going_on() {
  local rigs=$output/two_rigs
  two_rigs "$rigs.json" all poses
  two_rigs "$rigs.first.json" first
  two_rigs "$rigs.both.json" both
  simulate going_on --preset standard --num_frames 60 --rig_config_path \
    "$rigs.json"
  local database=$output/going_on/database.db
  list_images "$database" "name[:4] in ('cam0', 'cam1')" >"$rigs.txt"
  map going_on/first "$database" --image_list_path "$rigs.txt" \
    --rig_config_path "$rigs.first.json"
  map going_on/both "$database" --input_path "$output/going_on/first/0" \
    --rig_config_path "$rigs.both.json"
  map going_on/at_once "$database" --rig_config_path "$rigs.both.json"
  local before after error
  error="'%d of %d, %.3f m' % (e['num_registered'], e['num_images'], \
   e['position_m']['mean'])"
  before=$(evaluate going_on/first --gt_path "$output/going_on/truth")
  after=$(evaluate going_on/both --gt_path "$output/going_on/truth")
  row "a second rig joins the model of the first, simulated" \
    "registered; position, mean" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
  before=$(evaluate going_on/at_once --gt_path "$output/going_on/truth")
  row "the same; without: both mapped at once" "registered; position, mean" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
  row "the same" "baseline of the second rig, true 0.900 m" "-" \
    "$(second_baseline "$output/going_on/both/0" \
      "$(get "$after" "e['world_from_model']['scale']")")"
  local kitti=$data/kitti06_stereo
  [ -d "$kitti" ] || return 0
  list_images "$kitti/database.db" "number < 26" >"$output/kitti_half.txt"
  map kitti_half "$kitti/database.db" --image_list_path \
    "$output/kitti_half.txt"
  map kitti_going_on "$kitti/database.db" --input_path "$output/kitti_half/0"
  map kitti_unknown "$kitti/database.db"
  local truth=(--gt_path "$kitti/gt_poses.txt" --gt_format kitti
    --calib_path "$kitti/calib.txt")
  error="'%d of %d, %.4f m' % (e['num_registered'], e['num_images'], \
   e['position_m']['mean'])"
  before=$(evaluate kitti_half "${truth[@]}")
  after=$(evaluate kitti_going_on "${truth[@]}")
  row "KITTI 06 in two halves, the second added to the first" \
    "registered; position, mean" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
  before=$(evaluate kitti_unknown "${truth[@]}")
  row "the same; without: all mapped at once" "registered; position, mean" \
    "$(get "$before" "$error")" "$(get "$after" "$error")"
}

# second_baseline MODEL SCALE: of the second rig, in metres
second_baseline() {
  python3 - "$@" <<'PY'
import json, sys
cameras = json.load(open(sys.argv[1] + "/rig_config.json"))[1]["cameras"]
t = cameras[1]["cam_from_rig_translation"]
print("%.3f m" % (float(sys.argv[2]) * sum(x * x for x in t) ** 0.5))
PY
}

# Of images, against their own true poses.
image_errors() { # MAP DRIVE
  evaluate "$1" --gt_path "$output/$2/truth_images" --rig_name_rule none
}

loose_triggers() {
  local drive=(--preset standard --rig stereo --path curve --num_frames 80)
  local error="'%.3f m' % e['position_m']['mean']"
  local px="'%.3f px' % e['models'][0]['mean_reprojection_error_px']"
  local ms before after
  for ms in 20 50; do
    simulate "jitter_$ms" "${drive[@]}" --trigger_jitter "$ms"
    map "jitter_$ms/rigid" "$output/jitter_$ms/database.db"
    map "jitter_$ms/soft" "$output/jitter_$ms/database.db" \
      --LooseSynchronization.method soft
    before=$(image_errors "jitter_$ms/rigid" "jitter_$ms")
    after=$(image_errors "jitter_$ms/soft" "jitter_$ms")
    row "cameras release up to $ms ms early or late, at 10 m/s; with: soft" \
      "position of images, mean" "$(get "$before" "$error")" \
      "$(get "$after" "$error")"
    row "the same" "reprojection error, mean" \
      "$(get "$(cat "$output/jitter_$ms/rigid/report.json")" "$px")" \
      "$(get "$(cat "$output/jitter_$ms/soft/report.json")" "$px")"
  done
  simulate late "${drive[@]}" --trigger_offset 30
  map late/rigid "$output/late/database.db"
  map late/offset "$output/late/database.db" \
    --LooseSynchronization.method time_offset \
    --image_timestamps_path "$output/late/timestamps.txt"
  before=$(image_errors late/rigid late)
  after=$(image_errors late/offset late)
  row "one camera 30 ms late, at 10 m/s; with: time_offset" \
    "position of images, mean" "$(get "$before" "$error")" \
    "$(get "$after" "$error")"
  local sensor="e['models'][0]['loose_synchronization']['sensors'][1]"
  row "the same" "time offset, standard deviation" "none" \
    "$(get "$(cat "$output/late/offset/report.json")" \
      "'%.2f ms, %.2f ms' % (1e3 * $sensor['time_offset_s'], \
        1e3 * $sensor['time_offset_sigma_s'])")"
}

# On a processor with AVX2 and FMA, and as if it had neither.
portability() {
  simulate portable --preset standard --rig stereo --num_frames 60
  map portable/fast "$output/portable/database.db"
  MGSFM_PORTABLE=1 GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA \
    OPENBLAS_CORETYPE=PRESCOTT \
    map portable/portable "$output/portable/database.db"
  local errors
  errors=$(evaluate portable/portable --gt_path "$output/portable/fast/0" \
    --alignment none)
  row "the same database with and without AVX2 and FMA, path of $(get \
    "$errors" "'%.0f' % e['path_m']") units" \
    "difference of positions, of rotations, largest" "-" \
    "$(get "$errors" "'%.1e, %.1e deg' % (e['position_m']['max'], \
      e['rotation_deg']['max'])")"
}

echo "| case | measured | without | with |"
echo "|---|---|---|---|"
for case in "${cases[@]}"; do "$case"; done
