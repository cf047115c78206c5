# SPDX-License-Identifier: BSD-3-Clause
"""Alignment and comparison of models, with pycolmap's names.

The transforms of models are those of model_aligner.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Dict, NamedTuple, Optional, Sequence

import numpy as np
import numpy.typing as npt

from .commands import log_to_logging, run
from .errors import InputError
from .geometry import FloatArray, Rigid3d, Sim3d
from .options import Options
from .reconstruction import Reconstruction


def align_reconstructions_via_proj_centers(
        src_reconstruction: Reconstruction, tgt_reconstruction: Reconstruction,
        max_proj_center_error: float) -> Optional[Sim3d]:
    """tgt_from_src, by the poses of images of the same name.

    Args:
      max_proj_center_error: Distance of inliers after alignment, in the unit of
        the target.

    Returns None if fewer than three images, or a quarter of them, agree.
    """
    return _align(src_reconstruction, tgt_reconstruction,
                  {"alignment_max_error": max_proj_center_error})


def align_reconstructions_via_reprojections(
        src_reconstruction: Reconstruction, tgt_reconstruction: Reconstruction,
        min_inlier_observations: float = 0.3,
        max_reproj_error: float = 8.0) -> Optional[Sim3d]:
    """tgt_from_src, by the poses of images of the same name.

    Returns None unless the fraction min_inlier_observations of the keypoints
    with points in both models agrees: moved to the other model, the point has
    at most the error max_reproj_error in pixels.
    """
    tgt_from_src = _align(src_reconstruction, tgt_reconstruction,
                          {"alignment_max_error": 1e6})
    if tgt_from_src is None:
        return None
    errors = [np.maximum(*errors) for errors in _cross_errors(
        src_reconstruction, tgt_reconstruction, tgt_from_src)]
    agrees = np.concatenate([np.empty(0), *errors]) <= max_reproj_error
    if not agrees.size or agrees.mean() < min_inlier_observations:
        return None
    return tgt_from_src


def align_reconstruction_to_locations(
        src: Reconstruction, tgt_image_names: Sequence[str],
        tgt_locations: npt.ArrayLike, min_common_images: int = 3,
        ransac_options: Any = None) -> Optional[Sim3d]:
    """tgt_from_src, by measured centers of images.

    Args:
      tgt_image_names: (N,)
      tgt_locations: (N, 3)
      ransac_options: Its max_error is the distance of inliers, in the unit of
        the locations.

    Returns None if too few images have a location or agree.
    """
    locations: FloatArray = np.asarray(tgt_locations, dtype=np.float64)
    if locations.shape != (len(tgt_image_names), 3):
        raise InputError("tgt_locations must have the shape (N, 3), with a row "
                         "per name")
    lines = [f"{name} {x!r} {y!r} {z!r}\n" for name, (x, y, z)
             in zip(tgt_image_names, locations.tolist())]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "locations.txt"
        path.write_text("".join(lines), encoding="utf-8")
        options = {"ref_images_path": path, "ref_is_gps": False,
                   "min_common_images": min_common_images}
        if ransac_options is not None:
            options["alignment_max_error"] = ransac_options.max_error
        return _align(src, None, options)


class ImageAlignmentError(NamedTuple):
    """The difference of an image between two models.

    Attributes:
      image_name
      rotation_error_deg: In degrees.
      proj_center_error: In the unit of the second model.
    """

    image_name: str
    rotation_error_deg: float
    proj_center_error: float


def compare_reconstructions(
        reconstruction1: Reconstruction, reconstruction2: Reconstruction,
        alignment_error: str = "reprojection",
        min_inlier_observations: float = 0.3, max_reproj_error: float = 8.0,
        max_proj_center_error: float = 0.1) -> Optional[Dict[str, Any]]:
    """Aligns two models and compares images of the same name.

    Args:
      alignment_error: "reprojection" or "proj_center", which says what must
        agree.

    Returns rec2_from_rec1, a Sim3d, and errors, a list of ImageAlignmentError;
    None if the models do not agree.
    """
    if alignment_error == "reprojection":
        transform = align_reconstructions_via_reprojections(
            reconstruction1, reconstruction2, min_inlier_observations,
            max_reproj_error)
    elif alignment_error == "proj_center":
        transform = align_reconstructions_via_proj_centers(
            reconstruction1, reconstruction2, max_proj_center_error)
    else:
        raise InputError("alignment_error must be reprojection or proj_center")
    if transform is None:
        return None
    errors = []
    for i, k in reconstruction1.find_common_reg_image_ids(reconstruction2):
        image = reconstruction1.images[i]
        moved = transform.transform_camera_world(image.cam_from_world)
        true = reconstruction2.images[k].cam_from_world
        errors.append(ImageAlignmentError(
            image.name,
            float(np.rad2deg(moved.rotation.angle_to(true.rotation))),
            float(np.linalg.norm(moved.tgt_origin_in_src()
                                 - true.tgt_origin_in_src()))))
    return {"rec2_from_rec1": transform, "errors": errors}


def estimate_sim3d(src: npt.ArrayLike, tgt: npt.ArrayLike) -> Optional[Sim3d]:
    """tgt_from_src of points (N, 3), by least squares (Umeyama 1991).

    None for fewer than three points or points on a line.
    """
    return _fit(src, tgt, True)


def estimate_rigid3d(src: npt.ArrayLike, tgt: npt.ArrayLike
                     ) -> Optional[Rigid3d]:
    """estimate_sim3d with scale 1."""
    fit = _fit(src, tgt, False)
    return None if fit is None else Rigid3d(fit.rotation, fit.translation)


def _fit(src: npt.ArrayLike, tgt: npt.ArrayLike,
         has_scale: bool) -> Optional[Sim3d]:
    x: FloatArray = np.asarray(src, dtype=np.float64)
    y: FloatArray = np.asarray(tgt, dtype=np.float64)
    if x.shape != y.shape or x.shape[1:] != (3,):
        raise InputError("src and tgt must have the shape (N, 3)")
    if len(x) < 3:
        return None
    x_mean, y_mean = x.mean(axis=0), y.mean(axis=0)
    U, values, Vt = np.linalg.svd((y - y_mean).T @ (x - x_mean))
    if not values[1] > 1e-12 * values[0]:
        return None
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    scale = ((values * signs).sum() / ((x - x_mean) ** 2).sum()
             if has_scale else 1.0)
    R = (U * signs) @ Vt
    return Sim3d(float(scale), R, y_mean - scale * R @ x_mean)


def _align(model: Reconstruction, reference: Optional[Reconstruction],
           values: Dict[str, Any]) -> Optional[Sim3d]:
    options = Options("model_aligner", values)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "transform.txt"
        try:
            run("model_aligner", options, input_path=model._pose_copy(),
                output_path=Path(folder) / "model", transform_path=path,
                ref_model_path=reference and reference._pose_copy())
        except InputError as error:  # the options are valid: no agreement
            log_to_logging("warning", str(error))
            return None
        numbers = list(map(float, path.read_text(encoding="utf-8").split()))
    scale, w, x, y, z = numbers[:5]
    return Sim3d(scale, [x, y, z, w], numbers[5:])


def _cross_errors(src: Reconstruction, tgt: Reconstruction,
                  tgt_from_src: Sim3d) -> Any:
    """For each common image, the errors in both models, (2, N) in pixels, of
    the points of the other model."""
    src_from_tgt = tgt_from_src.inverse()
    for i, k in src.find_common_reg_image_ids(tgt):
        a, b = src.images[i], tgt.images[k]
        num = min(len(a.points2D), len(b.points2D))
        rows = np.intersect1d(a.points2D.observed(), b.points2D.observed())
        rows = rows[rows < num]
        errors = []
        for image, model, other, move in ((a, tgt, b, src_from_tgt),
                                          (b, src, a, tgt_from_src)):
            points = model.points3D
            xyz = points.xyz[np.searchsorted(points.ids,
                                             other.points2D.point3D_ids[rows])]
            error = np.linalg.norm(image.project_point(move * xyz)
                                   - image.points2D.xy[rows], axis=1)
            errors.append(np.where(np.isfinite(error), error, np.inf))
        yield np.array(errors)
