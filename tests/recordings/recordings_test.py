# SPDX-License-Identifier: BSD-3-Clause
"""What recorded rigs must give: images, models, warnings and errors.

Bounds state what the recording determines or what other programs reach on it,
not what a run of mgsfm gave. Image folders are used with fewer features than
by default, so that all tests take less than two minutes on two cores.
"""
import math
import re

import pytest

# When the cameras of nuscenes_0916 trigger after CAM_FRONT, by their labels.
NUSCENES_DELAYS_S = {
    "CAM_FRONT": 0.0, "CAM_FRONT_RIGHT": 0.0079, "CAM_BACK_RIGHT": 0.0154,
    "CAM_BACK": 0.0251, "CAM_BACK_LEFT": 0.0350, "CAM_FRONT_LEFT": -0.0076}
NUSCENES_INTERVAL_S = 0.5


def pixel_deg(focal_length_px):
    """The angle of a pixel at the center of an image."""
    return math.degrees(1.0 / focal_length_px)


def test_kitti_06(mgsfm, recording, evaluate, expect_whole, tmp_path):
    data = recording("kitti06_stereo")
    mgsfm("mapper", database_path=data / "database.db", output_path=tmp_path)
    expect_whole(tmp_path, 102)
    errors = evaluate(tmp_path / "0", gt_format="kitti",
                      gt_path=data / "gt_poses.txt",
                      calib_path=data / "calib.txt")
    # A third less than COLMAP 3.8 (0.0219 m), and its rotations, whose error
    # is that of the truth.
    assert round(errors["position_m"]["mean"], 4) <= 0.0142
    assert errors["rotation_deg"]["mean"] <= 0.299
    # The images are rectified, to about a pixel.
    assert errors["sensors"][0]["rotation_deg"] <= pixel_deg(707.1)


@pytest.fixture(name="standing", scope="module")
def fixture_standing(mgsfm, recording, tmp_path_factory):
    """The recording and the models of a drone that stands."""
    data = recording("euroc_v101_stereo")
    sparse = tmp_path_factory.mktemp("standing")
    mgsfm("mapper", database_path=data / "database.db", output_path=sparse)
    return data, sparse


def test_euroc_standing(standing, expect_whole):
    expect_whole(standing[1], 64)


def test_rig_of_euroc_standing(standing, evaluate):
    data, sparse = standing
    errors = evaluate(
        sparse / "0", gt_format="rig",
        calib_path=f"{data / 'sensor0.yaml'},{data / 'sensor1.yaml'}")
    assert errors["sensors"][0]["rotation_deg"] <= pixel_deg(457.6)


def test_euroc_key_frames_without_calibration(mgsfm, recording, evaluate,
                                              expect_whole, tmp_path):
    data = recording("euroc_v101_keyframes")
    mgsfm("automatic_reconstructor", image_path=data / "images",
          workspace_path=tmp_path, write_report=0,
          **{"SiftExtraction.max_num_features": 1000})
    report = expect_whole(tmp_path / "sparse", 200)
    calibrations = [data / "calib" / camera / "sensor.yaml"
                    for camera in ("cam0", "cam1")]
    # A quarter of the error of COLMAP 3.8, 2.8 %.
    lenses = report["models"][0]["lenses"]
    for calibration, estimate in zip(calibrations, lenses, strict=True):
        fx, fy = map(float, re.search(
            r"^intrinsics: \[([\d.]+), ([\d.]+),", calibration.read_text(),
            re.M).groups())
        truth = (fx + fy) / 2
        assert abs(estimate["focal_length_px"] / truth - 1) <= 0.007
    errors = evaluate(tmp_path / "sparse" / "0", gt_format="tum",
                      gt_path=data / "gt_cam0.tum", reference="cam0",
                      calib_path=",".join(map(str, calibrations)))
    assert errors["position_m"]["rmse"] <= 0.012
    assert errors["sensors"][0]["rotation_deg"] <= 1.0


def test_nuscenes_with_calibration(mgsfm, recording, evaluate, expect_whole,
                                   tmp_path):
    data = recording("nuscenes_0916")
    mgsfm("automatic_reconstructor", image_path=data / "images",
          calibration_path=data / "calib", workspace_path=tmp_path,
          write_report=0, **{"SiftExtraction.max_num_features": 1000,
                             "SiftExtraction.max_image_size": 800})
    report = expect_whole(tmp_path / "sparse", 246, ["unsynchronized"])
    delays = {c["camera"]: c
              for c in report["models"][0]["delays"]["cameras"]}
    reference, = NUSCENES_DELAYS_S.keys() - delays.keys()
    for camera, estimate in delays.items():
        truth = NUSCENES_DELAYS_S[camera] - NUSCENES_DELAYS_S[reference]
        error = estimate["delay"] - truth / NUSCENES_INTERVAL_S
        assert abs(error) <= 3 * estimate["sigma"]
    errors = evaluate(tmp_path / "sparse" / "0", gt_format="tum",
                      gt_path=data / "gt_CAM_FRONT.tum", reference="CAM_FRONT")
    # The frames are 2.3 m apart, and the cameras trigger at places that are up
    # to 0.2 m apart.
    assert errors["position_m"]["mean"] <= 0.26


def test_ring_of_consumer_cameras(mgsfm, recording, expect_whole, tmp_path):
    data = recording("infrascal_demo")
    mgsfm("mapper", database_path=data / "database.db", output_path=tmp_path)
    # One camera is some 40 ms late.
    expect_whole(tmp_path, 95, ["unsynchronized"])
