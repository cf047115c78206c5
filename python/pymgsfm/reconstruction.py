# SPDX-License-Identifier: BSD-3-Clause
"""Models in memory, with pycolmap's attribute names."""

from __future__ import annotations

import os
import tempfile
from collections import abc
from pathlib import Path
from typing import (Any, Dict, Iterator, List, Mapping, NamedTuple, Optional,
                    Sequence, Union, overload)

import numpy as np
import numpy.typing as npt

from . import _core
from .geometry import FloatArray, Rigid3d

INVALID_POINT3D_ID = 2**64 - 1


class Camera:
    """Intrinsics.

    Attributes:
      camera_id
      model_name: Of COLMAP, such as "PINHOLE".
      width, height: In pixels.
      params: (K,) in COLMAP's order; lengths in pixels.
    """

    def __init__(self, camera_id: int, model_name: str, width: int, height: int,
                 params: npt.ArrayLike) -> None:
        self.camera_id = camera_id
        self.model_name = model_name
        self.width = width
        self.height = height
        self.params: FloatArray = np.asarray(params, dtype=np.float64)

    def __repr__(self) -> str:
        return (f"Camera(camera_id={self.camera_id}, model={self.model_name}, "
                f"width={self.width}, height={self.height}, "
                f"params={self.params.tolist()})")


class Rig:
    """Cameras mounted rigidly. A sensor is named by its camera id.

    Attributes:
      rig_id
      ref_camera_id: Its camera frame is the frame of the rig.
      sensors: Pose sensor_from_rig by camera id; the identity for the
        reference, None if unknown.
    """

    def __init__(self, rig_id: int, ref_camera_id: int,
                 sensors: Dict[int, Optional[Rigid3d]]) -> None:
        self.rig_id = rig_id
        self.ref_camera_id = ref_camera_id
        self.sensors = sensors

    def num_sensors(self) -> int:
        return len(self.sensors)

    def is_ref_sensor(self, camera_id: int) -> bool:
        return camera_id == self.ref_camera_id

    def sensor_from_rig(self, camera_id: int) -> Optional[Rigid3d]:
        """The pose of a camera in the rig."""
        return self.sensors[camera_id]

    def __repr__(self) -> str:
        return f"Rig(rig_id={self.rig_id}, cameras={list(self.sensors)})"


class Frame:
    """A rig at one instant.

    Attributes:
      frame_id, rig_id
      rig: The Rig.
      rig_from_world: Rigid3d; maps the world to the frame of the rig.
      image_ids: Of its images, at most one per sensor.
    """

    def __init__(self, frame_id: int, rig: Rig, rig_from_world: Rigid3d,
                 image_ids: List[int]) -> None:
        self.frame_id = frame_id
        self.rig = rig
        self.rig_from_world = rig_from_world
        self.image_ids = image_ids

    @property
    def rig_id(self) -> int:
        return self.rig.rig_id

    def __repr__(self) -> str:
        return (f"Frame(frame_id={self.frame_id}, rig_id={self.rig_id}, "
                f"image_ids={self.image_ids})")


class Point2D(NamedTuple):
    """A keypoint.

    Attributes:
      xy: (2,) pixels; (0.5, 0.5) is the center of the first pixel.
      point3D_id: INVALID_POINT3D_ID if it observes no point.
    """

    xy: FloatArray
    point3D_id: int

    def has_point3D(self) -> bool:
        return self.point3D_id != INVALID_POINT3D_ID


class Points2D(Sequence[Point2D]):
    """The keypoints of one image, as a sequence of Point2D and as arrays.

    Attributes:
      xy: (N, 2) pixels.
      point3D_ids: (N,) INVALID_POINT3D_ID where no point is observed.
    """

    def __init__(self, xy: FloatArray,
                 point3D_ids: npt.NDArray[np.uint64]) -> None:
        self.xy = xy
        self.point3D_ids = point3D_ids

    def __len__(self) -> int:
        return len(self.xy)

    @overload
    def __getitem__(self, index: int) -> Point2D: ...
    @overload
    def __getitem__(self, index: slice) -> "Points2D": ...

    def __getitem__(self, index: Union[int, slice]
                    ) -> Union[Point2D, "Points2D"]:
        if isinstance(index, slice):
            return Points2D(self.xy[index], self.point3D_ids[index])
        return Point2D(self.xy[index], int(self.point3D_ids[index]))


class Image:
    """A registered image.

    Attributes:
      image_id, camera_id, frame_id
      name: As in the database.
      camera, frame: The Camera and the Frame.
      points2D: Points2D, its keypoints.
    """

    def __init__(self, image_id: int, name: str, camera: Camera, frame: Frame,
                 points2D: Points2D) -> None:
        self.image_id = image_id
        self.name = name
        self.camera = camera
        self.frame = frame
        self.points2D = points2D

    @property
    def camera_id(self) -> int:
        return self.camera.camera_id

    @property
    def frame_id(self) -> int:
        return self.frame.frame_id

    def cam_from_world(self) -> Rigid3d:
        """sensor_from_rig * rig_from_world"""
        sensor_from_rig = self.frame.rig.sensor_from_rig(self.camera_id)
        assert sensor_from_rig is not None  # else the image has no pose
        return sensor_from_rig * self.frame.rig_from_world

    def projection_center(self) -> FloatArray:
        """(3,), in the world"""
        return self.cam_from_world().inverse().translation

    def viewing_direction(self) -> FloatArray:
        """(3,), unit vector in the world"""
        direction: FloatArray = self.cam_from_world().rotation.matrix()[2]
        return direction

    def num_points2D(self) -> int:
        return len(self.points2D)

    @property
    def num_points3D(self) -> int:
        return int(np.count_nonzero(
            self.points2D.point3D_ids != np.uint64(INVALID_POINT3D_ID)))

    def __repr__(self) -> str:
        return (f"Image(image_id={self.image_id}, name={self.name!r}, "
                f"camera_id={self.camera_id}, frame_id={self.frame_id})")


class TrackElement(NamedTuple):
    """One observation of a point."""

    image_id: int
    point2D_idx: int


class Track:
    """The observations of a point.

    Attributes:
      array: (N, 2) image ids and indices of keypoints.
    """

    def __init__(self, array: npt.NDArray[np.uint32]) -> None:
        self.array = array

    @property
    def elements(self) -> List[TrackElement]:
        return [TrackElement(int(i), int(k)) for i, k in self.array]

    def length(self) -> int:
        return len(self.array)


class Point3D:
    """A point; its arrays are views of those of the reconstruction.

    Attributes:
      xyz: (3,) in the world.
      color: (3,) red, green, blue, 0 to 255.
      error: Mean reprojection error in pixels; -1: unknown.
      track: Track, its observations.
    """

    def __init__(self, xyz: FloatArray, color: npt.NDArray[np.uint8],
                 error: float, track: Track) -> None:
        self.xyz = xyz
        self.color = color
        self.error = error
        self.track = track

    def __repr__(self) -> str:
        return f"Point3D(xyz={self.xyz.tolist()}, error={self.error:.3g})"


class Points3D(Mapping[int, Point3D]):
    """The points of a model by id, and as arrays.

    Attributes:
      ids: (N,) ascending.
      xyz: (N, 3) in the world.
      color: (N, 3) red, green, blue, 0 to 255.
      error: (N,) mean reprojection errors in pixels; -1: unknown.
    """

    def __init__(self, arrays: Dict[str, Any]) -> None:
        self.ids: npt.NDArray[np.uint64] = arrays["point_ids"]
        self.xyz: FloatArray = arrays["xyz"]
        self.color: npt.NDArray[np.uint8] = arrays["rgb"]
        self.error: FloatArray = arrays["errors_px"]
        self._track: npt.NDArray[np.uint32] = arrays["track_elements"]
        self._offsets: npt.NDArray[np.int64] = arrays["track_offsets"]

    def __getitem__(self, point3D_id: int) -> Point3D:
        row = int(np.searchsorted(self.ids, np.uint64(point3D_id)))
        if row == len(self.ids) or int(self.ids[row]) != point3D_id:
            raise KeyError(point3D_id)
        track = self._track[self._offsets[row]:self._offsets[row + 1]]
        return Point3D(self.xyz[row], self.color[row], float(self.error[row]),
                       Track(track))

    def __iter__(self) -> Iterator[int]:
        return map(int, self.ids)

    def __len__(self) -> int:
        return len(self.ids)

    def track_lengths(self) -> npt.NDArray[np.int64]:
        """(N,) numbers of observations"""
        return np.diff(self._offsets)


class Reconstruction:
    """A model.

    Attributes:
      cameras, rigs, frames, images: Dicts by id. Only registered images and
        their frames are there.
      points3D: Points3D, a mapping by id.

    Poses, keypoints and points are numpy views of arrays that the
    reconstruction owns; changing them changes the reconstruction. Files of
    COLMAP before 3.12 have no rigs: each camera becomes a rig and each image a
    frame, as in COLMAP.
    """

    def __init__(self, path: Union[str, "os.PathLike[str]"]) -> None:
        """Reads a model folder, .bin or .txt."""
        self._set(_core.read_model(Path(path)))

    def _set(self, arrays: Dict[str, Any]) -> None:
        self._arrays = arrays
        self.points3D = Points3D(arrays)
        self.cameras = {row[0]: Camera(*row) for row in arrays["cameras"]}
        self.rigs: Dict[int, Rig] = {}
        self.frames: Dict[int, Frame] = {}
        if not arrays["frames"]:
            _add_trivial_rigs(arrays)
        for rig_id, sensors in arrays["rigs"]:
            ref_camera_id = next(s[0] for s in sensors if s[1])
            poses = {s[0]: None if s[2] is None else Rigid3d.from_row(s[2])
                     for s in sensors}
            self.rigs[rig_id] = Rig(rig_id, ref_camera_id, poses)
        for frame_id, rig_id, row, image_ids in arrays["frames"]:
            self.frames[frame_id] = Frame(frame_id, self.rigs[rig_id],
                                          Rigid3d.from_row(row), image_ids)
        self.images = self._make_images(arrays)

    def _make_images(self, arrays: Dict[str, Any]) -> Dict[int, Image]:
        frame_of_image = {image_id: frame for frame in self.frames.values()
                          for image_id in frame.image_ids}
        offsets = arrays["keypoint_offsets"]
        images = {}
        for i, image_id in enumerate(arrays["image_ids"].tolist()):
            rows = slice(offsets[i], offsets[i + 1])
            images[image_id] = Image(
                image_id, arrays["image_names"][i],
                self.cameras[int(arrays["image_camera_ids"][i])],
                frame_of_image[image_id],
                Points2D(arrays["keypoints_px"][rows],
                         arrays["keypoint_point_ids"][rows]))
        return images

    def write(self, path: Union[str, "os.PathLike[str]"],
              format: str = "bin") -> None:
        """Writes the model into a folder as "bin" or "txt".

        Keypoints are rounded to single precision, as in databases, and points
        are numbered from 1.
        """
        _core.write_model(Path(path), self._current_arrays(), format)

    def write_text(self, path: Union[str, "os.PathLike[str]"]) -> None:
        self.write(path, "txt")

    def num_reg_images(self) -> int:
        return len(self.images)

    def reg_image_ids(self) -> List[int]:
        return list(self.images)

    def num_frames(self) -> int:
        return len(self.frames)

    def num_points3D(self) -> int:
        return len(self.points3D)

    def compute_num_observations(self) -> int:
        return int(self._arrays["track_offsets"][-1])

    def compute_mean_reprojection_error(self) -> float:
        """Mean over the observations of points with a known error, in px."""
        is_known = self.points3D.error >= 0.0
        weights = self.points3D.track_lengths()[is_known]
        if not weights.any():
            return 0.0
        return float(np.average(self.points3D.error[is_known],
                                weights=weights))

    def find_image_with_name(self, name: str) -> Optional[Image]:
        return next((image for image in self.images.values()
                     if image.name == name), None)

    def summary(self) -> str:
        return (f"Reconstruction: {len(self.rigs)} rigs, "
                f"{len(self.cameras)} cameras, {len(self.frames)} frames, "
                f"{len(self.images)} images, {len(self.points3D)} points, "
                f"{self.compute_num_observations()} observations, "
                f"{self.compute_mean_reprojection_error():.3f} px")

    def to_pycolmap(self) -> Any:
        """The same model as a pycolmap.Reconstruction; needs pycolmap."""
        import pycolmap  # type: ignore[import]
        with tempfile.TemporaryDirectory() as folder:
            self.write(folder)
            return pycolmap.Reconstruction(folder)

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    def _current_arrays(self) -> Dict[str, Any]:
        arrays = dict(self._arrays)
        arrays["cameras"] = [(c.camera_id, c.model_name, c.width, c.height,
                              c.params) for c in self.cameras.values()]
        arrays["rigs"] = [(rig.rig_id, [
            (camera_id, rig.is_ref_sensor(camera_id),
             None if pose is None else pose.row())
            for camera_id, pose in rig.sensors.items()])
            for rig in self.rigs.values()]
        arrays["frames"] = [(f.frame_id, f.rig_id, f.rig_from_world.row(),
                             f.image_ids) for f in self.frames.values()]
        return arrays

    def __getstate__(self) -> Dict[str, Any]:
        return self._current_arrays()

    def __setstate__(self, state: Dict[str, Any]) -> None:
        self._set(state)


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
