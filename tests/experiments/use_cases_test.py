# SPDX-License-Identifier: BSD-3-Clause
"""Use cases: rigs that are written, and two short cases."""
import json
import math
import re

import pytest

from experiments import poses
from experiments.use_cases import calibration, priors, rigs, soft_rig, study
from experiments.use_cases.workbench import Workbench


def test_two_rigs_of_unit_quaternions(tmp_path):
    path = tmp_path / "rigs.json"
    rigs.write_two_rigs(path, "all", with_poses=True)
    (rig,) = json.loads(path.read_text())
    assert len(rig["cameras"]) == 4
    assert rig["cameras"][0]["ref_sensor"]
    for camera in rig["cameras"][1:]:
        assert math.hypot(*camera["cam_from_rig_rotation"]) == pytest.approx(1)
    rigs.write_two_rigs(path, "both", with_poses=False)
    first, second = json.loads(path.read_text())
    assert [c["image_prefix"] for c in second["cameras"]] == ["cam2/", "cam3/"]
    assert "camera_params" not in first["cameras"][0]


def test_the_second_baseline_of_the_simulated_rig(tmp_path):
    # Camera 3 in camera 2: both have the same rotation in the rig.
    rigs.write_two_rigs(tmp_path / "all.json", "all", with_poses=True)
    (rig,) = json.loads((tmp_path / "all.json").read_text())
    one, two = (c["cam_from_rig_translation"] for c in rig["cameras"][2:])
    (tmp_path / "rig_config.json").write_text(json.dumps([{}, {"cameras": [
        {}, {"cam_from_rig_translation": [b - a for a, b in zip(one, two)]}]}]))
    assert rigs.second_baseline(tmp_path, 1.0) == "0.900 m"
    assert rigs.second_baseline(tmp_path, 2.0) == "1.800 m"


def test_rig_of_two_poses_in_a_body(tmp_path):
    # Camera 0 is turned by 0.3 about z, camera 1 shifted.
    c, s = math.cos(0.3), math.sin(0.3)
    for k, rows in enumerate(([c, -s, 0, 1, s, c, 0, 2, 0, 0, 1, 3],
                              [1, 0, 0, 4, 0, 1, 0, 5, 0, 0, 1, 6])):
        (tmp_path / f"sensor{k}.yaml").write_text(
            f"T_BS:\n  data: [{', '.join(map(str, rows))}, 0, 0, 0, 1]\n")
    rigs.write_euroc_rig(tmp_path / "rig.json", tmp_path)
    (rig,) = json.loads((tmp_path / "rig.json").read_text())
    camera = rig["cameras"][1]
    assert camera["cam_from_rig_rotation"] == pytest.approx(
        [math.cos(0.15), 0, 0, math.sin(0.15)])
    assert camera["cam_from_rig_translation"] == pytest.approx([-3, -3, -3])
    # The center of camera 1 in camera 0.
    assert poses.camera_center(
        camera["cam_from_rig_rotation"], camera["cam_from_rig_translation"]
    ) == pytest.approx((3 * c + 3 * s, 3 * c - 3 * s, 3))


def test_the_worst_focal_length(tmp_path):
    (tmp_path / "rig_config.json").write_text(json.dumps([{"cameras": [
        {"camera_params": [101.0, 100.0]}, {"camera_params": [190.0]}]}]))
    assert calibration.worst_focal(tmp_path, (100.0, 200.0)) == "5.00 %"


def test_two_cases_with_reuse(run_experiments, program, tmp_path):
    call = ("use_cases", "covariances", "portability", "--program", program,
            "--data", tmp_path / "nothing", "--output", tmp_path / "out")
    out = run_experiments(*call)
    header, line, covariance, portable = out.splitlines()
    assert header == "| case | measured | without | with |"
    assert {text.count("|") for text in (line, covariance, portable)} == {5}
    error, sigma = (float(cell.split()[0])
                    for cell in covariance.split("|")[3:5])
    # An error far beyond three standard deviations, or no error at all, would
    # mean that the report or the evaluation was misread.
    assert 0.0 < sigma < 0.1
    assert 0.0 < error < 5.0 * sigma
    largest = portable.split("|")[4].split(",")[0]
    assert float(largest) < 1e-6
    assert run_experiments(*call) == out


def test_what_reports_say_of_priors(program, tmp_path):
    bench = Workbench(program, tmp_path, tmp_path)
    drive = bench.simulate(
        "short", "--preset", "standard", "--rig", "mono", "--num_frames", "30",
        "--prior_sigma", "0.5", "--gravity_sigma", "0.5")
    priors.map_both(bench, "short", drive / "database.db",
                    *priors.USE_POSITIONS, "--gravity_path",
                    drive / "gravity.txt")
    found = priors.positions_of(bench, "short")
    assert priors.outliers(found) == "0 of 30"
    assert re.fullmatch(r"none|\d+\.\d m", priors.largest_shift(found))
    gravity = bench.report("short/with")["models"][0]["gravity"]
    assert priors.outliers(gravity) == "0 of 30"
    without, with_ = priors.position_errors(bench, "short")
    assert float(without.split()[0]) < 0.5
    assert float(with_.split()[0]) < 1.0


def test_what_reports_say_of_a_late_camera(program, tmp_path):
    bench = Workbench(program, tmp_path, tmp_path)
    drive = bench.simulate("late", *soft_rig.DRIVE[:-1], "20",
                           "--trigger_offset", "30")
    bench.map("late/offset", drive / "database.db",
              "--SoftRig.method", "time_offset",
              "--image_timestamps_path", drive / "timestamps.txt")
    found, sigma = (float(cell.split()[0]) for cell in soft_rig.offset(
        bench.report("late/offset")).split(","))
    assert found == pytest.approx(30.0, abs=5.0)
    assert 0.0 < sigma < 5.0


def test_all_cases_are_offered(run_experiments):
    text = run_experiments("use_cases", "--help")
    for case in study.CASES:
        assert case in text
