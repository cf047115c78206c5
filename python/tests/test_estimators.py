# SPDX-License-Identifier: BSD-3-Clause
"""Estimators find the truth of simulated correspondences with outliers."""

import numpy as np
import pymgsfm
import pytest

NUM, NUM_OUTLIERS = 200, 60
RIG = [pymgsfm.Rigid3d(), pymgsfm.Rigid3d([0.0, 0.4, 0.0], [-0.5, 0.1, 0.0])]


def cameras():
    return [pymgsfm.Camera(1, "OPENCV", 1000, 800,
                           [600, 610, 500, 400, -0.1, 0.01, 1e-3, -1e-3]),
            pymgsfm.Camera(2, "OPENCV_FISHEYE", 1000, 800,
                           [300, 300, 500, 400, 0.01, 0.0, 0.0, 0.0])]


def project(camera, pose, xyz, random, sigma_px=0.3):
    """Pixels with noise; the last NUM_OUTLIERS are wrong."""
    pixels = camera.img_from_cam(pose * xyz)
    assert np.isfinite(pixels).all()
    pixels += random.normal(scale=sigma_px, size=pixels.shape)
    pixels[-NUM_OUTLIERS:] = random.uniform((0, 0), (1000, 800),
                                            (NUM_OUTLIERS, 2))
    return pixels


def some_scene(seed=6):
    random = np.random.default_rng(seed)
    xyz = random.uniform((-2, -2, 4), (2, 2, 8), (NUM, 3))
    return random, xyz, pymgsfm.Rigid3d([0.1, -0.2, 0.05], [0.3, -0.1, 0.4])


def assert_close(pose, truth, rotation_deg=0.1, distance=0.01):
    assert np.rad2deg(pose.rotation.angle_to(truth.rotation)) < rotation_deg
    assert np.linalg.norm(pose.translation - truth.translation) < distance


def assert_inliers(found, num=NUM):
    mask = found["inlier_mask"]
    assert mask.dtype == bool and mask.shape == (num,)
    assert found["num_inliers"] == mask.sum()
    assert mask[:-NUM_OUTLIERS].mean() > 0.95
    assert mask[-NUM_OUTLIERS:].mean() < 0.1


@pytest.mark.parametrize("camera", cameras(), ids=lambda c: c.model_name)
def test_absolute_pose(camera):
    random, xyz, truth = some_scene()
    pixels = project(camera, truth, xyz, random)
    found = pymgsfm.estimate_absolute_pose(pixels, xyz, camera,
                                           {"ransac": {"max_error": 4.0}})
    assert_close(found["cam_from_world"], truth, 0.3, 0.05)
    assert_inliers(found)
    refined = pymgsfm.estimate_and_refine_absolute_pose(
        pixels, xyz, camera,
        pymgsfm.AbsolutePoseEstimationOptions(
            pymgsfm.RANSACOptions(max_error=4.0)), return_covariance=True)
    assert_close(refined["cam_from_world"], truth)
    assert np.linalg.eigvalsh(refined["covariance"]).min() > 0
    again = pymgsfm.refine_absolute_pose(
        truth, pixels, xyz, found["inlier_mask"], camera)
    assert_close(again["cam_from_world"], refined["cam_from_world"], 1e-3, 1e-4)


def test_generalized_absolute_pose():
    random, xyz, truth = some_scene()
    idxs = random.integers(2, size=NUM)
    pixels = np.empty((NUM, 2))
    for i, camera in enumerate(cameras()):
        pixels[idxs == i] = camera.img_from_cam(RIG[i] * (
            truth * xyz[idxs == i]))
    pixels += random.normal(scale=0.3, size=pixels.shape)
    pixels[-NUM_OUTLIERS:] = random.uniform(0, 800, (NUM_OUTLIERS, 2))
    found = pymgsfm.estimate_and_refine_generalized_absolute_pose(
        pixels, xyz, idxs, RIG, cameras(), {"max_error": 4.0})
    assert_close(found["rig_from_world"], truth)
    assert_inliers(found)
    same = pymgsfm.rig_absolute_pose_estimation(
        pixels, xyz, cameras(), RIG, idxs, {"max_error": 4.0})
    assert same["rig_from_world"] == found["rig_from_world"]
    with pytest.raises(pymgsfm.InputError, match="out of range"):
        pymgsfm.estimate_generalized_absolute_pose(pixels, xyz, idxs + 1, RIG,
                                                   cameras())


def test_the_same_input_gives_the_same_pose():
    random, xyz, truth = some_scene()
    pixels = project(cameras()[0], truth, xyz, random)
    first, second = (pymgsfm.estimate_absolute_pose(pixels, xyz, cameras()[0])
                     for _ in range(2))
    assert first["cam_from_world"] == second["cam_from_world"]


def test_options_of_ransac():
    random, xyz, truth, camera = pinhole_pair()
    pixels1 = project(camera, pymgsfm.Rigid3d(), xyz, random)
    pixels2 = project(camera, truth, xyz, random)

    def estimate(**options):
        options = {"max_error": 1.5, "min_num_trials": 1, **options}
        return pymgsfm.estimate_fundamental_matrix(pixels1, pixels2,
                                                   options)["F"].tolist()

    one, two, many = (estimate(max_num_trials=n) for n in (1, 2, 5000))
    assert one != many and estimate(max_num_trials=1, random_seed=1) != one
    assert estimate(confidence=0.0) == one
    assert estimate(min_num_trials=5000) != many  # which stops earlier
    # Two samples suffice at this inlier ratio: (1 - 0.999^7)^2 < 1 - 0.9999.
    assert estimate(min_inlier_ratio=0.999) == two


def test_essential_matrix():
    random, xyz, truth = some_scene()
    one, two = cameras()
    pixels1 = project(one, pymgsfm.Rigid3d(), xyz, random)
    pixels2 = project(two, truth, xyz, random)
    found = pymgsfm.estimate_essential_matrix(pixels1, pixels2, one, two,
                                              {"max_error": 2.0})
    assert_inliers(found)
    direction = truth.translation / np.linalg.norm(truth.translation)
    assert_close(found["cam2_from_cam1"],
                 pymgsfm.Rigid3d(truth.rotation, direction), 0.3, 0.03)
    E = pymgsfm.essential_matrix_from_pose(found["cam2_from_cam1"])
    np.testing.assert_allclose(E, found["E"], atol=1e-9)
    inliers = found["inlier_mask"]
    rays1 = one.cam_ray_from_img(pixels1[inliers])
    rays2 = two.cam_ray_from_img(pixels2[inliers])
    assert np.abs((rays2 * (rays1 @ E.T)).sum(axis=1)).max() < 0.02
    pose = pymgsfm.pose_from_essential_matrix(-3.0 * E, rays1, rays2)
    assert_close(pose["cam2_from_cam1"], found["cam2_from_cam1"], 1e-6, 1e-6)
    assert pose["inlier_mask"].mean() > 0.95


def pinhole_pair():
    random, xyz, truth = some_scene()
    camera = pymgsfm.Camera(1, "PINHOLE", 1000, 800, [600, 600, 500, 400],
                            has_prior_focal_length=True)
    return random, xyz, truth, camera


def test_fundamental_matrix():
    random, xyz, truth, camera = pinhole_pair()
    pixels1 = project(camera, pymgsfm.Rigid3d(), xyz, random)
    pixels2 = project(camera, truth, xyz, random)
    found = pymgsfm.estimate_fundamental_matrix(pixels1, pixels2,
                                                {"max_error": 1.5})
    assert_inliers(found)
    assert abs(np.linalg.det(found["F"] / np.linalg.norm(found["F"]))) < 1e-9
    errors = np.sqrt(pymgsfm.squared_sampson_error(pixels1, pixels2,
                                                   found["F"]))
    mask = found["inlier_mask"]
    assert errors[mask].max() < 1.05 * 1.5 and errors[~mask].min() > 0.95 * 1.5
    K = camera.calibration_matrix()
    true_F = np.linalg.inv(K).T @ pymgsfm.essential_matrix_from_pose(
        truth) @ np.linalg.inv(K)
    exact1 = camera.img_from_cam(xyz)
    exact2 = camera.img_from_cam(truth * xyz)
    for F, limit in ((true_F, 1e-6), (found["F"], 0.5)):
        assert np.sqrt(pymgsfm.squared_sampson_error(
            exact1, exact2, F)).mean() < limit


def test_homography_matrix():
    random, xyz, truth, camera = pinhole_pair()
    xyz[:, 2] = 5.0 + 0.2 * xyz[:, 0]  # a plane
    pixels1 = project(camera, pymgsfm.Rigid3d(), xyz, random)
    pixels2 = project(camera, truth, xyz, random)
    found = pymgsfm.estimate_homography_matrix(pixels1, pixels2,
                                               {"max_error": 3.0})
    assert_inliers(found)
    mapped = np.column_stack([camera.img_from_cam(xyz), np.ones(NUM)]
                             ) @ found["H"].T
    np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:],
                               camera.img_from_cam(truth * xyz), atol=0.5)


def test_two_view_geometry():
    random, xyz, truth, camera = pinhole_pair()
    pixels1 = project(camera, pymgsfm.Rigid3d(), xyz, random)
    order = random.permutation(NUM)
    pixels2 = project(camera, truth, xyz, random)[order]
    matches = np.column_stack([order, np.arange(NUM)])
    found = pymgsfm.estimate_two_view_geometry(camera, pixels1, camera,
                                               pixels2, matches)
    assert found.config == pymgsfm.TwoViewGeometryConfiguration.CALIBRATED
    assert len(found.inlier_matches) >= 0.95 * (NUM - NUM_OUTLIERS)
    assert {tuple(row) for row in found.inlier_matches.tolist()} <= {
        tuple(row) for row in matches.tolist()}
    assert_close(pymgsfm.Rigid3d(found.cam2_from_cam1.rotation),
                 pymgsfm.Rigid3d(truth.rotation), 1.0)
    unknown = pymgsfm.Camera(1, "PINHOLE", 1000, 800, camera.params)
    assert pymgsfm.estimate_two_view_geometry(
        unknown, pixels1, unknown, pixels2, matches).config == (
            pymgsfm.TwoViewGeometryConfiguration.UNCALIBRATED)
    few = pymgsfm.estimate_calibrated_two_view_geometry(
        unknown, pixels1[:10], unknown, pixels2[:10],
        options=pymgsfm.TwoViewGeometryOptions(min_num_inliers=20))
    assert few.config == pymgsfm.TwoViewGeometryConfiguration.DEGENERATE
    F = found.F.copy()
    found.invert()
    np.testing.assert_array_equal(found.F, F.T)


def test_generalized_relative_pose():
    random, xyz, truth = some_scene()
    idxs1, idxs2 = random.integers(2, size=(2, NUM))
    pixels = [np.empty((NUM, 2)), np.empty((NUM, 2))]
    for side, idxs, motion in ((0, idxs1, pymgsfm.Rigid3d()),
                               (1, idxs2, truth)):
        for i, camera in enumerate(cameras()):
            pixels[side][idxs == i] = camera.img_from_cam(
                RIG[i] * (motion * xyz[idxs == i]))
    pixels[1] += random.normal(scale=0.1, size=(NUM, 2))
    pixels[1][-NUM_OUTLIERS:] = random.uniform(0, 800, (NUM_OUTLIERS, 2))
    found = pymgsfm.estimate_generalized_relative_pose(
        pixels[0], pixels[1], idxs1, idxs2, RIG, cameras(), {"max_error": 2.0})
    assert_close(found["rig2_from_rig1"], truth, 0.3, 0.1)  # with its length
    assert_inliers(found)


def test_triangulation():
    random, xyz, _ = some_scene()
    truth, camera = xyz[0], cameras()[0]
    poses = [pymgsfm.Rigid3d([0.0, 0.02 * i, 0.0], [0.2 * i, 0.0, 0.0])
             for i in range(8)]
    pixels = np.array([camera.img_from_cam(pose * truth) for pose in poses])
    pixels[2] += 100.0
    options = pymgsfm.EstimateTriangulationOptions(
        residual_type=pymgsfm.TriangulationResidualType.REPROJECTION_ERROR,
        ransac=pymgsfm.RANSACOptions(max_error=2.0))
    found = pymgsfm.estimate_triangulation(pixels, poses, [camera] * 8, options)
    np.testing.assert_allclose(found["xyz"], truth, atol=1e-6)
    assert list(np.flatnonzero(~found["inlier_mask"])) == [2]
    centers = [pose.tgt_origin_in_src() for pose in (poses[0], poses[7])]
    angle = pymgsfm.calculate_triangulation_angle(*centers, truth)
    a, b = (center - truth for center in centers)
    assert np.cos(angle) == pytest.approx(
        a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    options.min_tri_angle = 1.1 * angle
    assert pymgsfm.estimate_triangulation(pixels, poses, [camera] * 8,
                                          options) is None


def test_similarity_of_points():
    random, xyz, _ = some_scene()
    truth = pymgsfm.Sim3d(1.7, [0.1, 0.2, 0.3], [1, 2, 3])
    found = pymgsfm.estimate_sim3d(xyz, truth * xyz)
    np.testing.assert_allclose(found.matrix(), truth.matrix(), atol=1e-9)
    rigid = pymgsfm.Rigid3d(truth.rotation, truth.translation)
    np.testing.assert_allclose(
        pymgsfm.estimate_rigid3d(xyz, rigid * xyz).matrix(), rigid.matrix(),
        atol=1e-9)
    line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    assert pymgsfm.estimate_sim3d(line, line) is None


def test_too_little_input_gives_none():
    camera = cameras()[0]
    two = np.zeros((2, 2))
    assert pymgsfm.estimate_absolute_pose(two, np.ones((2, 3)), camera) is None
    assert pymgsfm.estimate_essential_matrix(two, two, camera, camera) is None
    assert pymgsfm.estimate_fundamental_matrix(two, two) is None
    assert pymgsfm.estimate_homography_matrix(two, two) is None
    for num in (0, 1):
        assert pymgsfm.estimate_triangulation(
            two[:num], [pymgsfm.Rigid3d()] * num, [camera] * num) is None


def test_mistakes_are_named():
    camera = cameras()[0]
    with pytest.raises(pymgsfm.InputError, match="no option max_eror"):
        pymgsfm.estimate_fundamental_matrix(np.zeros((9, 2)), np.zeros((9, 2)),
                                            {"max_eror": 1.0})
    points = np.zeros((9, 2))
    points[4] = np.nan
    with pytest.raises(pymgsfm.InputError, match="row 4 is not finite"):
        pymgsfm.estimate_homography_matrix(points, points)
    with pytest.raises(pymgsfm.InputError, match="refine_focal_length"):
        pymgsfm.estimate_and_refine_absolute_pose(
            np.zeros((9, 2)), np.zeros((9, 3)), camera,
            refinement_options={"refine_focal_length": True})
    with pytest.raises(pymgsfm.InputError, match="needs a camera"):
        pymgsfm.estimate_triangulation(np.zeros((2, 2)), [], [camera])
    with pytest.raises(pymgsfm.InputError, match="points3D.*shape"):
        pymgsfm.estimate_absolute_pose(np.zeros((9, 2)), np.zeros((8, 3)),
                                       camera)
