# SPDX-License-Identifier: BSD-3-Clause
"""Pages of real images and of many images. large_page.py measures speed."""

import os
import pathlib

import pytest

import models

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
NUM_FRAMES, NUM_SENSORS = 9000, 4
MAX_OPENING_S = 5.0


def shared_data(name):
    """As FindSharedData() of tests/support/shared_data.h."""
    folder = pathlib.Path(os.environ.get(
        "MGSFM_SHARED_DATA", REPOSITORY.parent / "shared" / "data")) / name
    if not folder.is_dir():
        pytest.skip(f"no {name}; see tests/support/shared_data.h")
    return folder


def test_kitti_06(tmp_path, mgsfm, report):
    data = shared_data("kitti06_stereo")
    mgsfm("mapper", database_path=data / "database.db",
          image_path=data / "images", output_path=tmp_path / "sparse",
          write_report=0)
    page, path = report(
        tmp_path / "sparse" / "0", database_path=data / "database.db",
        image_path=data / "images", gt_path=data / "gt_poses.txt",
        gt_format="kitti")
    assert path.stat().st_size < 3_000_000
    assert page.evaluate("mgsfmPage.data.numFrames") == 51
    assert "Errors against the ground truth" in page.evaluate(
        "document.body.innerText")
    page.evaluate("mgsfmPage.select({image: 60})")
    name = page.evaluate("mgsfmPage.data.imageNames[60]")
    assert name in page.evaluate("document.getElementById('details').innerText")
    page.wait_for("document.querySelector('#details img')?.naturalWidth > 0")
    assert page.complaints() == []


def test_36000_images(tmp_path, report):
    drive = models.make_drive(NUM_FRAMES, NUM_SENSORS, points_per_frame=5)
    page, path = report(models.write_model(drive, tmp_path / "0"))
    page.wait_for("Boolean(window.mgsfmPage)")
    assert path.stat().st_size < 10_000_000
    assert page.opening_s < MAX_OPENING_S
    assert page.evaluate("mgsfmPage.data.numImages") == len(drive.names)
    assert page.complaints() == []
