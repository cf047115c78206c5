# SPDX-License-Identifier: BSD-3-Clause
"""Rigs, frames and images of models in memory, with pycolmap's names."""

from __future__ import annotations

from typing import (Any, Dict, Iterable, List, NamedTuple, Optional, Sequence,
                    Union, overload)

import numpy as np
import numpy.typing as npt

from .cameras import (INVALID_ID, Camera, SensorType, camera_id_of, data_t,
                      sensor_t)
from .errors import InputError
from .geometry import FloatArray, Rigid3d

INVALID_POINT3D_ID = 2**64 - 1


class Rig:
    """Cameras mounted rigidly. A sensor is named by its camera id or sensor_t.

    Attributes:
      rig_id
      ref_camera_id: Its camera frame is the frame of the rig.
      sensors: Pose sensor_from_rig by camera id; the identity for the
        reference, None if unknown.
    """

    def __init__(self, rig_id: int = INVALID_ID,
                 ref_camera_id: int = INVALID_ID,
                 sensors: Optional[Dict[int, Optional[Rigid3d]]] = None
                 ) -> None:
        self.rig_id = rig_id
        self.ref_camera_id = ref_camera_id
        self.sensors = {} if sensors is None else sensors

    @property
    def ref_sensor_id(self) -> sensor_t:
        return sensor_t(SensorType.CAMERA, self.ref_camera_id)

    @property
    def non_ref_sensors(self) -> Dict[sensor_t, Optional[Rigid3d]]:
        """A copy: change poses by set_sensor_from_rig."""
        return {sensor_t(SensorType.CAMERA, camera_id): pose
                for camera_id, pose in self.sensors.items()
                if camera_id != self.ref_camera_id}

    def add_ref_sensor(self, sensor: Union[int, sensor_t]) -> None:
        """Adds the first sensor; its frame is the frame of the rig."""
        if self.sensors:
            raise InputError(f"rig {self.rig_id} has a reference sensor")
        self.ref_camera_id = camera_id_of(sensor)
        self.sensors[self.ref_camera_id] = Rigid3d()

    def add_sensor(self, sensor: Union[int, sensor_t],
                   sensor_from_rig: Optional[Rigid3d] = None) -> None:
        """Adds another sensor; None: its pose is unknown."""
        camera_id = camera_id_of(sensor)
        if not self.sensors or camera_id in self.sensors:
            raise InputError(f"rig {self.rig_id} has the sensor {camera_id} or "
                             "no reference sensor; call add_ref_sensor first")
        self.sensors[camera_id] = sensor_from_rig

    def has_sensor(self, sensor: Union[int, sensor_t]) -> bool:
        return camera_id_of(sensor) in self.sensors

    def num_sensors(self) -> int:
        return len(self.sensors)

    def is_ref_sensor(self, sensor: Union[int, sensor_t]) -> bool:
        return camera_id_of(sensor) == self.ref_camera_id

    def sensor_from_rig(self, sensor: Union[int, sensor_t]
                        ) -> Optional[Rigid3d]:
        """The pose of a camera in the rig."""
        return self.sensors[camera_id_of(sensor)]

    def set_sensor_from_rig(self, sensor: Union[int, sensor_t],
                            sensor_from_rig: Rigid3d) -> None:
        camera_id = camera_id_of(sensor)
        if camera_id == self.ref_camera_id or camera_id not in self.sensors:
            raise InputError(f"camera {camera_id} is the reference of rig "
                             f"{self.rig_id} or not in it")
        self.sensors[camera_id] = sensor_from_rig

    def __repr__(self) -> str:
        return f"Rig(rig_id={self.rig_id}, cameras={list(self.sensors)})"


class Frame:
    """A rig at one instant.

    Attributes:
      frame_id, rig_id
      rig: The Rig; None until the frame is added to a model.
      rig_from_world: Rigid3d; maps the world to the frame of the rig. None: not
        registered.
      image_ids: Of its images, at most one per sensor.
    """

    rig: Rig
    rig_from_world: Rigid3d

    def __init__(self, frame_id: int = INVALID_ID, rig: Optional[Rig] = None,
                 rig_from_world: Optional[Rigid3d] = None,
                 image_ids: Optional[List[int]] = None, *,
                 rig_id: int = INVALID_ID) -> None:
        self.frame_id = frame_id
        self.rig = rig  # type: ignore[assignment]
        self._rig_id = rig_id
        self.rig_from_world = rig_from_world  # type: ignore[assignment]
        self.image_ids = [] if image_ids is None else image_ids
        self.camera_ids: Dict[int, int] = {}  # by image id

    @property
    def rig_id(self) -> int:
        return self._rig_id if self.rig is None else self.rig.rig_id

    @rig_id.setter
    def rig_id(self, rig_id: int) -> None:
        if self.rig is not None:
            raise InputError(f"frame {self.frame_id} belongs to the rig "
                             f"{self.rig.rig_id}")
        self._rig_id = rig_id

    @property
    def data_ids(self) -> List[data_t]:
        return [data_t(sensor_t(SensorType.CAMERA, self.camera_ids[image_id]),
                       image_id) for image_id in self.image_ids]

    def add_data_id(self, data_id: data_t) -> None:
        """Adds an image, by its data_id."""
        camera_id = camera_id_of(data_id.sensor_id)
        if camera_id in self.camera_ids.values():
            raise InputError(f"frame {self.frame_id} has an image of camera "
                             f"{camera_id}")
        self.image_ids.append(data_id.id)
        self.camera_ids[data_id.id] = camera_id

    def has_data_id(self, data_id: data_t) -> bool:
        return data_id in self.data_ids

    def has_pose(self) -> bool:
        """Whether the frame is registered."""
        return self.rig_from_world is not None

    def reset_pose(self) -> None:
        self.rig_from_world = None  # type: ignore[assignment]

    def sensor_from_world(self, sensor: Union[int, sensor_t]) -> Rigid3d:
        """sensor_from_rig * rig_from_world"""
        sensor_from_rig = (None if self.rig is None
                           else self.rig.sensor_from_rig(sensor))
        if self.rig_from_world is None or sensor_from_rig is None:
            raise InputError(f"frame {self.frame_id} or its sensor has no pose")
        return sensor_from_rig * self.rig_from_world

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
    point3D_id: int = INVALID_POINT3D_ID

    def x(self) -> float:
        return float(self.xy[0])

    def y(self) -> float:
        return float(self.xy[1])

    def has_point3D(self) -> bool:
        return self.point3D_id != INVALID_POINT3D_ID


class Points2D(Sequence[Point2D]):
    """The keypoints of one image, as a sequence of Point2D and as arrays.

    Attributes:
      xy: (N, 2) pixels.
      point3D_ids: (N,) INVALID_POINT3D_ID where no point is observed.
    """

    def __init__(self, xy: npt.ArrayLike = (),
                 point3D_ids: Optional[npt.NDArray[np.uint64]] = None) -> None:
        self.xy: FloatArray = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        if point3D_ids is None:
            point3D_ids = np.full(len(self.xy), INVALID_POINT3D_ID, np.uint64)
        self.point3D_ids = point3D_ids

    @staticmethod
    def of(points: Any) -> "Points2D":
        """Makes them of Points2D, an array (N, 2), or pixels in a sequence."""
        if isinstance(points, Points2D):
            return points
        if isinstance(points, np.ndarray):
            return Points2D(points)
        rows: List[Any] = list(points)
        are_keypoints = [isinstance(row, Point2D) for row in rows]
        if not any(are_keypoints):
            return Points2D(rows)
        if not all(are_keypoints):
            raise InputError("points2D must be all Point2D or all pixels")
        return Points2D([row.xy for row in rows],
                        np.array([row.point3D_id for row in rows], np.uint64))

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

    def observed(self) -> npt.NDArray[np.int64]:
        """(M,), the indices of keypoints that observe a point."""
        return np.flatnonzero(self.point3D_ids
                              != np.uint64(INVALID_POINT3D_ID))


Point2DList = Points2D.of
ListPoint2D = Points2D.of  # before 3.12


class Image:
    """An image.

    Attributes:
      image_id, camera_id, frame_id
      name: As in the database.
      camera, frame: The Camera and the Frame; None until the image is added to
        a model.
      points2D: Points2D, its keypoints.
    """

    frame: Frame
    camera: Camera

    def __init__(self, name: str = "",
                 points2D: Union[Points2D, Iterable[Point2D]] = (),
                 camera_id: int = INVALID_ID, image_id: int = INVALID_ID, *,
                 keypoints: Optional[npt.ArrayLike] = None,
                 camera: Optional[Camera] = None,
                 frame: Optional[Frame] = None,
                 frame_id: int = INVALID_ID) -> None:
        """keypoints: (N, 2) pixels, instead of points2D."""
        self.image_id = image_id
        self.name = name
        self.camera = camera  # type: ignore[assignment]
        self.frame = frame  # type: ignore[assignment]
        self._camera_id = camera_id
        self._frame_id = frame_id
        self.points2D = (points2D if keypoints is None  # type: ignore
                         else np.asarray(keypoints))

    @property
    def points2D(self) -> Points2D:
        return self._points2D

    @points2D.setter
    def points2D(self, points2D: Any) -> None:
        self._points2D = Points2D.of(points2D)

    @property
    def camera_id(self) -> int:
        return self._camera_id if self.camera is None else self.camera.camera_id

    @camera_id.setter
    def camera_id(self, camera_id: int) -> None:
        if self.camera is not None:
            raise InputError(f"image '{self.name}' has the camera "
                             f"{self.camera.camera_id}")
        self._camera_id = camera_id

    @property
    def frame_id(self) -> int:
        return self._frame_id if self.frame is None else self.frame.frame_id

    @frame_id.setter
    def frame_id(self, frame_id: int) -> None:
        if self.frame is not None:
            raise InputError(f"image '{self.name}' is in the frame "
                             f"{self.frame.frame_id}")
        self._frame_id = frame_id

    @property
    def data_id(self) -> data_t:
        return data_t(sensor_t(SensorType.CAMERA, self.camera_id),
                      self.image_id)

    @property
    def has_pose(self) -> bool:
        """Whether the image is registered."""
        return (self.frame is not None and self.frame.has_pose()
                and self.frame.rig is not None
                and self.frame.rig.sensor_from_rig(self.camera_id) is not None)

    @property
    def cam_from_world(self) -> Rigid3d:
        """sensor_from_rig * rig_from_world; may also be called."""
        if self.frame is None or not self.has_pose:
            raise InputError(f"image '{self.name}' is not registered")
        return self.frame.sensor_from_world(self.camera_id)

    def projection_center(self) -> FloatArray:
        """(3,), in the world"""
        return self.cam_from_world.inverse().translation

    def viewing_direction(self) -> FloatArray:
        """(3,), unit vector in the world"""
        direction: FloatArray = self.cam_from_world.rotation.matrix()[2]
        return direction

    def project_point(self, points: npt.ArrayLike) -> Any:
        """Projects points in the world to pixels.

        Args:
          points: (3,) or (N, 3).

        Returns (2,), or None if the camera cannot see the point; for several
        points (N, 2), NaN where it cannot.
        """
        if self.camera is None:
            raise InputError(f"image '{self.name}' has no camera")
        return self.camera.img_from_cam(self.cam_from_world * points)

    def num_points2D(self) -> int:
        return len(self.points2D)

    @property
    def num_points3D(self) -> int:
        return len(self.points2D.observed())

    def point2D(self, point2D_idx: int) -> Point2D:
        return self.points2D[point2D_idx]

    def has_point3D(self, point3D_id: int) -> bool:
        """Whether a keypoint observes the point."""
        return bool((self.points2D.point3D_ids == np.uint64(point3D_id)).any())

    def get_observation_point2D_idxs(self) -> List[int]:
        """The indices of the keypoints that observe a point."""
        idxs: List[int] = self.points2D.observed().tolist()
        return idxs

    def get_observation_points2D(self) -> Points2D:
        """The keypoints that observe a point; a copy."""
        observed = self.points2D.observed()
        return Points2D(self.points2D.xy[observed],
                        self.points2D.point3D_ids[observed])

    def __repr__(self) -> str:
        return (f"Image(image_id={self.image_id}, name={self.name!r}, "
                f"camera_id={self.camera_id}, frame_id={self.frame_id})")
