# SPDX-License-Identifier: BSD-3-Clause
"""Databases that Python writes and reads, against SQL and the program."""

import shutil
import sqlite3

import numpy as np
import pymgsfm
import pytest
from pymgsfm import Database


@pytest.fixture
def configured(drive, tmp_path):
    """The database of the drive, with rigs and frames."""
    shutil.copy(drive / "database.db", tmp_path / "configured.db")
    pymgsfm.configure_rigs(tmp_path / "configured.db")
    return tmp_path / "configured.db"


def test_what_the_program_wrote(configured):
    sql = sqlite3.connect(configured)

    def count(query):
        return sql.execute(query).fetchone()[0]

    with Database.open(configured, read_only=True) as database:
        assert database.num_cameras() == count("SELECT COUNT(*) FROM cameras")
        assert database.num_images() == count("SELECT COUNT(*) FROM images")
        assert database.num_keypoints() == count(
            "SELECT SUM(rows) FROM keypoints")
        assert database.num_matches() == count("SELECT SUM(rows) FROM matches")
        assert database.num_inlier_matches() == count(
            "SELECT SUM(rows) FROM two_view_geometries")
        assert database.num_rigs() == count("SELECT COUNT(*) FROM rigs")
        assert database.num_frames() == count("SELECT COUNT(*) FROM frames")
        for image in database.read_all_images():
            rows, cols, data = sql.execute(
                "SELECT rows, cols, data FROM keypoints WHERE image_id = ?",
                (image.image_id,)).fetchone()
            np.testing.assert_array_equal(
                database.read_keypoints(image.image_id)[:, :2],
                np.frombuffer(data, np.float32).reshape(rows, cols)[:, :2])
            assert database.read_image_with_name(image.name).image_id == (
                image.image_id)
        pair_ids, matches = database.read_all_matches()
        for pair_id, rows in zip(pair_ids, matches):
            (data,) = sql.execute("SELECT data FROM matches WHERE pair_id = ?",
                                  (pair_id,)).fetchone()
            np.testing.assert_array_equal(
                rows, np.frombuffer(data, np.uint32).reshape(-1, 2))
            one, two = pymgsfm.pair_id_to_image_pair(pair_id)
            assert pymgsfm.image_pair_to_pair_id(two, one) == pair_id
            np.testing.assert_array_equal(database.read_matches(two, one),
                                          rows[:, ::-1])
        ids, counts = database.read_two_view_geometry_num_inliers()
        geometries = dict(zip(*database.read_two_view_geometries()))
        assert {i: len(g.inlier_matches) for i, g in geometries.items()
                } == dict(zip(ids, counts))
        for frame in database.read_all_frames():
            rig = database.read_rig(frame.rig_id)
            for data_id in frame.data_ids:
                assert rig.has_sensor(data_id.sensor_id)
                assert database.read_image(data_id.id).camera_id == (
                    data_id.sensor_id.id)


def copy_rows(source, target):
    """Everything that the mapper reads, in pycolmap's dialect."""
    with pymgsfm.DatabaseTransaction(target):
        for camera in source.read_all_cameras():
            target.write_camera(camera, use_camera_id=True)
        for rig in source.read_all_rigs():
            target.write_rig(rig, use_rig_id=True)
        for image in source.read_all_images():
            target.write_image(image, use_image_id=True)
            target.write_keypoints(image.image_id,
                                   source.read_keypoints(image.image_id))
        for frame in source.read_all_frames():
            target.write_frame(frame, use_frame_id=True)
        for pair_id, matches in zip(*source.read_all_matches()):
            target.write_matches(*pymgsfm.pair_id_to_image_pair(pair_id),
                                 matches)
        for pair_id, geometry in zip(*source.read_two_view_geometries()):
            target.write_two_view_geometry(
                *pymgsfm.pair_id_to_image_pair(pair_id), geometry)


def test_a_copied_database_gives_the_same_model(configured, tmp_path):
    with Database.open(configured, read_only=True) as source, (
            Database.open(tmp_path / "copy.db")) as target:
        copy_rows(source, target)
    for name in ("copy", "configured"):
        pymgsfm.global_mapping(tmp_path / f"{name}.db", None, tmp_path / name)
    for name in ("cameras", "rigs", "frames", "images", "points3D"):
        assert ((tmp_path / "copy" / "0" / f"{name}.bin").read_bytes()
                == (tmp_path / "configured" / "0" / f"{name}.bin").read_bytes()
                ), name


@pytest.fixture
def small(tmp_path):
    """A database with one camera and two images."""
    with Database.open(tmp_path / "small.db") as database:
        camera_id = database.write_camera(pymgsfm.Camera.create(
            9, "PINHOLE", 500.0, 100, 80))
        for name in ("a.jpg", "b.jpg"):
            database.write_image(pymgsfm.Image(name, camera_id=camera_id))
        yield database


def test_features_and_matches(small):
    points = np.array([[1.5, 2.5], [3.0, 4.0]], dtype=np.float32)
    small.write_keypoints(1, points)
    np.testing.assert_array_equal(small.read_keypoints(1), np.column_stack(
        [points, [[1, 0, 0, 1]] * 2]))
    small.write_keypoints(2, np.column_stack([points, [2.0, 3.0], [0.0, 0.5]]))
    shape = small.read_keypoints(2)[:, 2:].reshape(2, 2, 2)
    np.testing.assert_allclose(np.linalg.norm(shape[1], axis=0), [3.0, 3.0],
                               rtol=1e-6)
    assert np.arctan2(shape[1, 1, 0], shape[1, 0, 0]) == pytest.approx(0.5)
    descriptors = np.arange(256, dtype=np.uint8).reshape(2, 128)
    small.write_descriptors(1, descriptors)
    np.testing.assert_array_equal(small.read_descriptors(1), descriptors)
    assert small.exists_keypoints(1) and small.exists_descriptors(1)
    assert not small.exists_descriptors(2)
    small.write_matches(2, 1, [[0, 1]])
    np.testing.assert_array_equal(small.read_matches(1, 2), [[1, 0]])
    assert small.exists_matches(1, 2) and small.num_matched_image_pairs() == 1
    geometry = pymgsfm.TwoViewGeometry(
        pymgsfm.TwoViewGeometryConfiguration.CALIBRATED, E=np.diag([1, 1, 0.0]),
        cam2_from_cam1=pymgsfm.Rigid3d([0.1, 0, 0], [1.0, 0, 0]),
        inlier_matches=[[1, 0]])
    small.write_two_view_geometry(1, 2, geometry)
    read = small.read_two_view_geometry(2, 1)
    read.invert()
    assert read.config == geometry.config and read.F is None
    np.testing.assert_allclose(read.E, geometry.E)
    np.testing.assert_allclose(read.cam2_from_cam1.matrix(),
                               geometry.cam2_from_cam1.matrix(), atol=1e-12)
    np.testing.assert_array_equal(read.inlier_matches, [[1, 0]])
    small.clear_matches()
    small.clear_two_view_geometries()
    assert small.num_matches() == small.num_verified_image_pairs() == 0
    assert small.read_two_view_geometry(1, 2).inlier_matches.shape == (0, 2)


def test_pose_priors(small):
    prior = pymgsfm.PosePrior(
        [48.0, 11.0, 500.0], np.diag([1.0, 2.0, 3.0]),
        pymgsfm.PosePriorCoordinateSystem.WGS84, gravity=[0.0, 1.0, 0.0])
    prior.corr_data_id = small.read_image(2).data_id
    small.write_pose_prior(prior)
    small.write_pose_prior(1, pymgsfm.PosePrior([1.0, 2.0, 3.0]))
    read = small.read_pose_prior(2)
    assert small.num_pose_priors() == 2
    for name in ("position", "position_covariance", "gravity",
                 "coordinate_system", "image_id"):
        np.testing.assert_array_equal(getattr(read, name), getattr(prior, name))
    assert not small.read_pose_prior(1).is_covariance_valid()


def test_cameras_are_updated(small):
    camera = small.read_camera(1)
    camera.params[0] = 123.0
    camera.has_prior_focal_length = True
    assert small.read_camera(1).params[0] == 500.0
    small.update_camera(camera)
    small.close()


def test_mistakes_are_named(small, tmp_path):
    for match, write in [
            ("no image 7", lambda: small.write_keypoints(7, np.ones((1, 2)))),
            ("has an image 'a.jpg'", lambda: small.write_image(
                pymgsfm.Image("a.jpg", camera_id=1))),
            ("no camera 5", lambda: small.write_image(
                pymgsfm.Image("c.jpg", camera_id=5))),
            ("has a camera 1", lambda: small.write_camera(
                pymgsfm.Camera.create(1, "PINHOLE", 1.0, 2, 2), True)),
            (r"the id 4294967295", lambda: small.write_image(
                pymgsfm.Image("c.jpg", camera_id=1), True)),
            ("no camera 3", lambda: small.read_camera(3)),
            ("no rig 4", lambda: small.write_frame(
                pymgsfm.Frame(1, rig_id=4))),
            ("shape", lambda: small.write_keypoints(1, np.ones((1, 3))))]:
        with pytest.raises(pymgsfm.InputError, match=match):
            write()
    small.close()
    with pytest.raises(pymgsfm.InputError, match="is closed"):
        small.num_keypoints()
    with Database(tmp_path / "small.db", read_only=True) as database:
        with pytest.raises(pymgsfm.InputError, match="read-only"):
            database.write_keypoints(1, np.ones((1, 2)))


def test_a_failed_transaction_writes_nothing(small):
    with pytest.raises(RuntimeError, match="stop"):
        with pymgsfm.DatabaseTransaction(small):
            small.write_image(pymgsfm.Image("c.jpg", camera_id=1))
            rig = pymgsfm.Rig()
            rig.add_ref_sensor(1)
            small.write_rig(rig)
            raise RuntimeError("stop")
    assert small.num_images() == 2 and small.num_rigs() == 0
    small.write_image(pymgsfm.Image("d.jpg", camera_id=1))
    assert small.read_image(3).name == "d.jpg"


def test_two_writers_are_refused(small, tmp_path):
    with pytest.raises(pymgsfm.InputError, match="in use|locked"):
        pymgsfm.clean_database(tmp_path / "small.db", "matches")
