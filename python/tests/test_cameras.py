# SPDX-License-Identifier: BSD-3-Clause
"""Cameras that project, against formulas and finite differences."""

import numpy as np
import pymgsfm
import pytest

MODELS = [model for model in pymgsfm.CameraModelId
          if model != pymgsfm.CameraModelId.INVALID]


def make_camera(model):
    """A camera with moderate distortion."""
    camera = pymgsfm.Camera.create(7, model, 500.0, 1000, 800)
    extra = camera.extra_params_idxs()
    if model.name not in ("FOV", "EUCM"):
        camera.params[extra] = 1e-3 * (1 + np.arange(len(extra)))
    return camera


def some_points():
    random = np.random.default_rng(1)
    return np.column_stack([random.uniform(-0.5, 0.5, (50, 2)),
                            random.uniform(1.0, 2.0, 50)])


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
class TestEveryModel:
    def test_rays_of_projections(self, model):
        camera, points = make_camera(model), some_points()
        pixels = camera.img_from_cam(points)
        assert pixels.shape == (50, 2)
        rays = camera.cam_ray_from_img(pixels)
        np.testing.assert_allclose(
            rays, points / np.linalg.norm(points, axis=1)[:, None], atol=1e-8)
        np.testing.assert_allclose(camera.cam_from_img(pixels),
                                   points[:, :2] / points[:, 2:], atol=1e-8)

    def test_one_point_is_a_row(self, model):
        camera, points = make_camera(model), some_points()
        pixels = camera.img_from_cam(points)
        np.testing.assert_array_equal(camera.img_from_cam(points[3]), pixels[3])
        np.testing.assert_array_equal(camera.cam_ray_from_img(pixels[3]),
                                      camera.cam_ray_from_img(pixels)[3])

    def test_derivatives(self, model):
        camera, points = make_camera(model), some_points()
        _, by_point, by_params = camera.img_from_cam_jacobians(points)
        step = 1e-6
        for axis in range(3):
            delta = step * np.eye(3)[axis]
            difference = (camera.img_from_cam(points + delta)
                          - camera.img_from_cam(points - delta)) / (2 * step)
            np.testing.assert_allclose(by_point[:, :, axis], difference,
                                       atol=1e-3)
        for k in range(len(camera.params)):
            shifted = [make_camera(model) for _ in range(2)]
            h = step * max(1.0, abs(camera.params[k]))
            shifted[0].params[k] += h
            shifted[1].params[k] -= h
            difference = (shifted[0].img_from_cam(points)
                          - shifted[1].img_from_cam(points)) / (2 * h)
            np.testing.assert_allclose(by_params[:, :, k], difference,
                                       atol=1e-3)

    def test_rescaled_images(self, model):
        camera, points = make_camera(model), some_points()
        pixels = camera.img_from_cam(points)
        camera.rescale(0.5)
        assert (camera.width, camera.height) == (500, 400)
        np.testing.assert_allclose(camera.img_from_cam(points), 0.5 * pixels,
                                   atol=1e-9)

    def test_names_of_parameters(self, model):
        camera = make_camera(model)
        names = camera.params_info.split(", ")
        assert len(names) == len(camera.params) == len(set(names))
        assert camera.model == model and camera.verify_params()
        used = (camera.focal_length_idxs() + camera.principal_point_idxs()
                + camera.extra_params_idxs())
        if model.name != "EQUIRECTANGULAR":
            assert sorted(used) == list(range(len(names)))
            assert [names[i] for i in camera.principal_point_idxs()] == [
                "cx", "cy"]
            assert all(names[i].startswith("f")
                       for i in camera.focal_length_idxs())


def test_pinhole_is_its_matrix():
    camera = pymgsfm.Camera(1, "PINHOLE", 1000, 800, [500, 510, 490, 410])
    points = some_points()
    homogeneous = points @ camera.calibration_matrix().T
    np.testing.assert_allclose(camera.img_from_cam(points),
                               homogeneous[:, :2] / homogeneous[:, 2:])
    np.testing.assert_allclose(camera.img_from_cam(points[:, :2]),
                               camera.img_from_cam(np.column_stack(
                                   [points[:, :2], np.ones(50)])))
    assert (camera.focal_length_x, camera.focal_length_y) == (500, 510)
    assert (camera.principal_point_x, camera.principal_point_y) == (490, 410)
    assert camera.mean_focal_length() == pytest.approx(505)
    assert camera.cam_from_img_threshold(505) == pytest.approx(1)
    with pytest.raises(pymgsfm.InputError, match="2 focal lengths"):
        camera.focal_length
    camera.focal_length_y = 520
    assert camera.params[1] == 520


def test_points_that_a_camera_cannot_see():
    camera = pymgsfm.Camera(1, "PINHOLE", 1000, 800, [500, 500, 500, 400])
    assert camera.img_from_cam([0.0, 0.0, -1.0]) is None
    pixels = camera.img_from_cam([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    assert np.isnan(pixels[0]).all() and list(pixels[1]) == [500, 400]
    panorama = pymgsfm.Camera.create(1, "EQUIRECTANGULAR", 1.0, 1000, 500)
    behind = panorama.img_from_cam([0.0, 0.0, -1.0])
    assert behind is not None
    assert panorama.cam_from_img(behind) is None
    with pytest.raises(pymgsfm.InputError, match="no focal_length_x"):
        panorama.calibration_matrix()


def test_keywords_of_pycolmap():
    camera = pymgsfm.Camera(model="SIMPLE_RADIAL", width=640, height=480,
                            params=[500, 320, 240, 0.1], camera_id=3)
    same = pymgsfm.Camera({"model": "SIMPLE_RADIAL", "width": 640,
                           "height": 480, "params": [500, 320, 240, 0.1],
                           "camera_id": 3})
    assert repr(camera) == repr(same)
    assert camera.sensor_id == (pymgsfm.SensorType.CAMERA, 3)
    assert camera.focal_length == 500
    assert not camera.has_bogus_params(0.1, 10.0, 1.0)
    assert camera.has_bogus_params(0.1, 10.0, 0.05)
    assert camera.has_bogus_params(1.0, 10.0, 1.0)
    text = camera.params_to_string()
    assert same.set_params_from_string(text) and repr(camera) == repr(same)
    assert not same.set_params_from_string("1, 2")
    with pytest.raises(pymgsfm.InputError, match="unknown camera model"):
        pymgsfm.Camera(model="ROUND")
    with pytest.raises(pymgsfm.InputError, match="shape"):
        pymgsfm.Camera(1, "PINHOLE", 10, 10, [1.0]).img_from_cam([0, 0, 1])
