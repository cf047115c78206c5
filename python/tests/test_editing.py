# SPDX-License-Identifier: BSD-3-Clause
"""Models that are built, edited and moved: what is written is what was meant."""

import copy

import numpy as np
import pymgsfm
import pytest


@pytest.fixture
def edited(sparse):
    return pymgsfm.Reconstruction(sparse / "0")


def written(model, folder):
    model.write(folder)
    return pymgsfm.Reconstruction(folder)


def errors_of(model):
    """(point id, image id, keypoint) -> error, by projecting one by one."""
    errors = {}
    for point_id, point in model.points3D.items():
        for image_id, idx in point.track.elements:
            image = model.images[image_id]
            pixel = image.project_point(point.xyz)
            errors[point_id, image_id, idx] = (
                np.inf if pixel is None
                else np.linalg.norm(pixel - image.points2D[idx].xy))
    return errors


def build_rig_model():
    """Two frames of a stereo rig, and two points that all images observe."""
    model = pymgsfm.Reconstruction()
    rig = pymgsfm.Rig(1)
    for camera_id in (1, 2):
        model.add_camera(pymgsfm.Camera.create(camera_id, "PINHOLE", 500.0,
                                               1000, 800))
    rig.add_ref_sensor(model.cameras[1].sensor_id)
    rig.add_sensor(model.cameras[2].sensor_id,
                   pymgsfm.Rigid3d(None, [-1.0, 0.0, 0.0]))
    model.add_rig(rig)
    xyz = np.array([[0.5, 0.2, 5.0], [-0.5, 0.1, 6.0]])
    for frame_id in (1, 2):
        frame = pymgsfm.Frame(frame_id, rig_id=1)
        images = [pymgsfm.Image(f"{camera_id}/{frame_id}.jpg",
                                camera_id=camera_id,
                                image_id=10 * frame_id + camera_id)
                  for camera_id in (1, 2)]
        for image in images:
            frame.add_data_id(image.data_id)
        frame.rig_from_world = pymgsfm.Rigid3d(None, [0, 0, -0.5 * frame_id])
        model.add_frame(frame)
        for image in images:
            model.add_image(image)
            image.points2D = pymgsfm.Point2DList(
                [pymgsfm.Point2D(xy) for xy in image.project_point(xyz)])
    for k in range(2):
        model.add_point3D(xyz[k], pymgsfm.Track(
            pymgsfm.TrackElement(image_id, k) for image_id in model.images))
    return model


class TestBuilding:
    def test_a_rig_model_is_written(self, tmp_path):
        model = build_rig_model()
        again = written(model, tmp_path)
        assert (again.num_frames(), again.num_images()) == (2, 4)
        np.testing.assert_allclose(list(errors_of(again).values()), 0,
                                   atol=1e-4)  # pixels in single precision
        for image_id, image in model.images.items():
            assert again.images[image_id].name == image.name
            np.testing.assert_allclose(
                again.images[image_id].projection_center(),
                image.projection_center(), atol=1e-12)
            assert [p.point3D_id for p in again.images[image_id].points2D] == [
                p.point3D_id for p in image.points2D] == [1, 2]
        assert again.frames[1].data_ids == model.frames[1].data_ids

    def test_single_cameras_need_no_rig(self, tmp_path):
        model = pymgsfm.Reconstruction()
        model.add_camera_with_trivial_rig(pymgsfm.Camera.create(
            1, "PINHOLE", 500.0, 1000, 800))
        for i in (1, 2):
            model.add_image_with_trivial_frame(
                pymgsfm.Image(f"{i}.jpg", keypoints=[[500.0, 400.0]],
                              camera_id=1, image_id=i),
                pymgsfm.Rigid3d(None, [0, 0, float(i)]))
        model.add_point3D([0, 0, 1], [pymgsfm.TrackElement(1, 0),
                                      pymgsfm.TrackElement(2, 0)])
        model.update_point_3d_errors()
        assert model.points3D[1].error == pytest.approx(0)
        assert written(model, tmp_path).num_reg_images() == 2

    def test_mistakes_are_named(self):
        model = build_rig_model()
        for match, add in [
                ("no camera 9", lambda: model.add_rig(
                    pymgsfm.Rig(2, 9, {9: pymgsfm.Rigid3d()}))),
                ("no rig 5", lambda: model.add_frame(
                    pymgsfm.Frame(9, rig_id=5))),
                ("no frame has the image 99", lambda: model.add_image(
                    pymgsfm.Image("a.jpg", camera_id=1, image_id=99))),
                ("has a camera 1 already", lambda: model.add_camera(
                    pymgsfm.Camera.create(1, "PINHOLE", 1.0, 9, 9))),
                ("observes a point", lambda: model.add_point3D(
                    [0, 0, 1], [pymgsfm.TrackElement(11, 0)])),
                ("no keypoint 7", lambda: model.add_point3D(
                    [0, 0, 1], [pymgsfm.TrackElement(11, 7)])),
                ("wrong parameters", lambda: model.add_camera(
                    pymgsfm.Camera(3, "PINHOLE", 9, 9, [1.0]))),
                ("has an image of camera 1", lambda: model.add_image(
                    pymgsfm.Image("a.jpg", camera_id=1, image_id=99,
                                  frame_id=1))),
                ("no reference sensor", lambda: model.add_rig(
                    pymgsfm.Rig(3)))]:
            with pytest.raises(pymgsfm.InputError, match=match):
                add()
        with pytest.raises(pymgsfm.InputError, match="add_observation"):
            model.points3D[1].track.add_element(11, 0)
        model.check()


class TestEditing:
    def test_points_and_observations(self, edited, tmp_path):
        ids = edited.point3D_ids()
        deleted = edited.points3D[ids[0]].track.elements
        edited.delete_point3D(ids[0])
        long_id = next(i for i in ids[1:]
                       if edited.points3D[i].track.length() > 3)
        image_id, idx = edited.points3D[long_id].track.elements[1]
        length = edited.points3D[long_id].track.length()
        edited.delete_observation(image_id, idx)
        new_id = edited.add_point3D([1, 2, 3], deleted, [4, 5, 6])
        edited.add_observation(new_id, pymgsfm.TrackElement(image_id, idx))
        assert new_id == ids[-1] + 1 and edited.num_points3D() == len(ids)
        assert edited.points3D[long_id].track.length() == length - 1
        edited.check()
        again = written(edited, tmp_path)
        last = again.points3D[len(ids)]
        assert list(last.xyz) == [1, 2, 3] and list(last.color) == [4, 5, 6]
        assert set(last.track.elements) == {*deleted, (image_id, idx)}
        assert again.compute_num_observations() == (
            edited.compute_num_observations())
        with pytest.raises(KeyError):
            edited.points3D[ids[0]]

    def test_no_edit_is_lost(self, edited):
        ids, xyz = edited.point3D_ids(), edited.points3D.xyz
        point = edited.points3D[ids[5]]
        edited.delete_point3D(ids[0])
        point.xyz[:] = (7.0, 8.0, 9.0)
        assert list(edited.points3D.xyz[4]) == [7.0, 8.0, 9.0]
        with pytest.raises(ValueError, match="read-only"):
            xyz[:] += 1.0
        own = pymgsfm.Point3D([1, 2, 3])
        own.track.add_element(1, 2)
        assert own.track.elements == [(1, 2)]
        with pytest.raises(pymgsfm.InputError, match="add_observation"):
            point.track = own.track

    def test_edits_are_those_of_a_dict(self, edited):
        """Random edits, against tracks in a dict."""
        random = np.random.default_rng(5)
        tracks = {i: set(edited.points3D[i].track.elements)
                  for i in edited.points3D}
        for step in range(200):
            point_id = int(random.choice(list(tracks)))
            kind = step % 4
            if kind == 0:
                edited.delete_point3D(point_id)
                del tracks[point_id]
            elif kind == 1:
                image_id, idx = sorted(tracks[point_id])[0]
                edited.delete_observation(image_id, idx)
                tracks[point_id].remove((image_id, idx))
                if len(tracks[point_id]) < 2:
                    del tracks[point_id]
            elif kind == 2:
                other = int(random.choice(list(tracks)))
                if other != point_id:
                    merged = edited.merge_points3D(point_id, other)
                    tracks[merged] = tracks.pop(point_id) | tracks.pop(other)
            else:
                xyz = random.normal(size=3)
                edited.points3D[point_id].xyz = xyz
                assert (edited.points3D.xyz[np.searchsorted(
                    edited.points3D.ids, point_id)] == xyz).all()
        assert {i: set(p.track.elements) for i, p in edited.points3D.items()
                } == tracks
        assert len(edited.points3D) == len(tracks)
        edited.check()

    def test_a_deregistered_frame_is_gone(self, edited, tmp_path):
        frame_id = edited.reg_frame_ids()[3]
        image_ids = edited.frames[frame_id].image_ids
        num_frames = edited.num_reg_frames()
        edited.deregister_frame(frame_id)
        assert not any(edited.is_image_registered(i) for i in image_ids)
        assert edited.num_reg_frames() == num_frames - 1
        again = written(edited, tmp_path)
        assert frame_id not in again.frames
        assert not set(image_ids) & set(again.images)
        assert all(p.track.length() >= 2 for p in again.points3D.values())
        assert again.num_points3D() == edited.num_points3D()

    def test_contradictions_are_refused(self, edited, tmp_path):
        image = next(iter(edited.images.values()))
        idx = image.get_observation_point2D_idxs()[0]
        image.points2D.point3D_ids[idx] = pymgsfm.INVALID_POINT3D_ID
        with pytest.raises(pymgsfm.InputError,
                           match=f"keypoint {idx} of image '{image.name}'"):
            edited.write(tmp_path / "model")
        for match, spoil in [
                ("observes points without a pose",
                 lambda model: model.frames[2].reset_pose()),
                ("observes points without a pose",
                 lambda model: model.rigs[1].sensors.update({2: None})),
                ("must be the identity", lambda model: model.rigs[1].sensors
                 .update({1: model.rigs[1].sensors[2]})),
                ("no image 11", lambda model: model.images.pop(11)),
                ("lacks a keypoint", lambda model: setattr(
                    model.images[11], "points2D", np.ones((1, 2)))),
                ("no rig 5|lacks", lambda model: setattr(
                    model.frames[1], "rig", pymgsfm.Rig(5)))]:
            model = build_rig_model()
            spoil(model)
            with pytest.raises(pymgsfm.InputError, match=match):
                model.write(tmp_path / "model")
        assert not (tmp_path / "model").exists()


class TestFilters:
    def test_filter_all_points(self, edited):
        before = errors_of(edited)
        limit = np.quantile(list(before.values()), 0.9)
        num = edited.compute_num_observations()
        num_filtered = pymgsfm.ObservationManager(edited).filter_all_points3D(
            limit, 2.0)
        after = errors_of(edited)
        assert num - num_filtered == len(after) == (
            edited.compute_num_observations())
        assert set(after) < set(before) and max(after.values()) <= limit
        for point_id, point in edited.points3D.items():
            rays = np.array([edited.images[i].projection_center() - point.xyz
                             for i, _ in point.track.elements])
            rays /= np.linalg.norm(rays, axis=1)[:, None]
            assert np.rad2deg(np.arccos((rays @ rays.T).min())) >= 2.0 - 1e-6
            assert point.error == pytest.approx(np.mean(
                [after[point_id, i, k] for i, k in point.track.elements]))
        edited.check()

    def test_filter_some_points(self, edited):
        ids = edited.point3D_ids()
        assert edited.filter_points3D(0.0, 0.0, ids[:5]) > 0
        assert edited.point3D_ids() == ids[5:]
        image_id, image = next(iter(edited.images.items()))
        edited.filter_points3D_in_images(0.0, 0.0, [image_id])
        assert image.num_points3D == 0 < edited.num_points3D()
        edited.check()

    def test_points_behind_cameras(self, edited):
        point = edited.points3D[edited.point3D_ids()[0]]
        length = point.track.length()
        image = edited.images[point.track.elements[0].image_id]
        point.xyz = (image.projection_center()
                     - 100.0 * image.viewing_direction())
        errors = edited.observation_errors()
        num_behind = np.isinf(errors).sum()
        assert 1 <= num_behind <= length
        num = edited.filter_observations_with_negative_depth()
        assert num_behind <= num <= length

    def test_frames_without_points(self, edited):
        frame = next(iter(edited.frames.values()))
        for image_id in frame.image_ids:
            image = edited.images[image_id]
            for idx in image.get_observation_point2D_idxs():
                edited.delete_observation(image_id, idx)
        assert edited.filter_frames(0.1, 10.0, 1.0) == [frame.frame_id]
        assert edited.filter_frames(5.0, 10.0, 1.0) == list(edited.frames)[1:]


class TestMoving:
    def test_a_moved_model_has_the_same_errors(self, edited, tmp_path):
        errors = edited.observation_errors()
        new_from_old = pymgsfm.Sim3d(2.0, [0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
        center = next(iter(edited.images.values())).projection_center()
        edited.transform(new_from_old)
        np.testing.assert_allclose(edited.observation_errors(), errors,
                                   atol=1e-9)
        again = written(edited, tmp_path)
        np.testing.assert_allclose(
            next(iter(again.images.values())).projection_center(),
            new_from_old * center)

    def test_normalize(self, edited):
        errors = edited.observation_errors()
        image = next(iter(edited.images.values()))
        center = image.projection_center()
        new_from_old = edited.normalize(extent=7.0)
        np.testing.assert_allclose(image.projection_center(),
                                   new_from_old * center)
        np.testing.assert_allclose(edited.observation_errors(), errors,
                                   atol=1e-9)
        box = edited.compute_bounding_box(0.1, 0.9, use_images=True)
        assert np.linalg.norm(box.diagonal()) == pytest.approx(7.0)
        np.testing.assert_allclose(
            edited.compute_centroid(0.1, 0.9, use_images=True), 0, atol=1e-9)

    def test_crop(self, edited):
        low, high = edited.compute_bounding_box(0.2, 0.8)
        cropped = edited.crop((low, high))
        inside = [i for i, p in edited.points3D.items()
                  if (p.xyz >= low).all() and (p.xyz <= high).all()]
        assert cropped.point3D_ids() == inside
        assert all(any(cropped.images[i].num_points3D for i in f.image_ids)
                   for f in cropped.frames.values())
        assert edited.num_points3D() > len(inside)  # the model is as before
        cropped.check()
        edited.check()

    def test_copies_are_independent(self, edited):
        other = copy.deepcopy(edited)
        other.points3D.xyz[:] += 1.0
        other.delete_point3D(other.point3D_ids()[0])
        frame_id = next(iter(other.frames))
        other.frames[frame_id].rig_from_world.translation[:] += 1.0
        assert other.num_points3D() == edited.num_points3D() - 1
        assert not np.allclose(other.points3D.xyz[0], edited.points3D.xyz[1])
        assert (other.frames[frame_id].rig_from_world
                != edited.frames[frame_id].rig_from_world)


class TestAdjustment:
    def test_the_given_model_is_adjusted(self, edited):
        image = next(iter(edited.images.values()))
        frame = edited.frames[image.frame_id]
        edited.delete_point3D(edited.point3D_ids()[0])  # ids have a gap
        ids, points = edited.point3D_ids(), edited.points3D
        track = points[ids[3]].track.elements
        error = np.mean(edited.observation_errors())
        for other in list(edited.frames.values())[1:]:
            other.rig_from_world.translation[:] += 0.01
        disturbed = np.mean(edited.observation_errors())
        assert pymgsfm.bundle_adjustment(edited) is edited
        assert edited.images[image.image_id] is image
        assert edited.frames[image.frame_id] is frame
        assert edited.point3D_ids() == ids
        assert points[ids[3]].track.elements == track
        adjusted = np.mean(edited.observation_errors())
        assert adjusted < 1.1 * error < disturbed
        edited.check()

    def test_a_retriangulated_model_is_consistent(self, edited, tmp_path):
        pymgsfm.bundle_adjustment(edited, {"retriangulate": True})
        edited.check()
        assert written(edited, tmp_path).num_points3D() == (
            edited.num_points3D())

    def test_options_by_group(self, edited):
        options = pymgsfm.BundleAdjustmentOptions(max_num_iterations=1)
        pymgsfm.bundle_adjustment(edited, options)
        with pytest.raises(pymgsfm.InputError, match="use_gpu"):
            pymgsfm.BundleAdjustmentOptions(use_gpu=True)

    def test_tools_take_models(self, edited, tmp_path):
        edited.delete_point3D(edited.point3D_ids()[0])
        assert str(edited.num_points3D()) in pymgsfm.analyze_model(edited)
        edited.export_PLY(tmp_path / "points.ply")
        assert f"element vertex {edited.num_points3D()}".encode() in (
            tmp_path / "points.ply").read_bytes()
