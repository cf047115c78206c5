# SPDX-License-Identifier: BSD-3-Clause
"""The viewers of examples/ with stand-ins of viser and rerun, which record the
calls and check arguments as the documentation of these packages states them.
"""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymgsfm import Camera, Rigid3d, Rotation3d

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def load(name, monkeypatch, package, stand_in):
    monkeypatch.setitem(sys.modules, package, stand_in)
    path = EXAMPLES / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def image_path(model, tmp_path):
    """A folder with the images of the model, which are gray."""
    pil = pytest.importorskip("PIL.Image")
    for image in model.images.values():
        path = tmp_path / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        size = image.camera.width // 8, image.camera.height // 8
        pil.new("L", size, 200).save(path)
    return str(tmp_path)


# 90 degrees, and 180 degrees along the sides.
PINHOLE = Camera.create(1, "PINHOLE", 200.0, 400, 400)
FISHEYE = Camera.create(2, "OPENCV_FISHEYE", 400 / np.pi, 400, 400)


def assert_projects(model, image, cam_from_world):
    """The pose has the axes of OpenCV: x right, y down, z forward."""
    points = image.get_observation_points2D()
    xyz = np.array([model.points3D[p.point3D_id].xyz for p in points])
    pixels = image.camera.img_from_cam(cam_from_world * xyz)
    assert np.median(np.linalg.norm(pixels - points.xy, axis=1)) < 2.0


class Scene:
    """viser.SceneApi: poses are parent_from_child with quaternions w, x, y, z;
    fov is vertical, in radians."""

    def __init__(self):
        self.nodes = {}

    def set_up_direction(self, direction):
        self.up = np.array(direction)
        assert self.up.shape == (3,)

    def add_point_cloud(self, name, points, colors, *, point_size, precision):
        assert precision == "float32"  # the default has 11 bits
        assert points.shape == colors.shape == (len(points), 3)
        assert colors.dtype == np.uint8 and point_size > 0
        self.nodes[name] = len(points)

    def add_line_segments(self, name, points, colors):
        assert points.shape == (len(points), 2, 3) and len(colors) == 3
        self.nodes[name] = points

    def add_frame(self, name, *, axes_length, axes_radius, wxyz, position):
        assert 0 < axes_radius < axes_length
        self.nodes[name] = self.pose(wxyz, position)

    def add_camera_frustum(self, name, fov, aspect, *, scale, image, wxyz,
                           position):
        assert 0 < fov <= 2.0 and aspect > 0 and scale > 0
        if image is not None:
            assert image.dtype == np.uint8 and image.shape[2:] == (3,)
        self.nodes[name] = self.pose(wxyz, position), fov, image

    @staticmethod
    def pose(wxyz, position):
        assert np.shape(wxyz) == (4,) and np.shape(position) == (3,)
        return Rigid3d(Rotation3d(np.roll(wxyz, -1)), position)


@pytest.mark.parametrize("has_images", [True, False])
def test_viser(model, image_path, monkeypatch, has_images):
    viewer = load("view_in_viser", monkeypatch, "viser", SimpleNamespace())
    scene = Scene()
    viewer.show(scene, model, *[image_path][:has_images])
    assert viewer.vertical_fov_rad(PINHOLE) == pytest.approx(np.pi / 2, 0.01)
    assert viewer.vertical_fov_rad(FISHEYE) == 2.0
    assert scene.nodes["/points"] == model.num_points3D()
    path = scene.nodes["/path"]
    assert len(path) == model.num_frames() - 1
    np.testing.assert_array_equal(path[1:, 0], path[:-1, 1])
    for image in model.images.values():
        frame = scene.nodes[f"/frames/{image.frame_id}"]
        in_rig, fov, pixels = scene.nodes[
            f"/frames/{image.frame_id}/{image.camera_id}"]
        assert_projects(model, image, (frame * in_rig).inverse())
        assert (pixels is not None) == has_images
        camera = image.camera
        assert fov == pytest.approx(
            2 * np.arctan(camera.height / 2 / camera.focal_length_y), rel=0.05)
        down = image.cam_from_world().rotation.matrix()[1]
        assert scene.up @ down < 0


class Rerun(SimpleNamespace):
    """rerun: transforms with the relation ChildFromParent map from the parent
    entity to the child; quaternions are x, y, z, w."""

    def __init__(self):
        def made(kind):
            return lambda *args, **kwargs: SimpleNamespace(
                kind=kind, args=args, **kwargs)
        super().__init__(
            ViewCoordinates=SimpleNamespace(
                RIGHT_HAND_Y_DOWN=made("ViewCoordinates")()),
            TransformRelation=SimpleNamespace(ChildFromParent=2),
            **{kind: made(kind) for kind in (
                "Transform3D", "Quaternion", "Points3D", "LineStrips3D",
                "Pinhole", "EncodedImage")})
        self.time, self.static, self.logged = None, {}, {}

    def set_time(self, timeline, *, sequence):
        self.time = timeline, sequence

    def log(self, path, entity, *, static=False):
        table = (self.static if static
                 else self.logged.setdefault(self.time, {}))
        table[path, entity.kind] = entity

    @staticmethod
    def pose(entity):
        assert entity.relation == 2
        return Rigid3d(Rotation3d(entity.rotation.xyzw), entity.translation)


@pytest.mark.parametrize("has_images", [True, False])
def test_rerun(model, image_path, monkeypatch, has_images):
    rerun = Rerun()
    viewer = load("view_in_rerun", monkeypatch, "rerun", rerun)
    viewer.show(model, *[image_path][:has_images])
    assert viewer.is_nearly_pinhole(PINHOLE)
    assert not viewer.is_nearly_pinhole(FISHEYE)
    points = rerun.static["world/points", "Points3D"]
    assert points.args[0].shape == points.colors.shape
    strip, = rerun.static["world/path", "LineStrips3D"].args[0]
    assert np.shape(strip) == (model.num_frames(), 3)
    numbers = {frame_id: ("frame", number)
               for number, frame_id in enumerate(sorted(model.frames))}
    for image in model.images.values():
        rig = f"world/rig_{image.frame.rig_id}"
        camera = f"{rig}/camera_{image.camera_id}"
        logged = rerun.logged[numbers[image.frame_id]]
        cam_from_rig = rerun.pose(rerun.static[camera, "Transform3D"])
        rig_from_world = rerun.pose(logged[rig, "Transform3D"])
        assert_projects(model, image, cam_from_rig * rig_from_world)
        pinhole = rerun.static[f"{camera}/image", "Pinhole"]
        np.testing.assert_array_equal(pinhole.image_from_camera,
                                      image.camera.calibration_matrix())
        assert pinhole.resolution == [image.camera.width, image.camera.height]
        assert ((f"{camera}/image", "EncodedImage") in logged) == has_images
