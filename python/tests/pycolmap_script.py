# SPDX-License-Identifier: BSD-3-Clause
"""Works on a model in pycolmap's dialect; test_pycolmap.py runs it.

    pycolmap_script.py MODEL DATABASE OUTPUT
"""

import copy
import sys
from pathlib import Path

import numpy as np
import pymgsfm as pycolmap


def reprojection_errors(rec: pycolmap.Reconstruction) -> np.ndarray:
    """The errors of all observations, image by image."""
    errors = []
    for image_id in rec.reg_image_ids():
        image = rec.image(image_id)
        points2D = image.get_observation_points2D()
        if not points2D:
            continue
        xyz = np.array([rec.points3D[p.point3D_id].xyz for p in points2D])
        xy = np.array([p.xy for p in points2D])
        in_cam = image.cam_from_world() * xyz
        errors.extend(np.linalg.norm(image.camera.img_from_cam(in_cam) - xy,
                                     axis=1))
    return np.array(errors)


def check_cameras(rec: pycolmap.Reconstruction) -> None:
    """Rays of keypoints, there and back."""
    for image in rec.images.values():
        camera = rec.cameras[image.camera_id]
        xy = np.array([p.xy for p in image.points2D])
        uv = camera.cam_from_img(xy)
        np.testing.assert_allclose(camera.img_from_cam(uv), xy, atol=1e-6)
        K = camera.calibration_matrix()
        assert K[0, 0] == camera.focal_length_x
        center = image.projection_center()
        assert image.project_point(center + image.viewing_direction()
                                   ) is not None
        assert image.project_point(center - image.viewing_direction()) is None


def filter_points(rec: pycolmap.Reconstruction) -> int:
    """Removes the worst observations and points with narrow angles."""
    manager = pycolmap.ObservationManager(rec)
    num = manager.filter_all_points3D(max_reproj_error=2.0, min_tri_angle=1.5)
    num += manager.filter_observations_with_negative_depth()
    for point3D_id in rec.point3D_ids():
        if rec.points3D[point3D_id].track.length() < 2:
            rec.delete_point3D(point3D_id)
    return num


def triangulate_matches(rec: pycolmap.Reconstruction, database_path: str
                        ) -> int:
    """Adds points for verified matches that observe none."""
    options = pycolmap.EstimateTriangulationOptions()
    options.min_tri_angle = np.deg2rad(1.5)
    options.residual_type = (
        pycolmap.TriangulationResidualType.REPROJECTION_ERROR)
    options.ransac.max_error = 2.0
    num_new = 0
    with pycolmap.Database.open(database_path) as database:
        pair_ids, geometries = database.read_two_view_geometries()
    for pair_id, geometry in zip(pair_ids, geometries):
        ids = pycolmap.pair_id_to_image_pair(pair_id)
        if not all(rec.exists_image(i) for i in ids):
            continue
        images = [rec.images[i] for i in ids]
        for idxs in geometry.inlier_matches:
            points2D = [image.points2D[int(k)]
                        for image, k in zip(images, idxs)]
            if any(p.has_point3D() for p in points2D):
                continue
            found = pycolmap.estimate_triangulation(
                np.array([p.xy for p in points2D]),
                [image.cam_from_world() for image in images],
                [image.camera for image in images], options)
            if found is None or not found["inlier_mask"].all():
                continue
            track = pycolmap.Track()
            for image_id, k in zip(ids, idxs):
                track.add_element(image_id, int(k))
            rec.add_point3D(found["xyz"], track)
            num_new += 1
    return num_new


def resect_frame(rec: pycolmap.Reconstruction, frame_id: int) -> float:
    """Finds the pose of a frame again, by all cameras of its rig.

    Returns the rotation between the old and the new pose in degrees.
    """
    frame = rec.frame(frame_id)
    rig = frame.rig
    old_pose = copy.deepcopy(frame.rig_from_world)
    cameras, cams_from_rig, camera_idxs, observations = [], [], [], []
    for data_id in frame.data_ids:
        image = rec.image(data_id.id)
        camera_idx = len(cameras)
        cameras.append(image.camera)
        cams_from_rig.append(
            pycolmap.Rigid3d() if rig.is_ref_sensor(data_id.sensor_id)
            else rig.sensor_from_rig(data_id.sensor_id))
        for k in image.get_observation_point2D_idxs():
            point3D_id = image.points2D[k].point3D_id
            # A point with two observations vanishes with the frame.
            if rec.points3D[point3D_id].track.length() > 4:
                observations.append((image.image_id, k, point3D_id))
                camera_idxs.append(camera_idx)
    rec.deregister_frame(frame_id)
    result = pycolmap.estimate_and_refine_generalized_absolute_pose(
        np.array([rec.images[i].points2D[k].xy for i, k, _ in observations]),
        np.array([rec.points3D[p].xyz for _, _, p in observations]),
        camera_idxs, cams_from_rig, cameras,
        pycolmap.RANSACOptions(max_error=4.0))
    assert result is not None
    frame.rig_from_world = result["rig_from_world"]
    rec.register_frame(frame_id)
    for (image_id, k, point3D_id), is_inlier in zip(observations,
                                                    result["inlier_mask"]):
        if is_inlier:
            rec.add_observation(point3D_id,
                                pycolmap.TrackElement(image_id, k))
    return np.rad2deg(frame.rig_from_world.rotation.angle_to(old_pose.rotation))


def main(model_path: str, database_path: str, output_path: str) -> None:
    rec = pycolmap.Reconstruction(model_path)
    original = pycolmap.Reconstruction(rec)
    print(rec.summary())
    print(f"error_before_px: {reprojection_errors(rec).mean():.4f}")
    check_cameras(rec)
    print(f"num_filtered: {filter_points(rec)}")
    print(f"num_new_points: {triangulate_matches(rec, database_path)}")
    frame_id = sorted(rec.reg_frame_ids())[5]
    print(f"resection_deg: {resect_frame(rec, frame_id):.5f}")

    options = pycolmap.BundleAdjustmentOptions()
    options.max_num_iterations = 50
    pycolmap.bundle_adjustment(rec, options)
    rec.normalize()
    rec.check()
    print(f"error_after_px: {reprojection_errors(rec).mean():.4f}")

    Path(output_path).mkdir(exist_ok=True)
    rec.write(output_path)
    comparison = pycolmap.compare_reconstructions(
        pycolmap.Reconstruction(output_path), original)
    print("max_difference: {:.5f}".format(
        max(e.proj_center_error for e in comparison["errors"])))


if __name__ == "__main__":
    main(*sys.argv[1:])
