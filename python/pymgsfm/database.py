# SPDX-License-Identifier: BSD-3-Clause
"""Databases of COLMAP, with pycolmap's names.

    with pymgsfm.Database.open("database.db") as database:
        for image in database.read_all_images():
            print(image.name, database.num_keypoints_for_image(image.image_id))
"""

from __future__ import annotations

import enum
import os
from typing import Any, Dict, List, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _core
from .cameras import INVALID_ID, Camera, SensorType, data_t, sensor_t
from .errors import InputError
from .estimators import TwoViewGeometry
from .geometry import FloatArray, Rigid3d
from .reconstruction import rig_row
from .scene import Frame, Image, Rig

PathLike = Union[str, "os.PathLike[str]"]
Matches = npt.NDArray[np.uint32]

_MAX_NUM_IMAGES = 2147483647


def image_pair_to_pair_id(image_id1: int, image_id2: int) -> int:
    """The number of a pair in a database; the same for both orders."""
    low, high = sorted((image_id1, image_id2))
    return _MAX_NUM_IMAGES * low + high


def pair_id_to_image_pair(pair_id: int) -> Tuple[int, int]:
    """The images of a pair, the smaller id first."""
    return divmod(pair_id, _MAX_NUM_IMAGES)


class PosePriorCoordinateSystem(enum.IntEnum):
    """WGS84: latitude and longitude in degrees, altitude in meters."""

    UNDEFINED = -1
    WGS84 = 0
    CARTESIAN = 1


class PosePrior:
    """The measured position of an image, and direction of gravity.

    Attributes:
      image_id
      position: (3,) of the camera center.
      position_covariance: (3, 3); None if unknown.
      coordinate_system: PosePriorCoordinateSystem.
      gravity: (3,) in the camera frame; None if unknown.
    """

    def __init__(self, position: npt.ArrayLike = (np.nan,) * 3,
                 position_covariance: Optional[npt.ArrayLike] = None,
                 coordinate_system: int = PosePriorCoordinateSystem.UNDEFINED,
                 *, gravity: Optional[npt.ArrayLike] = None,
                 image_id: int = INVALID_ID) -> None:
        self.image_id = image_id
        self.position: FloatArray = np.asarray(position, dtype=np.float64)
        self.position_covariance: Optional[FloatArray] = (
            None if position_covariance is None
            else np.asarray(position_covariance, dtype=np.float64))
        self.coordinate_system = PosePriorCoordinateSystem(coordinate_system)
        self.gravity: Optional[FloatArray] = (
            None if gravity is None else np.asarray(gravity, dtype=np.float64))

    @property
    def corr_data_id(self) -> data_t:
        return data_t(sensor_t(SensorType.CAMERA, INVALID_ID), self.image_id)

    @corr_data_id.setter
    def corr_data_id(self, data_id: data_t) -> None:
        self.image_id = data_id.id

    def is_valid(self) -> bool:
        """Whether it has a position."""
        return bool(np.isfinite(self.position).all())

    def is_covariance_valid(self) -> bool:
        return (self.position_covariance is not None
                and bool(np.isfinite(self.position_covariance).all()))

    def __repr__(self) -> str:
        return (f"PosePrior(image_id={self.image_id}, "
                f"position={self.position.tolist()}, "
                f"coordinate_system={self.coordinate_system.name})")


class Database:
    """An open database of COLMAP 3.8 to 4.2; a new file if there is none.

    It is locked until close() or the end of `with`, so that commands cannot use
    it in between; one that is open read-only is not. Each write is a transaction
    unless a DatabaseTransaction groups several. Rigs and frames are written
    when the transaction or the database is closed.
    """

    def __init__(self, path: PathLike, read_only: bool = False) -> None:
        self._database = _core.OpenDatabase(os.fspath(path), read_only)
        self._structure: Optional[_Structure] = None
        self._rigs: Optional[Dict[int, Rig]] = None  # to be written
        self._frames: Dict[int, Frame] = {}

    @staticmethod
    def open(path: PathLike, read_only: bool = False) -> "Database":
        return Database(path, read_only)

    def close(self) -> None:
        try:
            self._write_rigs()
        finally:
            self._database.close()

    def __del__(self) -> None:
        if hasattr(self, "_frames"):  # else the file could not be opened
            self.close()

    def __enter__(self) -> "Database":
        return self

    def __exit__(self, kind: Any, *error: Any) -> None:
        if kind is not None:
            self._rigs = None
        self.close()

    # --------------------------------------- cameras, images, rigs, frames

    def _read(self) -> "_Structure":
        if self._structure is None:
            self._structure = _Structure(self._database.read_structure())
        return self._structure

    def read_all_cameras(self) -> List[Camera]:
        return [self.read_camera(i) for i in self._read().cameras]

    def read_camera(self, camera_id: int) -> Camera:
        _, name, width, height, params, has_prior = _find(
            self._read().cameras, camera_id, "camera")
        return Camera(camera_id, name, width, height, params.copy(),
                      has_prior_focal_length=has_prior)

    def exists_camera(self, camera_id: int) -> bool:
        return camera_id in self._read().cameras

    def num_cameras(self) -> int:
        return len(self._read().cameras)

    def write_camera(self, camera: Camera, use_camera_id: bool = False) -> int:
        """Adds a camera, with the next id unless use_camera_id. Returns it."""
        cameras = self._read().cameras
        camera_id = self._database.add_camera(
            camera._row(),
            _free_id(cameras, camera.camera_id if use_camera_id else None,
                     "camera"))
        cameras[camera_id] = (camera_id, *camera._row()[1:])
        return camera_id

    def update_camera(self, camera: Camera) -> None:
        self.read_camera(camera.camera_id)
        self._database.update_camera(camera._row())
        self._read().cameras[camera.camera_id] = camera._row()

    def read_all_images(self) -> List[Image]:
        """Without keypoints."""
        return [self.read_image(i) for i in self._read().images]

    def read_image(self, image_id: int) -> Image:
        name, camera_id = _find(self._read().images, image_id, "image")
        return Image(name, camera_id=camera_id, image_id=image_id)

    def read_image_with_name(self, name: str) -> Optional[Image]:
        image_id = self._read().image_ids.get(name)
        return None if image_id is None else self.read_image(image_id)

    def exists_image(self, image: Union[int, str]) -> bool:
        """Whether there is an image with this id or name."""
        return (image in self._read().image_ids if isinstance(image, str)
                else image in self._read().images)

    def num_images(self) -> int:
        return len(self._read().images)

    def write_image(self, image: Image, use_image_id: bool = False) -> int:
        """Adds an image, with the next id unless use_image_id. Returns it."""
        if not self.exists_camera(image.camera_id):
            raise InputError(f"the database has no camera {image.camera_id} of "
                             f"the image '{image.name}'")
        if self.exists_image(image.name):
            raise InputError(f"the database has an image '{image.name}'")
        image_id = self._database.add_image(
            image.name, image.camera_id,
            _free_id(self._read().images,
                     image.image_id if use_image_id else None, "image"))
        self._read().add_image(image_id, image.name, image.camera_id)
        return image_id

    def _read_rigs(self) -> Tuple[Dict[int, Rig], Dict[int, Frame]]:
        if self._rigs is not None:
            return self._rigs, self._frames
        rigs, frames = {}, {}
        for rig_id, sensors in self._read().rigs:
            ref_id = next((row[0] for row in sensors if row[1]), INVALID_ID)
            rigs[rig_id] = Rig(rig_id, ref_id, {
                row[0]: None if row[2] is None else Rigid3d.from_row(row[2])
                for row in sensors})
        for frame_id, rig_id, data in self._read().frames:
            frame = frames[frame_id] = Frame(frame_id, rig_id=rig_id)
            for camera_id, image_id in data:
                frame.add_data_id(data_t(
                    sensor_t(SensorType.CAMERA, camera_id), image_id))
        return rigs, frames

    def _change_rigs(self) -> Tuple[Dict[int, Rig], Dict[int, Frame]]:
        self._rigs, self._frames = self._read_rigs()
        return self._rigs, self._frames

    def _write_rigs(self) -> None:
        if self._rigs is None:
            return
        rigs, frames = self._rigs, self._frames
        self._rigs, self._structure = None, None
        self._database.write_rigs_and_frames(
            [rig_row(rigs[i]) for i in sorted(rigs)],
            [(i, frames[i].rig_id,
              [(data.sensor_id.id, data.id) for data in frames[i].data_ids])
             for i in sorted(frames)])

    def read_all_rigs(self) -> List[Rig]:
        return list(self._read_rigs()[0].values())

    def read_rig(self, rig_id: int) -> Rig:
        rig: Rig = _find(self._read_rigs()[0], rig_id, "rig")
        return rig

    def exists_rig(self, rig_id: int) -> bool:
        return rig_id in self._read_rigs()[0]

    def num_rigs(self) -> int:
        return len(self._read_rigs()[0])

    def write_rig(self, rig: Rig, use_rig_id: bool = False) -> int:
        """Adds a rig, with the next id unless use_rig_id. Returns it."""
        rigs = self._change_rigs()[0]
        rig_id = (_free_id(rigs, rig.rig_id if use_rig_id else None, "rig")
                  or max(rigs, default=0) + 1)
        self._change_rigs()[0][rig_id] = Rig(rig_id, rig.ref_camera_id,
                                             dict(rig.sensors))
        return rig_id

    def update_rig(self, rig: Rig) -> None:
        self.read_rig(rig.rig_id)
        self._change_rigs()[0][rig.rig_id] = rig

    def read_all_frames(self) -> List[Frame]:
        return list(self._read_rigs()[1].values())

    def read_frame(self, frame_id: int) -> Frame:
        frame: Frame = _find(self._read_rigs()[1], frame_id, "frame")
        return frame

    def exists_frame(self, frame_id: int) -> bool:
        return frame_id in self._read_rigs()[1]

    def num_frames(self) -> int:
        return len(self._read_rigs()[1])

    def write_frame(self, frame: Frame, use_frame_id: bool = False) -> int:
        """Adds a frame, with the next id unless use_frame_id. Returns it."""
        self.read_rig(frame.rig_id)
        frames = self._change_rigs()[1]
        frame_id = (_free_id(frames, frame.frame_id if use_frame_id else None,
                             "frame") or max(frames, default=0) + 1)
        added = Frame(frame_id, rig_id=frame.rig_id)
        for data_id in frame.data_ids:
            added.add_data_id(data_id)
        self._change_rigs()[1][frame_id] = added
        return frame_id

    # ------------------------------------------------------------- features

    def _check_image(self, *image_ids: int) -> None:
        for image_id in image_ids:
            if not self.exists_image(image_id):
                raise InputError(f"the database has no image {image_id}")

    def num_keypoints(self) -> int:
        return sum(count for _, count in self._database.count_keypoints())

    def num_keypoints_for_image(self, image_id: int) -> int:
        return dict(self._database.count_keypoints()).get(image_id, 0)

    def exists_keypoints(self, image_id: int) -> bool:
        return self._database.has_keypoints(image_id)

    def read_keypoints(self, image_id: int) -> npt.NDArray[np.float32]:
        """(N, 6): x and y in pixels, then the affine shape by rows."""
        return self._database.read_keypoints(image_id)

    def write_keypoints(self, image_id: int, keypoints: npt.ArrayLike) -> None:
        """Keypoints are (N, 2), (N, 4) with scale and orientation, or (N, 6)."""
        self._check_image(image_id)
        self._database.write_keypoints(image_id, keypoints)

    update_keypoints = write_keypoints

    def exists_descriptors(self, image_id: int) -> bool:
        return self._database.has_descriptors(image_id)

    def read_descriptors(self, image_id: int) -> npt.NDArray[np.uint8]:
        """(N, 128), of SIFT."""
        return self._database.read_descriptors(image_id)

    def write_descriptors(self, image_id: int,
                          descriptors: npt.ArrayLike) -> None:
        """Descriptors are (N, 128), of SIFT."""
        self._check_image(image_id)
        self._database.write_descriptors(image_id, descriptors)

    def exists_matches(self, image_id1: int, image_id2: int) -> bool:
        return self._database.has_matches(image_id1, image_id2)

    def read_matches(self, image_id1: int, image_id2: int) -> Matches:
        """(N, 2), indices of keypoints of image 1 and of image 2."""
        return self._database.read_matches(image_id1, image_id2)

    def read_all_matches(self) -> Tuple[List[int], List[Matches]]:
        """The ids of pairs, and their matches with the smaller id first."""
        return self._all(self._database.count_matches(), self.read_matches)

    def write_matches(self, image_id1: int, image_id2: int,
                      matches: npt.ArrayLike) -> None:
        """(N, 2), indices of keypoints of image 1 and of image 2."""
        self._check_image(image_id1, image_id2)
        self._database.write_matches(image_id1, image_id2, matches)

    def num_matches(self) -> int:
        return int(self._database.count_matches()[1].sum())

    def num_matched_image_pairs(self) -> int:
        return int((self._database.count_matches()[1] > 0).sum())

    def exists_two_view_geometry(self, image_id1: int, image_id2: int) -> bool:
        return self._database.has_geometry(image_id1, image_id2)

    def read_two_view_geometry(self, image_id1: int,
                               image_id2: int) -> TwoViewGeometry:
        """From image 1 to image 2; without matches if there is none."""
        row = self._database.read_geometry(image_id1, image_id2)
        return TwoViewGeometry() if row is None else TwoViewGeometry._of_row(row)

    def read_two_view_geometries(self
                                 ) -> Tuple[List[int], List[TwoViewGeometry]]:
        """The ids of pairs, and their geometries with the smaller id first."""
        return self._all(self._database.count_inlier_matches(),
                         self.read_two_view_geometry)

    def read_two_view_geometry_num_inliers(self
                                           ) -> Tuple[List[int], List[int]]:
        """The ids of pairs, and their numbers of inliers."""
        pairs, counts = self._database.count_inlier_matches()
        return ([image_pair_to_pair_id(*pair) for pair in pairs.tolist()],
                counts.tolist())

    def write_two_view_geometry(self, image_id1: int, image_id2: int,
                                two_view_geometry: TwoViewGeometry) -> None:
        self._check_image(image_id1, image_id2)
        self._database.write_geometry(image_id1, image_id2,
                                      two_view_geometry._row())

    update_two_view_geometry = write_two_view_geometry

    def num_inlier_matches(self) -> int:
        return int(self._database.count_inlier_matches()[1].sum())

    def num_verified_image_pairs(self) -> int:
        return int((self._database.count_inlier_matches()[1] > 0).sum())

    @staticmethod
    def _all(counts: Any, read: Any) -> Tuple[List[int], List[Any]]:
        pairs = counts[0].tolist()
        return ([image_pair_to_pair_id(*pair) for pair in pairs],
                [read(*pair) for pair in pairs])

    def clear_matches(self) -> None:
        self._database.delete_matches()

    def clear_two_view_geometries(self) -> None:
        self._database.delete_geometries()

    # --------------------------------------------------------------- priors

    def read_all_pose_priors(self) -> List[PosePrior]:
        return [PosePrior(position, covariance, system, gravity=gravity,
                          image_id=image_id)
                for image_id, system, position, covariance, gravity
                in self._database.read_priors()]

    def read_pose_prior(self, image_id: int) -> PosePrior:
        prior: PosePrior = _find(
            {p.image_id: p for p in self.read_all_pose_priors()}, image_id,
            "pose prior of image")
        return prior

    def exists_pose_prior(self, image_id: int) -> bool:
        return any(prior.image_id == image_id
                   for prior in self.read_all_pose_priors())

    def num_pose_priors(self) -> int:
        return len(self.read_all_pose_priors())

    def write_pose_prior(self, *arguments: Any) -> None:
        """write_pose_prior(prior), or (image_id, prior) as in pycolmap before
        4; replaces that of the image."""
        prior: PosePrior = arguments[-1]
        image_id = arguments[0] if len(arguments) == 2 else prior.image_id
        self._check_image(image_id)
        self._database.write_prior((
            image_id, int(prior.coordinate_system), prior.position,
            prior.position_covariance, prior.gravity))

    update_pose_prior = write_pose_prior


class DatabaseTransaction:
    """Groups the writes within `with`: all of them happen, or none if an
    exception is raised."""

    def __init__(self, database: Database) -> None:
        self._owner = database

    def __enter__(self) -> "DatabaseTransaction":
        self._owner._database.begin()
        return self

    def __exit__(self, kind: Any, *error: Any) -> None:
        if kind is None:
            self._owner._write_rigs()
            self._owner._database.commit()
        else:
            self._owner._rigs = self._owner._structure = None
            self._owner._database.rollback()


def _find(items: Dict[int, Any], item_id: int, kind: str) -> Any:
    if item_id not in items:
        raise InputError(f"the database has no {kind} {item_id}")
    return items[item_id]


def _free_id(items: Dict[int, Any], item_id: Optional[int],
             kind: str) -> Optional[int]:
    if item_id in items:
        raise InputError(f"the database has a {kind} {item_id}")
    return item_id


class _Structure:
    """The rows of cameras, images, rigs and frames."""

    def __init__(self, rows: Dict[str, Any]) -> None:
        self.cameras: Dict[int, Any] = {row[0]: row for row in rows["cameras"]}
        self.images: Dict[int, Tuple[str, int]] = {}
        self.image_ids: Dict[str, int] = {}
        for row in rows["images"]:
            self.add_image(*row)
        self.rigs, self.frames = rows["rigs"], rows["frames"]

    def add_image(self, image_id: int, name: str, camera_id: int) -> None:
        self.images[image_id] = (name, camera_id)
        self.image_ids[name] = image_id
