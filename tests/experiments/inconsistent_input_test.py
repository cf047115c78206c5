# SPDX-License-Identifier: BSD-3-Clause
"""Cases of inconsistent input."""
import math
import sqlite3

import pytest

from experiments.studies import inconsistent_input as study


@pytest.fixture(name="images")
def make_images():
    """A table of five stereo images."""
    connection = sqlite3.connect(":memory:")
    connection.execute("CREATE TABLE images (image_id INTEGER, name TEXT)")
    for camera in (0, 1):
        for frame in range(5):
            connection.execute(
                "INSERT INTO images VALUES (?, ?)",
                (10 * camera + frame, f"cam{camera}/{frame:06d}.png"))
    return connection


def test_a_lag_moves_the_names_of_one_camera(images):
    study.lag(2)(images)
    names = study.images_of(images)
    assert [names[i] for i in range(5)] == [
        f"cam0/{i:06d}.png" for i in range(5)]
    assert [names[i] for i in (10, 11, 12)] == [
        f"cam1/{i:06d}.png" for i in (2, 3, 4)]
    assert len(set(names.values())) == 10


def test_swapped_cameras_keep_the_first_half(images):
    study.swap(images)
    names = study.images_of(images)
    assert names[1] == "cam0/000001.png"
    assert names[3] == "cam1/000003.png" and names[13] == "cam0/000003.png"


def test_a_turn_moves_the_principal_point():
    camera = (800, 600, (500.0, 500.0, 400.0, 300.0))
    x, y = study.turn(5)(camera, 400.0, 300.0)
    assert x == pytest.approx(400.0 + 500.0 * math.tan(math.radians(5)))
    assert y == pytest.approx(300.0)


def test_verdicts():
    case = study.Case("", study.nothing, ("camera_lag",))
    named = [{"cause": "camera_lag"}]
    other = [{"cause": "rig_moved"}]
    assert study.judge(case, named, None) == "named"
    assert study.judge(case, named + other, None) == "named, and others"
    assert study.judge(case, [], (0.01, 0.01)) == "correct"
    assert study.judge(case, [], (1.0, 0.01)) == "SILENT"
    assert study.judge(case, other, None) == "OTHER CAUSE"
    assert study.judge(study.HEALTHY, [], None) == "no warning"
    assert study.judge(study.HEALTHY, other, None) == "FALSE ALARM"
