# SPDX-License-Identifier: BSD-3-Clause
"""Estimators of poses, matrices and points, with pycolmap's names.

All return a dict, or None if nothing can be estimated. `inlier_mask` is (N,).
Options are objects or dicts of their attributes. Errors in pixels become angles
by the pixels per radian of a camera, so that all lenses can be used. Equal
input and options give equal results.
"""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass, field
from typing import Any, Dict, Mapping, Optional, Sequence, Type, TypeVar

import numpy as np
import numpy.typing as npt

from . import _core
from .cameras import Camera
from .errors import InputError
from .geometry import FloatArray, Rigid3d
from .options import OptionsLike, to_texts

Estimate = Optional[Dict[str, Any]]


@dataclass
class RANSACOptions:
    """Options of robust estimation.

    Attributes:
      max_error: Of inliers, in pixels; of estimate_triangulation by angles, and
        of estimators that take rays, in radians.
      min_inlier_ratio: Samples that find a model of this inlier ratio suffice.
      confidence: Probability that a sample is free of outliers.
      min_num_trials, max_num_trials: Limits of the number of samples.
      random_seed
    """

    max_error: float = 4.0
    min_inlier_ratio: float = 0.01
    confidence: float = 0.9999
    min_num_trials: int = 20
    max_num_trials: int = 5000
    random_seed: int = 0


@dataclass
class AbsolutePoseEstimationOptions:
    """Options of estimate_absolute_pose; focal lengths are not estimated."""

    ransac: RANSACOptions = field(
        default_factory=lambda: RANSACOptions(max_error=12.0))


@dataclass
class AbsolutePoseRefinementOptions:
    """Options of refine_absolute_pose; intrinsics are not refined.

    Attributes:
      loss_function_scale: Of the Cauchy loss, in pixels.
    """

    loss_function_scale: float = 1.0


class TriangulationResidualType(enum.Enum):
    """The error of estimate_triangulation."""

    ANGULAR_ERROR = 0
    REPROJECTION_ERROR = 1


@dataclass
class EstimateTriangulationOptions:
    """Options of estimate_triangulation.

    Attributes:
      min_tri_angle: In radians, of the two inlier rays farthest apart.
      residual_type: Whether ransac.max_error is in radians or in pixels.
      ransac: RANSACOptions; only max_error is used, as all pairs of rays or 60
        of them are tried.
    """

    min_tri_angle: float = 0.0
    residual_type: TriangulationResidualType = (
        TriangulationResidualType.ANGULAR_ERROR)
    ransac: RANSACOptions = field(
        default_factory=lambda: RANSACOptions(max_error=np.deg2rad(2.0)))


class TwoViewGeometryConfiguration(enum.IntEnum):
    """The kind of a two-view geometry, with COLMAP's numbers."""

    UNDEFINED = 0
    DEGENERATE = 1
    CALIBRATED = 2
    UNCALIBRATED = 3
    PLANAR = 4
    PANORAMIC = 5
    PLANAR_OR_PANORAMIC = 6
    WATERMARK = 7
    MULTIPLE = 8
    CALIBRATED_RIG = 9


class TwoViewGeometry:
    """The verified matches of two images. Maps are from image 1 to image 2.

    Attributes:
      config: TwoViewGeometryConfiguration.
      F, E, H: (3, 3), x2^T F x1 = 0 and x2 ~ H x1 in pixels, x2^T E x1 = 0 for
        rays; None if unknown.
      cam2_from_cam1: Rigid3d, its translation of unit length or zero; None if
        unknown.
      inlier_matches: (N, 2) indices of keypoints.
    """

    def __init__(self, config: int = 0, F: Optional[FloatArray] = None,
                 E: Optional[FloatArray] = None, H: Optional[FloatArray] = None,
                 cam2_from_cam1: Optional[Rigid3d] = None,
                 inlier_matches: npt.ArrayLike = ()) -> None:
        self.config = TwoViewGeometryConfiguration(config)
        self.F, self.E, self.H = F, E, H
        self.cam2_from_cam1 = cam2_from_cam1
        self.inlier_matches: npt.NDArray[np.uint32] = np.asarray(
            inlier_matches, dtype=np.uint32).reshape(-1, 2)

    def invert(self) -> None:
        """Exchanges the images."""
        self.F = None if self.F is None else self.F.T
        self.E = None if self.E is None else self.E.T
        self.H = None if self.H is None else np.linalg.inv(self.H)
        self.cam2_from_cam1 = self.cam2_from_cam1 and (
            self.cam2_from_cam1.inverse())
        self.inlier_matches = self.inlier_matches[:, ::-1].copy()

    def _row(self) -> Any:
        return (int(self.config), self.F, self.E, self.H,
                self.cam2_from_cam1 and self.cam2_from_cam1.row(),
                self.inlier_matches)

    @staticmethod
    def _of_row(row: Any) -> "TwoViewGeometry":
        config, F, E, H, pose, matches = row
        return TwoViewGeometry(
            config, F, E, H, None if pose is None else Rigid3d.from_row(pose),
            matches)

    def __repr__(self) -> str:
        return (f"TwoViewGeometry(config={self.config.name}, "
                f"num_inliers={len(self.inlier_matches)})")


_Options = TypeVar("_Options")


def _options(kind: Type[_Options], given: Any) -> _Options:
    """Options of a dict, an object or None."""
    if given is None:
        return kind()
    if not isinstance(given, Mapping):
        if not isinstance(given, kind):
            raise InputError(f"the options must be {kind.__name__} or a dict")
        return given
    options = kind()
    for name, value in given.items():
        if not hasattr(options, name):
            raise InputError(f"{kind.__name__} has no option {name}; it has "
                             + ", ".join(vars(options)))
        if isinstance(value, Mapping):
            value = _options(type(getattr(options, name)), {
                **dataclasses.asdict(getattr(options, name)), **value})
        setattr(options, name, value)
    return options


def _ransac(given: Any, **changes: Any) -> Dict[str, Any]:
    return {**dataclasses.asdict(_options(RANSACOptions, given)), **changes}


def _mask(mask: Any) -> Dict[str, Any]:
    return {"num_inliers": int(mask.sum()), "inlier_mask": mask,
            "inliers": mask}


# ----------------------------------------------------------- absolute poses


def estimate_generalized_absolute_pose(
        points2D: npt.ArrayLike, points3D: npt.ArrayLike,
        camera_idxs: npt.ArrayLike, cams_from_rig: Sequence[Rigid3d],
        cameras: Sequence[Camera], estimation_options: Any = None) -> Estimate:
    """The pose of a rig from correspondences of its cameras, by LO-RANSAC.

    Args:
      points2D: (N, 2) pixels.
      points3D: (N, 3) in the world.
      camera_idxs: (N,) indices of cameras and of cams_from_rig.
      cams_from_rig: The poses of the cameras in the rig.
      cameras: Their intrinsics; any model.
      estimation_options: RANSACOptions.

    Returns rig_from_world, num_inliers and inlier_mask.
    """
    rows, idxs, rays, points = _rig_points(points2D, points3D, camera_idxs,
                                           cams_from_rig, cameras)
    found = _core.estimate_pose(rows, idxs, rays, points,
                                _ransac(estimation_options))
    if found is None:
        return None
    return {"rig_from_world": Rigid3d.from_row(found[0]), **_mask(found[1])}


def refine_generalized_absolute_pose(
        rig_from_world: Rigid3d, points2D: npt.ArrayLike,
        points3D: npt.ArrayLike, inlier_mask: npt.ArrayLike,
        camera_idxs: npt.ArrayLike, cams_from_rig: Sequence[Rigid3d],
        cameras: Sequence[Camera], refinement_options: Any = None,
        return_covariance: bool = False) -> Estimate:
    """The pose of a rig that minimizes a robust cost of the inliers.

    Returns rig_from_world, and with return_covariance its covariance, (6, 6)
    for errors of one pixel: rotation vector in the rig (rad), translation.
    """
    options = _options(AbsolutePoseRefinementOptions, refinement_options)
    rows, idxs, rays, points = _rig_points(points2D, points3D, camera_idxs,
                                           cams_from_rig, cameras)
    inliers = np.asarray(inlier_mask, dtype=bool)
    found = _core.refine_pose(rows, idxs[inliers], rays[inliers],
                              points[inliers], rig_from_world.row(),
                              options.loss_function_scale)
    if found is None:
        return None
    result: Dict[str, Any] = {"rig_from_world": Rigid3d.from_row(found[0])}
    if return_covariance:
        result["covariance"] = found[1]
    return result


def estimate_and_refine_generalized_absolute_pose(
        points2D: npt.ArrayLike, points3D: npt.ArrayLike,
        camera_idxs: npt.ArrayLike, cams_from_rig: Sequence[Rigid3d],
        cameras: Sequence[Camera], estimation_options: Any = None,
        refinement_options: Any = None,
        return_covariance: bool = False) -> Estimate:
    """estimate_generalized_absolute_pose, then its refinement."""
    refinement_options = _options(AbsolutePoseRefinementOptions,
                                  refinement_options)
    estimate = estimate_generalized_absolute_pose(
        points2D, points3D, camera_idxs, cams_from_rig, cameras,
        estimation_options)
    refined = estimate and refine_generalized_absolute_pose(
        estimate["rig_from_world"], points2D, points3D, estimate["inlier_mask"],
        camera_idxs, cams_from_rig, cameras, refinement_options,
        return_covariance)
    return {**estimate, **refined} if estimate and refined else None


def estimate_absolute_pose(points2D: npt.ArrayLike, points3D: npt.ArrayLike,
                           camera: Camera, estimation_options: Any = None
                           ) -> Estimate:
    """The pose of an image from points (N, 2) and (N, 3), by LO-RANSAC.

    Returns cam_from_world, num_inliers and inlier_mask.
    """
    options = _options(AbsolutePoseEstimationOptions, estimation_options)
    return _as_camera(estimate_generalized_absolute_pose(
        points2D, points3D, np.zeros(np.shape(points2D)[0]), [Rigid3d()],
        [camera], options.ransac))


def refine_absolute_pose(cam_from_world: Rigid3d, points2D: npt.ArrayLike,
                         points3D: npt.ArrayLike, inlier_mask: npt.ArrayLike,
                         camera: Camera, refinement_options: Any = None,
                         return_covariance: bool = False) -> Estimate:
    """refine_generalized_absolute_pose of one camera: cam_from_world."""
    return _as_camera(refine_generalized_absolute_pose(
        cam_from_world, points2D, points3D, inlier_mask,
        np.zeros(np.shape(points2D)[0]), [Rigid3d()], [camera],
        refinement_options, return_covariance))


def estimate_and_refine_absolute_pose(
        points2D: npt.ArrayLike, points3D: npt.ArrayLike, camera: Camera,
        estimation_options: Any = None, refinement_options: Any = None,
        return_covariance: bool = False) -> Estimate:
    """estimate_absolute_pose, then its refinement."""
    options = _options(AbsolutePoseEstimationOptions, estimation_options)
    return _as_camera(estimate_and_refine_generalized_absolute_pose(
        points2D, points3D, np.zeros(np.shape(points2D)[0]), [Rigid3d()],
        [camera], options.ransac, refinement_options, return_covariance))


def _as_camera(estimate: Estimate) -> Estimate:
    if estimate is None:
        return None
    return {"cam_from_world": estimate.pop("rig_from_world"), **estimate}


def _rig_points(points2D: npt.ArrayLike, points3D: npt.ArrayLike,
                camera_idxs: npt.ArrayLike, cams_from_rig: Sequence[Rigid3d],
                cameras: Sequence[Camera]) -> Any:
    pixels: FloatArray = np.asarray(points2D, dtype=np.float64).reshape(-1, 2)
    idxs = np.asarray(camera_idxs, dtype=np.int64)
    if len(cameras) != len(cams_from_rig):
        raise InputError("cams_from_rig must have a pose for each camera")
    rays = np.full((len(pixels), 3), np.nan)
    for i, camera in enumerate(cameras):
        rays[idxs == i] = camera.cam_ray_from_img(pixels[idxs == i])
    return ([(camera.model_name, camera.params, pose.row())
             for camera, pose in zip(cameras, cams_from_rig)],
            idxs, rays, np.asarray(points3D, dtype=np.float64))


# ----------------------------------------------------------- relative poses


def estimate_relative_pose(cam_rays1: npt.ArrayLike, cam_rays2: npt.ArrayLike,
                           options: Any = None) -> Estimate:
    """The relative pose of matching rays (N, 3), by LO-RANSAC.

    Args:
      options: RANSACOptions; max_error is in radians, 0.002 by default.

    Returns cam2_from_cam1 with a translation of unit length, E, num_inliers and
    inlier_mask.
    """
    found = _core.estimate_pair(cam_rays1, cam_rays2, _ransac(
        RANSACOptions(max_error=2e-3) if options is None else options))
    if found is None:
        return None
    return {"cam2_from_cam1": Rigid3d.from_row(found[0]), "E": found[1],
            **_mask(found[2])}


def estimate_essential_matrix(
        points2D1: npt.ArrayLike, points2D2: npt.ArrayLike, camera1: Camera,
        camera2: Camera, estimation_options: Any = None) -> Estimate:
    """The essential matrix of matching pixels (N, 2), by LO-RANSAC.

    Returns E with x2^T E x1 = 0 on rays, cam2_from_cam1 with a translation of
    unit length, num_inliers and inlier_mask.
    """
    ransac = _ransac(estimation_options)
    ransac["max_error"] *= 0.5 * (1.0 / camera1.mean_focal_length()
                                  + 1.0 / camera2.mean_focal_length())
    rays = [np.asarray(camera.cam_ray_from_img(
        np.asarray(pixels, dtype=np.float64).reshape(-1, 2)))
        for camera, pixels in ((camera1, points2D1), (camera2, points2D2))]
    has_rays = np.isfinite(rays[0]).all(axis=1) & np.isfinite(
        rays[1]).all(axis=1)
    found = estimate_relative_pose(rays[0][has_rays], rays[1][has_rays], ransac)
    if found is None:
        return None
    mask = np.zeros(len(has_rays), dtype=bool)
    mask[has_rays] = found["inlier_mask"]
    return {**found, **_mask(mask)}


def pose_from_essential_matrix(E: npt.ArrayLike, cam_rays1: npt.ArrayLike,
                               cam_rays2: npt.ArrayLike) -> Dict[str, Any]:
    """The pose of an essential matrix with the most rays (N, 3) that meet in
    front of both cameras.

    Returns cam2_from_cam1, and inlier_mask: whether they do.
    """
    pose, mask = _core.pose_from_essential(E, cam_rays1, cam_rays2)
    return {"cam2_from_cam1": Rigid3d.from_row(pose), **_mask(mask)}


def essential_matrix_from_pose(cam2_from_cam1: Rigid3d) -> FloatArray:
    """(3, 3), [t]_x R with a translation t scaled to unit length."""
    x, y, z = (cam2_from_cam1.translation
               / np.linalg.norm(cam2_from_cam1.translation))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return cross @ cam2_from_cam1.rotation.matrix()


def estimate_generalized_relative_pose(
        points2D1: npt.ArrayLike, points2D2: npt.ArrayLike,
        camera_idxs1: npt.ArrayLike, camera_idxs2: npt.ArrayLike,
        cams_from_rig: Sequence[Rigid3d], cameras: Sequence[Camera],
        estimation_options: Any = None) -> Estimate:
    """The motion of a rig from matches of its cameras, by LO-RANSAC.

    Args:
      points2D1, points2D2: (N, 2) pixels, before and after the motion.
      camera_idxs1, camera_idxs2: (N,) indices of cameras.
      estimation_options: RANSACOptions.

    Returns rig2_from_rig1, whose length is known, num_inliers and inlier_mask.
    """
    ransac = _ransac(estimation_options)
    ransac["max_error"] *= float(np.mean(
        [1.0 / camera.mean_focal_length() for camera in cameras]))
    sides = [_rig_points(pixels, np.zeros((len(np.asarray(pixels)), 3)), idxs,
                         cams_from_rig, cameras)
             for pixels, idxs in ((points2D1, camera_idxs1),
                                  (points2D2, camera_idxs2))]
    (_, idxs1, rays1, _), (_, idxs2, rays2, _) = sides
    has_rays = np.isfinite(rays1).all(axis=1) & np.isfinite(rays2).all(axis=1)
    groups, rows = [], []
    for i in range(len(cameras)):
        for k in range(len(cameras)):
            own = np.flatnonzero((idxs1 == i) & (idxs2 == k) & has_rays)
            if len(own):
                groups.append((i, k, rays1[own], rays2[own]))
                rows.append(own)
    found = _core.estimate_rig_pair(
        np.array([pose.row() for pose in cams_from_rig]), groups, ransac)
    if found is None:
        return None
    mask = np.zeros(len(has_rays), dtype=bool)
    mask[np.concatenate(rows)] = np.concatenate(found[1])
    return {"rig2_from_rig1": Rigid3d.from_row(found[0]), **_mask(mask)}


# ------------------------------------------------- matrices and geometries


def estimate_fundamental_matrix(
        points2D1: npt.ArrayLike, points2D2: npt.ArrayLike,
        estimation_options: Any = None) -> Estimate:
    """The fundamental matrix of matching pixels (N, 2), by LO-RANSAC.

    Returns F with x2^T F x1 = 0, num_inliers and inlier_mask.
    """
    found = _core.estimate_matrix("F", points2D1, points2D2,
                                  _ransac(estimation_options))
    return found and {"F": found[0], **_mask(found[1])}


def estimate_homography_matrix(
        points2D1: npt.ArrayLike, points2D2: npt.ArrayLike,
        estimation_options: Any = None) -> Estimate:
    """The homography of matching pixels (N, 2), by LO-RANSAC.

    Returns H with x2 ~ H x1, num_inliers and inlier_mask.
    """
    found = _core.estimate_matrix("H", points2D1, points2D2,
                                  _ransac(estimation_options))
    return found and {"H": found[0], **_mask(found[1])}


def estimate_two_view_geometry(
        camera1: Camera, points1: npt.ArrayLike, camera2: Camera,
        points2: npt.ArrayLike, matches: Optional[npt.ArrayLike] = None,
        options: OptionsLike = None) -> TwoViewGeometry:
    """The two-view geometry of matches, as geometric_verifier computes it.

    Args:
      points1, points2: (N1, 2) and (N2, 2) pixels.
      matches: (M, 2) indices of points; None: point i matches point i.
      options: The group TwoViewGeometry of the options of commands.

    Returns a TwoViewGeometry; its config is DEGENERATE if too few agree.
    Cameras with has_prior_focal_length are calibrated.
    """
    rows = [(camera.model_name, camera.params, camera.width, camera.height,
             camera.has_prior_focal_length) for camera in (camera1, camera2)]
    if matches is None:
        idxs = np.arange(len(np.asarray(points1)))
        matches = np.column_stack([idxs, idxs])
    return TwoViewGeometry._of_row(_core.estimate_two_views(
        rows[0], points1, rows[1], points2, matches, to_texts(options)))


def estimate_calibrated_two_view_geometry(
        camera1: Camera, points1: npt.ArrayLike, camera2: Camera,
        points2: npt.ArrayLike, matches: Optional[npt.ArrayLike] = None,
        options: OptionsLike = None) -> TwoViewGeometry:
    """estimate_two_view_geometry for cameras whose intrinsics are known."""
    known = [Camera(c.camera_id, c.model_name, c.width, c.height, c.params,
                    has_prior_focal_length=True) for c in (camera1, camera2)]
    return estimate_two_view_geometry(known[0], points1, known[1], points2,
                                      matches, options)


def squared_sampson_error(points2D1: npt.ArrayLike, points2D2: npt.ArrayLike,
                          E: npt.ArrayLike) -> FloatArray:
    """(N,), of a fundamental matrix and pixels (N, 2), or of an essential
    matrix and points (N, 2) in the plane z = 1."""
    x1, x2 = (np.column_stack([np.asarray(x, dtype=np.float64),
                               np.ones(len(np.asarray(x)))])
              for x in (points2D1, points2D2))
    matrix: FloatArray = np.asarray(E, dtype=np.float64)
    lines2, lines1 = x1 @ matrix.T, x2 @ matrix
    gradients = np.column_stack([lines2[:, :2], lines1[:, :2]])
    errors: FloatArray = ((x2 * lines2).sum(axis=1) ** 2
                          / (gradients ** 2).sum(axis=1))
    return errors


# ------------------------------------------------------------ triangulation


def estimate_triangulation(points: npt.ArrayLike,
                           cams_from_world: Sequence[Rigid3d],
                           cameras: Sequence[Camera],
                           options: Any = None) -> Estimate:
    """A point from its observations in several images, robustly.

    Args:
      points: (N, 2) pixels.
      cams_from_world, cameras: Pose and intrinsics of each observation.
      options: EstimateTriangulationOptions.

    Returns xyz, (3,) in the world, num_inliers and inlier_mask.
    """
    options = _options(EstimateTriangulationOptions, options)
    pixels: FloatArray = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    max_error = options.ransac.max_error
    if options.residual_type == TriangulationResidualType.REPROJECTION_ERROR:
        max_error *= float(np.mean(
            [1.0 / camera.mean_focal_length() for camera in cameras] or [1.0]))
    if not len(pixels) == len(cameras) == len(cams_from_world):
        raise InputError("each point needs a camera and a pose")
    rays, centers = np.full((2, len(pixels), 3), np.nan)
    for i, (camera, pose) in enumerate(zip(cameras, cams_from_world)):
        ray = camera.cam_ray_from_img(pixels[i])
        if ray is not None:
            rays[i] = pose.rotation.inverse() * ray
            centers[i] = pose.tgt_origin_in_src()
    has_ray = np.isfinite(rays).all(axis=1)
    found = _core.triangulate(centers[has_ray], rays[has_ray], max_error,
                              options.min_tri_angle)
    if found is None:
        return None
    mask = np.zeros(len(pixels), dtype=bool)
    mask[has_ray] = found[1]
    return {"xyz": found[0], **_mask(mask)}


def calculate_triangulation_angle(
        proj_center1: npt.ArrayLike, proj_center2: npt.ArrayLike,
        point3D: npt.ArrayLike) -> float:
    """The angle in radians at a point (3,) between two centers (3,)."""
    centers = np.array([proj_center1, proj_center2], dtype=np.float64)
    return float(_core.triangulation_angles(np.atleast_2d(point3D), centers,
                                            np.array([0, 2]))[0])


# Names of pycolmap before 3.11.
absolute_pose_estimation = estimate_and_refine_absolute_pose
pose_refinement = refine_absolute_pose
essential_matrix_estimation = estimate_essential_matrix
fundamental_matrix_estimation = estimate_fundamental_matrix
homography_matrix_estimation = estimate_homography_matrix


def rig_absolute_pose_estimation(
        points2D: npt.ArrayLike, points3D: npt.ArrayLike,
        cameras: Sequence[Camera], cams_from_rig: Sequence[Rigid3d],
        camera_idxs: npt.ArrayLike, estimation_options: Any = None,
        refinement_options: Any = None,
        return_covariance: bool = False) -> Estimate:
    """estimate_and_refine_generalized_absolute_pose, in pycolmap's old order
    of arguments."""
    return estimate_and_refine_generalized_absolute_pose(
        points2D, points3D, camera_idxs, cams_from_rig, cameras,
        estimation_options, refinement_options, return_covariance)
