# SPDX-License-Identifier: BSD-3-Clause
"""Models in memory, with pycolmap's names."""

from __future__ import annotations

import copy
import os
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _core
from .cameras import Camera
from .editing import Editing
from .errors import InputError
from .geometry import AlignedBox3d, FloatArray, Rigid3d, Sim3d
from .points import Points3D
from .scene import INVALID_POINT3D_ID, Frame, Image, Points2D, Rig

PathLike = Union[str, "os.PathLike[str]"]


class Reconstruction(Editing):
    """A model.

    Attributes:
      cameras, rigs, frames, images: Dicts by id. Only registered images and
        their frames are in files.
      points3D: Points3D, a mapping by id.

    Poses, keypoints and points are numpy views of arrays that the
    reconstruction owns; changing them changes the reconstruction. Files of
    COLMAP before 3.12 have no rigs: each camera becomes a rig and each image a
    frame, as in COLMAP.
    """

    def __init__(self, path: Union[PathLike, "Reconstruction", None] = None
                 ) -> None:
        """Reads a model folder, .bin or .txt; copies a model; None: empty."""
        if isinstance(path, Reconstruction):
            self._set(copy.deepcopy(path._current_arrays()))
        else:
            self._set(_EMPTY if path is None else _core.read_model(Path(path)))

    def _set(self, arrays: Dict[str, Any]) -> None:
        self.points3D = Points3D(arrays)
        self.cameras = {row[0]: Camera(*row) for row in arrays["cameras"]}
        self.rigs: Dict[int, Rig] = {}
        self.frames: Dict[int, Frame] = {}
        if not arrays["frames"] and len(arrays["image_ids"]):
            _add_trivial_rigs(arrays)
        for rig_id, sensors in arrays["rigs"]:
            ref_camera_id = next(s[0] for s in sensors if s[1])
            poses = {s[0]: None if s[2] is None else Rigid3d.from_row(s[2])
                     for s in sensors}
            self.rigs[rig_id] = Rig(rig_id, ref_camera_id, poses)
        for frame_id, rig_id, row, image_ids in arrays["frames"]:
            self.frames[frame_id] = Frame(
                frame_id, self.rigs[rig_id],
                None if row is None else Rigid3d.from_row(row),
                list(image_ids))
        self.images = self._make_images(arrays)

    def _make_images(self, arrays: Dict[str, Any]) -> Dict[int, Image]:
        frame_of_image = {image_id: frame for frame in self.frames.values()
                          for image_id in frame.image_ids}
        offsets = arrays["keypoint_offsets"]
        images = {}
        for i, image_id in enumerate(arrays["image_ids"].tolist()):
            rows = slice(offsets[i], offsets[i + 1])
            camera = self.cameras[int(arrays["image_camera_ids"][i])]
            frame = frame_of_image[image_id]
            frame.camera_ids[image_id] = camera.camera_id
            images[image_id] = Image(
                arrays["image_names"][i],
                Points2D(arrays["keypoints_px"][rows],
                         arrays["keypoint_point_ids"][rows]),
                image_id=image_id, camera=camera, frame=frame)
        return images

    # ----------------------------------------------------------------- files

    def read(self, path: PathLike) -> None:
        """Replaces this model by that in a folder."""
        self._set(_core.read_model(Path(path)))

    def write(self, path: PathLike, format: str = "bin") -> None:
        """Writes the model into a folder as "bin" or "txt".

        Keypoints are rounded to single precision, as in databases, and points
        are numbered from 1. Raises InputError if tracks and keypoints
        contradict each other.
        """
        self.check()
        _core.write_model(Path(path), self._current_arrays(), format)

    def write_text(self, path: PathLike) -> None:
        self.write(path, "txt")

    def write_binary(self, path: PathLike) -> None:
        self.write(path)

    def export_PLY(self, output_path: PathLike) -> None:  # noqa: N802
        """Writes the points as .ply."""
        from .tools import convert_model
        convert_model(self, output_path, "ply")

    def to_pycolmap(self) -> Any:
        """The same model as a pycolmap.Reconstruction; needs pycolmap."""
        import pycolmap  # type: ignore[import]
        with tempfile.TemporaryDirectory() as folder:
            self.write(folder)
            return pycolmap.Reconstruction(folder)

    # --------------------------------------------------------------- content

    def camera(self, camera_id: int) -> Camera:
        return self.cameras[camera_id]

    def rig(self, rig_id: int) -> Rig:
        return self.rigs[rig_id]

    def frame(self, frame_id: int) -> Frame:
        return self.frames[frame_id]

    def image(self, image_id: int) -> Image:
        return self.images[image_id]

    def point3D(self, point3D_id: int) -> Any:
        return self.points3D[point3D_id]

    def exists_camera(self, camera_id: int) -> bool:
        return camera_id in self.cameras

    def exists_image(self, image_id: int) -> bool:
        return image_id in self.images

    def exists_point3D(self, point3D_id: int) -> bool:
        return point3D_id in self.points3D

    def num_cameras(self) -> int:
        return len(self.cameras)

    def num_rigs(self) -> int:
        return len(self.rigs)

    def num_frames(self) -> int:
        return len(self.frames)

    def num_reg_frames(self) -> int:
        return len(self.reg_frame_ids())

    def num_images(self) -> int:
        return len(self.images)

    def num_reg_images(self) -> int:
        return len(self.reg_image_ids())

    def num_points3D(self) -> int:
        return len(self.points3D)

    def reg_frame_ids(self) -> List[int]:
        return [i for i, frame in self.frames.items() if frame.has_pose()]

    def reg_image_ids(self) -> List[int]:
        return [i for i, image in self.images.items() if image.has_pose]

    def is_image_registered(self, image_id: int) -> bool:
        return self.images[image_id].has_pose

    def point3D_ids(self) -> List[int]:
        ids: List[int] = self.points3D.ids.tolist()
        return ids

    def find_image_with_name(self, name: str) -> Optional[Image]:
        return next((image for image in self.images.values()
                     if image.name == name), None)

    def find_common_reg_image_ids(self, other: "Reconstruction"
                                  ) -> List[Tuple[int, int]]:
        """The ids, here and there, of registered images of the same name."""
        theirs = {image.name: i for i, image in other.images.items()
                  if image.has_pose}
        return [(i, theirs[image.name]) for i, image in self.images.items()
                if image.has_pose and image.name in theirs]

    # ------------------------------------------------------------ statistics

    def compute_num_observations(self) -> int:
        return int(self.points3D.track_lengths().sum())

    def compute_mean_track_length(self) -> float:
        return self.compute_num_observations() / max(1, self.num_points3D())

    def compute_mean_observations_per_reg_image(self) -> float:
        return self.compute_num_observations() / max(1, self.num_reg_images())

    def compute_mean_reprojection_error(self) -> float:
        """Mean over the observations of points with a known error, in px."""
        is_known = self.points3D.error >= 0.0
        weights = self.points3D.track_lengths()[is_known]
        if not weights.any():
            return 0.0
        return float(np.average(self.points3D.error[is_known],
                                weights=weights))

    def compute_bounding_box(self, min_percentile: float = 0.0,
                             max_percentile: float = 1.0,
                             use_images: bool = False) -> AlignedBox3d:
        """The box of points, or of centers of images, between two quantiles
        in [0, 1] of each coordinate."""
        xyz = self._positions(use_images)
        if len(xyz) == 0:
            raise InputError("the model has no "
                             + ("registered image" if use_images else "point"))
        return AlignedBox3d(*np.quantile(xyz, [min_percentile, max_percentile],
                                         axis=0))

    def compute_centroid(self, min_percentile: float = 0.0,
                         max_percentile: float = 1.0,
                         use_images: bool = False) -> FloatArray:
        """(3,), the mean of each coordinate between two quantiles."""
        xyz = self._positions(use_images)
        low, high = self.compute_bounding_box(min_percentile, max_percentile,
                                              use_images)
        return np.array([axis[(axis >= a) & (axis <= b)].mean()
                         for axis, a, b in zip(xyz.T, low, high)])

    def _positions(self, use_images: bool) -> FloatArray:
        if not use_images:
            return self.points3D.xyz
        return np.array([image.projection_center()
                         for image in self.images.values()
                         if image.has_pose]).reshape(-1, 3)

    def summary(self) -> str:
        return (f"Reconstruction: {len(self.rigs)} rigs, "
                f"{len(self.cameras)} cameras, {len(self.frames)} frames, "
                f"{len(self.images)} images, {len(self.points3D)} points, "
                f"{self.compute_num_observations()} observations, "
                f"{self.compute_mean_reprojection_error():.3f} px")

    # ------------------------------------------------------------ transforms

    def transform(self, new_from_old_world: Sim3d) -> None:
        """Moves the world; lengths of rigs scale with it."""
        self.points3D.xyz[:] = new_from_old_world * self.points3D.xyz
        for frame in self.frames.values():
            if frame.rig_from_world is not None:
                frame.rig_from_world = (
                    new_from_old_world.transform_camera_world(
                        frame.rig_from_world))
        for rig in self.rigs.values():
            for pose in rig.sensors.values():
                if pose is not None:
                    pose.translation[:] *= new_from_old_world.scale

    def normalize(self, fixed_scale: bool = False, extent: float = 10.0,
                  min_percentile: float = 0.1, max_percentile: float = 0.9,
                  use_images: bool = True) -> Sim3d:
        """Moves the world to the centroid, and scales the box between two
        quantiles to a diagonal of `extent`. Returns new_from_old_world."""
        bounds = min_percentile, max_percentile, use_images
        diagonal = float(np.linalg.norm(
            self.compute_bounding_box(*bounds).diagonal()))
        scale = 1.0 if fixed_scale or diagonal == 0.0 else extent / diagonal
        transform = Sim3d(scale, None,
                          -scale * self.compute_centroid(*bounds))
        self.transform(transform)
        return transform

    def crop(self, bbox: Union[AlignedBox3d, Tuple[npt.ArrayLike,
                                                   npt.ArrayLike]]
             ) -> "Reconstruction":
        """A copy with the points in a box and the frames that observe one."""
        low, high = (np.asarray(corner, dtype=np.float64) for corner in bbox)
        cropped = Reconstruction(self)
        inside = AlignedBox3d(low, high).contains_point(cropped.points3D.xyz)
        cropped._keep_points(inside)
        for frame in list(cropped.frames.values()):
            if not any(cropped.images[i].num_points3D
                       for i in frame.image_ids):
                cropped.deregister_frame(frame.frame_id)
        cropped.tear_down()
        return cropped

    def _take_over(self, adjusted: "Reconstruction") -> None:
        """Takes over the values of a model with the same images and cameras."""
        for camera_id, camera in adjusted.cameras.items():
            if camera_id in self.cameras:
                self.cameras[camera_id].params = camera.params
        for rig_id, rig in adjusted.rigs.items():
            self.rigs[rig_id].sensors.update(rig.sensors)
        for frame in self.frames.values():
            if frame.frame_id in adjusted.frames:
                frame.rig_from_world = (
                    adjusted.frames[frame.frame_id].rig_from_world)
            else:
                frame.reset_pose()
        for image_id, image in self.images.items():
            image.points2D.point3D_ids[:] = (
                adjusted.images[image_id].points2D.point3D_ids
                if image_id in adjusted.images else INVALID_POINT3D_ID)
        self.points3D._take_over(adjusted.points3D)
        ids = self.points3D.arrays()["point_ids"]
        if not np.array_equal(ids, adjusted.points3D.ids):
            for image in self.images.values():
                rows = image.points2D.observed()
                image.points2D.point3D_ids[rows] = ids[
                    np.searchsorted(adjusted.points3D.ids,
                                    image.points2D.point3D_ids[rows])]

    # --------------------------------------------------------------- copies

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    def _current_arrays(self) -> Dict[str, Any]:
        images = list(self.images.values())
        lengths = [len(image.points2D) for image in images]
        arrays: Dict[str, Any] = self.points3D.arrays()
        arrays["image_names"] = [image.name for image in images]
        arrays["image_ids"] = np.array(list(self.images), dtype=np.uint32)
        arrays["image_camera_ids"] = np.array(
            [image.camera_id for image in images], dtype=np.uint32)
        arrays["keypoint_offsets"] = np.concatenate(
            [[0], np.cumsum(lengths)]).astype(np.int64)
        arrays["keypoints_px"] = np.concatenate(
            [np.empty((0, 2)), *(image.points2D.xy for image in images)])
        arrays["keypoint_point_ids"] = np.concatenate(
            [np.empty(0, np.uint64),
             *(image.points2D.point3D_ids for image in images)])
        return {**arrays, **self._structure_arrays()}

    def _structure_arrays(self) -> Dict[str, Any]:
        return {
            "cameras": [(c.camera_id, c.model_name, c.width, c.height, c.params)
                        for c in self.cameras.values()],
            "rigs": [rig_row(rig) for rig in self.rigs.values()],
            "frames": [(f.frame_id, f.rig_id,
                        f.rig_from_world and f.rig_from_world.row(),
                        f.image_ids) for f in self.frames.values()]}

    def _pose_copy(self) -> "Reconstruction":
        """A model with the same poses, but without keypoints and points."""
        other = Reconstruction()
        arrays = self._structure_arrays()
        other._set({
            **_EMPTY, **copy.deepcopy(arrays),
            "image_names": [image.name for image in self.images.values()],
            "image_ids": np.array(list(self.images), dtype=np.uint32),
            "image_camera_ids": np.array(
                [image.camera_id for image in self.images.values()]),
            "keypoint_offsets": np.zeros(len(self.images) + 1, np.int64)})
        return other

    def __copy__(self) -> "Reconstruction":
        return Reconstruction(self)

    def __deepcopy__(self, memo: Any) -> "Reconstruction":
        return Reconstruction(self)

    def __getstate__(self) -> Dict[str, Any]:
        return self._current_arrays()

    def __setstate__(self, state: Dict[str, Any]) -> None:
        self._set(state)


def rig_row(rig: Rig) -> Tuple[int, List[Tuple[int, bool, Any]]]:
    """A rig as _core takes it."""
    return rig.rig_id, [(camera_id, rig.is_ref_sensor(camera_id),
                         pose and pose.row())
                        for camera_id, pose in rig.sensors.items()]


_EMPTY: Dict[str, Any] = {
    "cameras": [], "rigs": [], "frames": [], "image_names": [],
    "image_ids": np.empty(0, np.uint32),
    "image_camera_ids": np.empty(0, np.uint32),
    "keypoints_px": np.empty((0, 2)),
    "keypoint_point_ids": np.empty(0, np.uint64),
    "keypoint_offsets": np.zeros(1, np.int64),
    "point_ids": np.empty(0, np.uint64), "xyz": np.empty((0, 3)),
    "rgb": np.empty((0, 3), np.uint8), "errors_px": np.empty(0),
    "track_elements": np.empty((0, 2), np.uint32),
    "track_offsets": np.zeros(1, np.int64)}


def _add_trivial_rigs(arrays: Dict[str, Any]) -> None:
    """One rig per camera, one frame per image."""
    identity = Rigid3d().row()
    arrays["rigs"] = [(row[0], [(row[0], True, identity.copy())])
                      for row in arrays["cameras"]]
    arrays["frames"] = [
        (int(image_id), int(camera_id), pose, [int(image_id)])
        for image_id, camera_id, pose in zip(
            arrays["image_ids"], arrays["image_camera_ids"],
            arrays["cam_from_world"])]
